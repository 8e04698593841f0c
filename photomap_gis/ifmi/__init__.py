"""iFMI: registration of two frames by their spectra, with a calibrated covariance and a calibrated doubt."""

from photomap_gis.ifmi.frames import FrameVerdict, judge_frame
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.register import register, register_images
from photomap_gis.ifmi.spectrum import Spectrum, make_spectrum
from photomap_gis.ifmi.working import WorkingImage, make_working

__all__ = [
    "FrameVerdict",
    "Prior",
    "Spectrum",
    "WorkingImage",
    "judge_frame",
    "make_spectrum",
    "make_working",
    "register",
    "register_images",
]
