"""The camera of a plan: a known one by its name, or numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.profiles import DIAGONAL_35MM_MM, all_profiles
from photomap_gis.mission_planner.optics import Optics

_AGREE = 0.04
"""35 mm equivalents are rounded: what lies closer together than this share says the same."""


@dataclass(frozen=True, slots=True)
class LensNumbers:
    """What is said of a lens by numbers: each is enough by itself, but ``focal_mm`` wants the sensor's width too."""

    fov_deg: float | None = None
    """Horizontal field of view."""
    focal_mm: float | None = None
    sensor_width_mm: float | None = None
    focal_35mm: float | None = None
    """35 mm equivalent, by the diagonal."""

    def focal_px(self, width_px: int, height_px: int, px_per_mm: float | None = None) -> float | None:
        """Return the focal length in pixels of a raster, None where nothing is said of the lens.

        ``px_per_mm`` is the known sensor's, where there is one. Raises ``UsageError`` where a number is missing, or two
        of them do not go together.
        """
        if self.sensor_width_mm is not None:
            px_per_mm = width_px / self.sensor_width_mm
        if self.focal_mm is not None and px_per_mm is None:
            raise UsageError(
                "--focal-mm needs the sensor's width: --sensor-width-mm MM; or give --focal-35mm, --fov-deg"
            )
        if self.sensor_width_mm is not None and self.focal_mm is None:
            raise UsageError("--sensor-width-mm needs the lens's focal length: --focal-mm MM")
        said: dict[str, float] = {}
        if self.fov_deg is not None:
            said["--fov-deg"] = width_px / 2.0 / math.tan(math.radians(self.fov_deg) / 2.0)
        if self.focal_mm is not None and px_per_mm is not None:
            said["--focal-mm"] = self.focal_mm * px_per_mm
        if self.focal_35mm is not None:
            said["--focal-35mm"] = self.focal_35mm * math.hypot(width_px, height_px) / DIAGONAL_35MM_MM
        if not said:
            return None
        if max(said.values()) > (1.0 + _AGREE) * min(said.values()):
            views = ", ".join(f"{name} means {_fov_deg(width_px, focal):.1f}" for name, focal in said.items())
            raise UsageError(
                f"the numbers of the camera contradict each other: degrees of horizontal view that {views}; give one"
            )
        name, focal = next(iter(said.items()))
        if not 1.0 <= _fov_deg(width_px, focal) <= 160.0:
            raise UsageError(
                f"{name} means {_fov_deg(width_px, focal):.2g} degrees of horizontal view: 1 to 160 can be; "
                "check the millimetres"
            )
        return focal


def camera_optics(
    name: str | None, lens: LensNumbers, *, width_px: int | None = None, height_px: int | None = None
) -> Optics:
    """Return the optics of a named camera (any part of maker and model), or of the numbers of a lens and a raster.

    Raises ``UsageError`` where the name fits none or several different cameras, or numbers are missing or contradict.
    """
    if name is None:
        focal = None if width_px is None or height_px is None else lens.focal_px(width_px, height_px)
        if width_px is None or height_px is None or focal is None:
            raise UsageError(
                "say which camera: --camera NAME, or --fov-deg (or --focal-mm and --sensor-width-mm, or --focal-35mm) "
                "with --image-width and --image-height"
            )
        return Optics(width_px, height_px, focal)
    words = name.lower().split()
    fits = [p for p in all_profiles() if all(w in f"{p.name} {p.make} {' '.join(p.models)}".lower() for w in words)]
    exact = [p for p in fits if name.lower() in {p.name.lower(), *(m.lower() for m in p.models)}]
    fits = exact or fits
    if not fits:
        raise UsageError(
            f"no camera is known as {name!r}: leave --camera away and give --fov-deg (or --focal-mm and "
            "--sensor-width-mm), --image-width and --image-height"
        )
    optics = {(p.width_px, p.height_px, p.focal_mm): p for p in fits}
    if len(optics) > 1:
        names = ", ".join(sorted({p.name for p in fits})[:8])
        raise UsageError(f"several cameras are known as {name!r}: say which of {names}")
    profile = fits[0]
    check_raster(profile.name, (profile.width_px, profile.height_px), (width_px, height_px))
    px_per_mm = profile.px_per_mm(profile.width_px, profile.height_px)
    focal = lens.focal_px(profile.width_px, profile.height_px, px_per_mm)
    if focal is None and profile.focal_mm is None:
        raise UsageError(f"{profile.name} takes several lenses: give --focal-mm or --fov-deg too")
    if focal is None:
        focal = float(profile.focal_mm or 0.0) * px_per_mm
    return Optics(profile.width_px, profile.height_px, focal, profile.name)


def check_raster(name: str, size_px: tuple[int, int], asked_px: tuple[int | None, int | None]) -> None:
    """Raise ``UsageError`` where another raster is asked for than a camera takes."""
    for asked, own in zip(asked_px, size_px, strict=True):
        if asked is not None and asked != own:
            raise UsageError(
                f"{name} takes {size_px[0]} x {size_px[1]} pixels: leave --image-width and --image-height away, or "
                "--camera, and give all numbers"
            )


def _fov_deg(width_px: int, focal_px: float) -> float:
    return math.degrees(2.0 * math.atan(width_px / 2.0 / focal_px))
