"""From what a photo or a video says of its lens to a ``Camera``: every statement is weighed against the others.

No statement is right always: a reduced copy keeps the focal plane's resolution of the original, software rewrites sizes
but not lenses, "35 mm equivalents" are rounded and refer to the diagonal. So each becomes an estimate of the focal
length in pixels of the stored raster, with a sigma; one that all others contradict is not believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.exif import ExifFacts
from photomap_gis.ingest.profiles import DIAGONAL_35MM_MM, CameraProfile, CameraRole, find_profile
from photomap_gis.ingest.xmp import Calibration

AGREEMENT = 0.12  # two estimates within this relative difference support each other
_PLAUSIBLE_SENSOR_MM = (3.2, 62.0)
_PLAUSIBLE_HFOV_RAD = (math.radians(1.0), math.radians(160.0))


@dataclass(frozen=True, slots=True)
class LensFacts:
    """What is said of the lens. Pixel sizes are those of the raster as the camera wrote it, where known."""

    make: str = ""
    model: str = ""
    role: CameraRole | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None
    digital_zoom: float = 1.0
    full_width_px: int | None = None
    full_height_px: int | None = None
    focal_plane_px_per_mm: float | None = None
    calibrations: tuple[Calibration, ...] = ()

    @classmethod
    def of_exif(
        cls,
        exif: ExifFacts,
        *,
        make: str = "",
        model: str = "",
        role: CameraRole | None = None,
        calibrations: tuple[Calibration, ...] = (),
    ) -> LensFacts:
        """Return the facts of a photo's EXIF; ``make`` and ``model`` stand in where EXIF has none."""
        return cls(
            exif.make or make,
            exif.model or model,
            role,
            exif.focal_mm,
            exif.focal_35mm,
            exif.digital_zoom,
            exif.full_width_px,
            exif.full_height_px,
            exif.focal_plane_px_per_mm,
            calibrations,
        )


@dataclass(frozen=True, slots=True)
class _Estimate:
    focal_px: float
    sigma_rel: float
    origin: str
    calibration: Calibration | None = None
    scale: float = 1.0


def camera_for(
    width_px: int,
    height_px: int,
    facts: LensFacts | None = None,
    *,
    hfov_deg: float | None = None,
    focal_35mm: float | None = None,
    is_video: bool = False,
) -> Camera:
    """Return the camera of a stored raster: the user's word first, else the best of what ``facts`` say.

    ``hfov_deg`` is the horizontal field of view, ``focal_35mm`` the 35 mm equivalent (by the diagonal). A video's
    frame (``is_video``) may be a crop of the sensor that nobody states: wider sigma. Raises ``UsageError`` where the
    user's word makes no sense.
    """
    facts = facts or LensFacts()
    profile = find_profile(facts.make, facts.model, width_px, height_px, role=facts.role, focal_mm=facts.focal_mm)
    name = profile.name if profile else " ".join(w for w in (facts.make, facts.model) if w)
    if hfov_deg is not None:
        if not 1.0 <= hfov_deg <= 170.0:
            raise UsageError(f"a horizontal field of view of {hfov_deg:g} degrees: give one between 1 and 170")
        focal = width_px / 2.0 / math.tan(math.radians(hfov_deg) / 2.0)
        return Camera(width_px, height_px, focal, name=name, origin="option", focal_sigma_rel=0.01)
    if focal_35mm is not None:
        if not 5.0 <= focal_35mm <= 3000.0:
            raise UsageError(f"a 35 mm equivalent of {focal_35mm:g} mm: give one between 5 and 3000")
        focal = focal_35mm / DIAGONAL_35MM_MM * _diagonal_px(profile, width_px, height_px)
        return Camera(width_px, height_px, focal, name=name, origin="option", focal_sigma_rel=0.02)
    best = _most_trusted([e for e in _estimates(facts, profile, width_px, height_px) if _is_plausible(e, width_px)])
    if best is None:
        return Camera(width_px, height_px, name=name)
    sigma = math.hypot(best.sigma_rel, 0.06) if is_video else best.sigma_rel
    if best.calibration is not None:
        return _calibrated_camera(best, width_px, height_px, name, sigma)
    return Camera(width_px, height_px, best.focal_px, name=name, origin=best.origin, focal_sigma_rel=sigma)


def _estimates(facts: LensFacts, profile: CameraProfile | None, width_px: int, height_px: int) -> Iterator[_Estimate]:
    full_width = _full_width(facts, profile, width_px, height_px)
    full = _calibrated_width(facts, width_px, height_px) or full_width
    for calibration in facts.calibrations:
        scale = _pure_scale(width_px, height_px, full) if full else 1.0
        sigma = 0.005 if calibration.centre_offset_xy_px is not None else 0.012
        yield _Estimate(calibration.focal_px * scale, sigma if full else 0.05, calibration.origin, calibration, scale)
    fisheye = profile is not None and profile.fisheye
    if profile and facts.focal_mm:
        sigma = 0.1 if fisheye else 0.015
        density = profile.px_per_mm(width_px, height_px)
        yield _Estimate(facts.focal_mm * facts.digital_zoom * density, sigma, "profile and exif focal length")
    if facts.focal_plane_px_per_mm and facts.focal_mm:
        yield from _of_focal_plane(facts, full_width, width_px, height_px)
    if facts.focal_35mm:
        diagonal = _diagonal_px(profile, width_px, height_px)
        # written as an integer: half a millimetre is its rounding; the raster's shape may differ from the sensor's
        sigma = math.hypot(0.02 if profile else 0.03, 0.3 / facts.focal_35mm)
        yield _Estimate(facts.focal_35mm / DIAGONAL_35MM_MM * diagonal, sigma, "exif 35 mm equivalent")
    if profile and profile.focal_mm:
        # a zoom's wide end is a guess, and so is the standard lens of a body with several
        sigma = 0.25 if profile.zoom else 0.1 if fisheye else 0.03
        density = profile.px_per_mm(width_px, height_px)
        yield _Estimate(profile.focal_mm * facts.digital_zoom * density, sigma, "profile")


def _of_focal_plane(facts: LensFacts, full_width: int | None, width_px: int, height_px: int) -> Iterator[_Estimate]:
    """The focal plane's resolution counts pixels of the raster as it was taken; the stored one may be reduced."""
    density, focal = facts.focal_plane_px_per_mm, facts.focal_mm
    if density is None or focal is None:
        return
    full = full_width or max(width_px, height_px)
    sensor_mm = full / density
    if _PLAUSIBLE_SENSOR_MM[0] <= sensor_mm <= _PLAUSIBLE_SENSOR_MM[1]:
        scale = _pure_scale(width_px, height_px, full)
        sigma = 0.02 if full_width else 0.08
        yield _Estimate(focal * facts.digital_zoom * density * scale, sigma, "exif focal plane resolution")


def _full_width(facts: LensFacts, profile: CameraProfile | None, width_px: int, height_px: int) -> int | None:
    """Return the long side of the raster as the camera wrote it, where it is recorded or known of the camera.

    Recorded sizes hold where they have the stored raster's shape (the stored one is then the original or a pure
    reduction of it); software that reduces often rewrites them, so a known camera's own size wins where it is larger.
    """
    shape = max(width_px, height_px) / max(min(width_px, height_px), 1)
    if profile is not None and abs(profile.width_px / profile.height_px / shape - 1.0) < 0.01:
        recorded = _recorded_width(facts, shape)
        # a quad-Bayer camera writes the full or a quarter of its pixels: believe what is recorded
        if recorded is not None and recorded >= 0.49 * profile.width_px:
            return recorded
        return profile.width_px if profile.width_px >= max(width_px, height_px) else None
    return _recorded_width(facts, shape)


def _recorded_width(facts: LensFacts, shape: float) -> int | None:
    if not facts.full_width_px or not facts.full_height_px:
        return None
    long = max(facts.full_width_px, facts.full_height_px)
    short = min(facts.full_width_px, facts.full_height_px)
    return long if abs(long / short / shape - 1.0) < 0.01 else None


def _calibrated_width(facts: LensFacts, width_px: int, height_px: int) -> int | None:
    """Return the long side of the raster that a calibration means: its centre lies within a few percent of the middle.

    Tells the full from the quarter raster of a quad-Bayer camera; recorded and stored widths are exact where they fit.
    """
    centres = [c.centre_xy_px for c in facts.calibrations if c.centre_xy_px is not None]
    if not centres:
        return None
    about = 2.0 * max(centres[0])
    recorded = max(facts.full_width_px or 0, facts.full_height_px or 0)
    exact = [w * k for w in (recorded, max(width_px, height_px)) for k in (1, 2, 4, 0.5, 0.25)]
    return round(next((w for w in exact if abs(w / about - 1.0) < 0.05), about))


def _pure_scale(width_px: int, height_px: int, full_width: int) -> float:
    scale = max(width_px, height_px) / full_width
    return 1.0 if abs(scale - 1.0) < 0.02 else scale


def _diagonal_px(profile: CameraProfile | None, width_px: int, height_px: int) -> float:
    """Return the diagonal, in pixels of the stored raster, of the picture to which an equivalent focal length refers.

    It is the sensor's: a wide picture (16:9) is cut from a sensor of 4:3 or 3:2 whose width it keeps.
    """
    if profile is not None:
        return profile.px_per_mm(width_px, height_px) * math.hypot(profile.sensor_width_mm, profile.sensor_height_mm)
    long, short = max(width_px, height_px), min(width_px, height_px)
    return math.hypot(long, short) if long / short <= 1.6 else 1.22 * long


def _is_plausible(estimate: _Estimate, width_px: int) -> bool:
    hfov = 2.0 * math.atan(width_px / 2.0 / estimate.focal_px) if estimate.focal_px > 0 else 0.0
    return _PLAUSIBLE_HFOV_RAD[0] <= hfov <= _PLAUSIBLE_HFOV_RAD[1]


def _most_trusted(estimates: Sequence[_Estimate]) -> _Estimate | None:
    """Return the estimate of the smallest sigma among those with the most support; a lone voice loses to two.

    Its sigma is widened to half of what good estimates that support it differ by.
    """
    if not estimates:
        return None
    supporters = [[o for o in estimates if _agree(e, o)] for e in estimates]
    most = max(len(s) for s in supporters)
    best, with_it = min(
        ((e, s) for e, s in zip(estimates, supporters, strict=True) if len(s) == most),
        key=lambda pair: pair[0].sigma_rel,
    )
    spread = max((abs(math.log(o.focal_px / best.focal_px)) for o in with_it if o.sigma_rel < 0.05), default=0.0)
    return replace(best, sigma_rel=round(max(best.sigma_rel, spread / 2.0), 4))


def _agree(a: _Estimate, b: _Estimate) -> bool:
    return abs(math.log(a.focal_px / b.focal_px)) < AGREEMENT + 2.0 * max(a.sigma_rel, b.sigma_rel)


def _calibrated_camera(best: _Estimate, width_px: int, height_px: int, name: str, sigma: float) -> Camera:
    """Bring a calibration of the full raster to the stored one: focal length, principal point and radial distortion."""
    calibration = best.calibration
    if calibration is None:
        raise ValueError("the estimate has no calibration")
    middle = ((width_px - 1) / 2.0, (height_px - 1) / 2.0)
    offset = (0.0, 0.0)
    if calibration.centre_offset_xy_px is not None:
        offset = (calibration.centre_offset_xy_px[0] * best.scale, calibration.centre_offset_xy_px[1] * best.scale)
    elif calibration.centre_xy_px is not None and width_px >= height_px:
        # the centre counts from the raster's corner, our pixels from the first one's centre
        x, y = calibration.centre_xy_px
        offset = (x * best.scale - 0.5 - middle[0], y * best.scale - 0.5 - middle[1])
    if abs(offset[0]) > 0.06 * width_px or abs(offset[1]) > 0.06 * height_px:  # a crop, or another raster
        offset = (0.0, 0.0)
    corner = math.hypot(width_px, height_px) / 2.0 / best.focal_px
    k1, k2, k3 = (0.0, 0.0, 0.0) if _folds(calibration.radial, corner) else calibration.radial
    return Camera(
        width_px,
        height_px,
        best.focal_px,
        middle[0] + offset[0],
        middle[1] + offset[1],
        k1,
        k2,
        name=name,
        origin=best.origin,
        focal_sigma_rel=sigma,
        k3=k3,
    )


def _folds(radial: tuple[float, float, float], corner: float) -> bool:
    """Whether the polynomial turns back on itself within the picture: a broken calibration.

    ``corner`` is the corner's distance from the middle in focal lengths, in the distorted picture.
    """
    k1, k2, k3 = radial
    r = np.linspace(0.0, 2.0 * corner, 800)[1:]
    distorted = r * (1.0 + r**2 * (k1 + r**2 * (k2 + r**2 * k3)))
    folds = np.flatnonzero(np.diff(distorted) <= 0.0)
    return bool(len(folds)) and float(distorted[folds[0]]) < 0.98 * corner
