"""The camera of a plan: a known one by its name, or numbers."""

from __future__ import annotations

import math

from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.profiles import all_profiles
from photomap_gis.mission_planner.optics import Optics


def camera_optics(
    name: str | None, *, fov_deg: float | None = None, width_px: int | None = None, height_px: int | None = None
) -> Optics:
    """Return the optics of a named camera (any part of maker and model), or of a horizontal field of view and a raster.

    Raises ``UsageError`` where the name fits none or several different cameras.
    """
    if name is None:
        if fov_deg is None or width_px is None or height_px is None:
            raise UsageError("say which camera: --camera NAME, or --fov-deg with --image-width and --image-height")
        return Optics(width_px, height_px, width_px / 2.0 / math.tan(math.radians(fov_deg) / 2.0))
    words = name.lower().split()
    fits = [p for p in all_profiles() if all(w in f"{p.name} {p.make} {' '.join(p.models)}".lower() for w in words)]
    exact = [p for p in fits if name.lower() in {p.name.lower(), *(m.lower() for m in p.models)}]
    fits = exact or fits
    if not fits:
        raise UsageError(f"no camera is known as {name!r}: give --fov-deg, --image-width and --image-height instead")
    optics = {(p.width_px, p.height_px, p.focal_mm): p for p in fits}
    if len(optics) > 1:
        names = ", ".join(sorted({p.name for p in fits})[:8])
        raise UsageError(f"several cameras are known as {name!r}: say which of {names}")
    profile = fits[0]
    if profile.focal_mm is None and fov_deg is None:
        raise UsageError(f"{profile.name} takes several lenses: give --fov-deg too")
    if fov_deg is not None:
        focal = profile.width_px / 2.0 / math.tan(math.radians(fov_deg) / 2.0)
    else:
        focal = float(profile.focal_mm or 0.0) * profile.px_per_mm(profile.width_px, profile.height_px)
    return Optics(profile.width_px, profile.height_px, focal, profile.name)
