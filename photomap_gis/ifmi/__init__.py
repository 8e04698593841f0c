"""iFMI: registration of two frames by their spectra, with a calibrated covariance and a calibrated doubt."""

from photomap_gis.ifmi.frames import (
    Fault,
    FrameLook,
    FrameVerdict,
    fixed_overlay_mask,
    judge_frame,
    judge_registered,
    look_at,
)
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.register import register, register_images
from photomap_gis.ifmi.spectrum import Spectrum, make_spectrum
from photomap_gis.ifmi.working import WorkingImage, make_working

__all__ = [
    "Fault",
    "FrameLook",
    "FrameVerdict",
    "Prior",
    "Spectrum",
    "WorkingImage",
    "fixed_overlay_mask",
    "judge_frame",
    "judge_registered",
    "look_at",
    "make_spectrum",
    "make_working",
    "register",
    "register_images",
]
