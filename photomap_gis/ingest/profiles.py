"""What is known of common drone cameras: ``cameras.json``, each entry with the source of its numbers."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib import resources

DIAGONAL_35MM_MM = 43.267  # of the 36 x 24 mm frame, to which equivalent focal lengths refer [CIPA DCG-001]


class CameraRole(StrEnum):
    """Which of a drone's cameras; ``VISIBLE`` where it has one, ``BAND`` for a single spectral band."""

    VISIBLE = "visible"
    WIDE = "wide"
    ZOOM = "zoom"
    THERMAL = "thermal"
    BAND = "band"


@dataclass(frozen=True, slots=True)
class CameraProfile:
    """A camera's sensor and lens.

    ``sensor_width_mm`` and ``sensor_height_mm`` are the area that the full raster of ``width_px`` x ``height_px``
    covers. ``focal_mm`` and ``focal_35mm`` are those of the fixed lens, or of a zoom's wide end (``zoom``), ``None``
    where lenses are exchanged. ``fisheye``: the lens bends straight lines too much for a pinhole camera.
    """

    name: str
    make: str
    models: tuple[str, ...]
    sensor_width_mm: float
    sensor_height_mm: float
    width_px: int
    height_px: int
    focal_mm: float | None
    focal_35mm: float | None
    source: str
    role: CameraRole = CameraRole.VISIBLE
    zoom: bool = False
    fisheye: bool = False

    def px_per_mm(self, width_px: int, height_px: int) -> float:
        """Return how many pixels of a raster of this size lie on a millimetre of the sensor.

        A raster of another shape is a crop: it keeps the full raster's width or its height, so the larger of the two
        reductions is true. A portrait raster is a turned one.
        """
        long, short = max(width_px, height_px), min(width_px, height_px)
        full = math.sqrt(self.width_px / self.sensor_width_mm * self.height_px / self.sensor_height_mm)
        return full * max(long / self.width_px, short / self.height_px)


@cache
def all_profiles() -> tuple[CameraProfile, ...]:
    """Return every profile of the data file."""
    raw = json.loads(resources.files(__package__).joinpath("cameras.json").read_text(encoding="utf-8"))
    return tuple(
        CameraProfile(
            name=entry["name"],
            make=entry["make"],
            models=tuple(entry["models"]),
            sensor_width_mm=float(entry["sensor_mm"][0]),
            sensor_height_mm=float(entry["sensor_mm"][1]),
            width_px=int(entry["image_px"][0]),
            height_px=int(entry["image_px"][1]),
            focal_mm=entry["focal_mm"],
            focal_35mm=entry["focal_35mm"],
            source=entry["source"],
            role=CameraRole(entry.get("role", "visible")),
            zoom=bool(entry.get("zoom", False)),
            fisheye=bool(entry.get("fisheye", False)),
        )
        for entry in raw["cameras"]
    )


def find_profile(
    make: str,
    model: str,
    width_px: int,
    height_px: int,
    *,
    role: CameraRole | None = None,
    focal_mm: float | None = None,
) -> CameraProfile | None:
    """Return the profile of a camera by its EXIF make and model, ``None`` where it is not known.

    A body with several cameras under one model name is told apart by ``role`` and by the photo's ``focal_mm`` where
    they are known, else by the raster: its shape, and that it is no larger than the camera's; a wide camera comes
    before a zoom where both fit.
    """
    wanted = _key(model)
    if not wanted:
        return None
    found = [p for p in all_profiles() if wanted in _keys(p) and _makes_agree(make, p, wanted)]
    if role is not None and role is not CameraRole.VISIBLE and len(found) > 1:
        found = [p for p in found if p.role is role] or [p for p in found if p.role is CameraRole.VISIBLE]
    if not found:
        return None
    order = list(CameraRole)
    return min(
        found,
        key=lambda p: (
            focal_mm is not None and not _can_have(p, focal_mm),
            round(_shape_distance(p, width_px, height_px), 1),
            max(width_px, height_px) > 1.01 * p.width_px,
            order.index(p.role),
            abs(max(width_px, height_px) - p.width_px),
        ),
    )


def _key(words: str) -> str:
    return re.sub(r"[^a-z0-9+]", "", words.lower())


def _keys(profile: CameraProfile) -> set[str]:
    """Every way in which the profile's models are written: some makers repeat their name in the model, some do not."""
    make = _key(profile.make)
    plain = {_key(m) for m in profile.models}
    return plain | {k.removeprefix(make) for k in plain} - {""} | {make + k for k in plain}


def _makes_agree(make: str, profile: CameraProfile, model_key: str) -> bool:
    """A missing or odd make is forgiven where the model alone says enough ("FC6310", but not "2" or "GR")."""
    given, known = _key(make), _key(profile.make)
    if given and (given[:5] in known or known[:5] in given):
        return True
    has_own_word = len(model_key) >= 4 and any(c.isdigit() for c in model_key)
    return has_own_word and (not given or {given[:3], known[:3]} <= {"dji", "has"})


def _shape_distance(profile: CameraProfile, width_px: int, height_px: int) -> float:
    if width_px < 1 or height_px < 1:
        return 0.0
    long, short = max(width_px, height_px), min(width_px, height_px)
    return abs(long / short - profile.width_px / profile.height_px)


def _can_have(profile: CameraProfile, focal_mm: float) -> bool:
    if profile.focal_mm is None:
        return True
    ratio = focal_mm / profile.focal_mm
    return ratio > 0.87 and (profile.zoom or ratio < 1.15)
