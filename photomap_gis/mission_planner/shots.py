"""Where a plan's pictures are taken, and the ground that each one shows on level ground: for drawing, not for proof."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.plan import CameraTrigger, Sortie, SurveyPlan, Waypoint
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics

FloatArray = npt.NDArray[np.float64]

_NADIR_DEG = -90.0
_LEAST_LEG_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PlannedShot:
    """A picture of a plan: ``xy_m`` in the frame it was asked for in, ``heading_rad`` of its upper edge from north."""

    sortie: int
    """Counted from 1, as the files are."""
    xy_m: FloatArray
    heading_rad: float
    looks_down: bool


def planned_shots(plan: SurveyPlan, frame: LocalFrame) -> Iterator[PlannedShot]:
    """Yield the pictures in the order of flight: every so many metres from where the camera goes on, or hovering."""
    for number, sortie in enumerate(plan.sorties, 1):
        yield from _of_sortie(number, sortie, frame)


def footprint_ring(shot: PlannedShot, optics: Optics, height_m: float) -> FloatArray:
    """Return ``(5, 2)`` metres: the closed ground rectangle of a level picture from ``height_m`` above ground."""
    across, along = optics.footprint_m(height_m)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * (across / 2.0, along / 2.0)
    c, s = math.cos(shot.heading_rad), math.sin(shot.heading_rad)
    return np.asarray(shot.xy_m + corners @ np.array([[c, -s], [s, c]]))


def _of_sortie(number: int, sortie: Sortie, frame: LocalFrame) -> Iterator[PlannedShot]:
    points = sortie.waypoints
    xy = frame.to_xy([(w.lat_deg, w.lon_deg) for w in points])
    pitch_deg = _carried(w.gimbal_pitch_deg for w in points)
    down = [p is None or p <= _NADIR_DEG + 0.5 for p in pitch_deg]
    speeds = _carried(w.speed_m_s for w in points)
    since = 0.0  # metres flown since the last picture
    running: CameraTrigger | None = None
    for i, waypoint in enumerate(points):
        trigger = waypoint.trigger
        nose = None if waypoint.heading_deg is None else math.radians(waypoint.heading_deg)
        if trigger is None:
            running = None
            continue
        if trigger.hover:
            running = None
            yield PlannedShot(number, xy[i], _hover_heading(xy, points, i) if nose is None else nose, down[i])
            continue
        step = _step_m(trigger, speeds[i])
        if step is None or i + 1 == len(points):
            continue
        if running != trigger:
            since, running = step, trigger  # the first one where the camera goes on
        leg = xy[i + 1] - xy[i]
        length = float(np.hypot(*leg))
        if length < _LEAST_LEG_M:
            continue
        heading = math.atan2(leg[0], leg[1]) if nose is None else nose
        at = step - since
        while at <= length + _LEAST_LEG_M:
            yield PlannedShot(number, xy[i] + leg * (at / length), heading, down[i])
            at += step
        since = length - (at - step)


def _carried(values: Iterable[float | None]) -> list[float | None]:
    """What holds until another is said."""
    found: list[float | None] = []
    for value in values:
        found.append(value if value is not None or not found else found[-1])
    return found


def _step_m(trigger: CameraTrigger, speed_m_s: float | None) -> float | None:
    """Metres between pictures; None where nothing says how far the vehicle gets between them."""
    if trigger.distance_m is not None:
        return trigger.distance_m if trigger.distance_m > 0 else None
    if trigger.interval_s is None or not speed_m_s:
        return None
    return max(trigger.interval_s * speed_m_s, 0.01)


def _hover_heading(xy: FloatArray, points: Sequence[Waypoint], i: int) -> float:
    """Along the lane: to the next place where it hovers, else from the one before."""
    for other in (i + 1, i - 1):
        if not 0 <= other < len(points):
            continue
        leg = xy[max(i, other)] - xy[min(i, other)]
        trigger = points[other].trigger
        if trigger is not None and trigger.hover and float(np.hypot(*leg)) > _LEAST_LEG_M:
            return math.atan2(leg[0], leg[1])
    return 0.0
