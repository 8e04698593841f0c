"""A frame's line of the journal: where it was known to be when the loop took it, and the pose that it got."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Attitude, FrameRef, GpsFix
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.steps import Step


def place_of(ref: FrameRef) -> list[Any] | None:
    """Return fix, height, attitude and time as numbers, ``None`` where nothing is known."""
    if ref.fix is None and ref.attitude is None and ref.height_m is None and ref.time_s is None:
        return None
    f, a = ref.fix, ref.attitude
    fix = None if f is None else [f.lat_deg, f.lon_deg, f.alt_m, f.sigma_m]
    attitude = None if a is None else [a.yaw_rad, a.pitch_rad, a.roll_rad, a.sigma_yaw_rad, a.sigma_tilt_rad]
    return [fix, ref.height_m, attitude, ref.time_s]


def placed_as(ref: FrameRef, place: Any) -> FrameRef:
    """Return a ref with what a journal's line says; ``DataError`` where that makes no sense."""
    if place is None:
        return replace(ref, fix=None, height_m=None, attitude=None)
    try:
        fix, height_m, attitude, time_s = place
        return replace(
            ref,
            fix=None if fix is None else GpsFix(*fix),
            height_m=height_m,
            attitude=None if attitude is None else Attitude(*attitude),
            time_s=time_s,
        )
    except (TypeError, ValueError) as error:
        raise DataError("the journal of this session is damaged: a frame's place makes no sense") from error


def pose_numbers(step: Step) -> list[float] | None:
    """Return a step's pose as the journal keeps it: every digit."""
    if step.belief is None:
        return None
    T: Similarity2D = step.belief.T_map_plane
    return [T.tx, T.ty, T.angle_rad, T.log_scale]
