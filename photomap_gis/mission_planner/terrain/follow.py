"""A plan over flat ground bent to the ground that is there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.plan import AltitudeFrame, Sortie, SurveyPlan, Waypoint, WaypointRole
from photomap_gis.elevation import VerticalDatum, geoid_m
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.terrain.profile import fewest, flyable

FloatArray = NDArray[np.float64]

_MOST_SAMPLES = 2_000_000
_DEFAULT_SPEED_M_S = 10.0

_FLAT = "flat ground"
_VEHICLES_TERRAIN = "heights are above terrain as the vehicle knows it: check that its terrain data is loaded"
FLAT_GROUND = "assumes flat ground: heights are above the take-off place; give --dem FILE to follow the terrain"


class Ground(Protocol):
    """Where the ground is; ``Dem`` is one."""

    @property
    def vertical(self) -> VerticalDatum:
        """What its heights are above."""

    @property
    def stated(self) -> bool:
        """Whether somebody said so."""

    @property
    def cell_m(self) -> float:
        """How far apart it knows the ground."""

    def elevation_m(self, lat_lon_deg: ArrayLike) -> FloatArray:
        """Return metres at ``(N, 2)`` latitudes and longitudes, NaN where not known."""


@dataclass(frozen=True, slots=True)
class FollowSettings:
    """How closely to follow, and how steeply a vehicle may climb and descend at its speed.

    Each leg flies within ``tolerance_m`` below the height above ground that was asked for; how far above it a slope
    limit forces it is told. ``beside_m``: the ground this far to both sides counts too. ``geoid_m`` is the geoid's
    height above the ellipsoid, for models above the ellipsoid where PROJ's grid is not at hand.
    """

    tolerance_m: float
    climb_m_s: float = 3.0
    descent_m_s: float = 1.5
    beside_m: float = 5.0
    geoid_m: float | None = None

    def __post_init__(self) -> None:
        for name in ("tolerance_m", "climb_m_s", "descent_m_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise UsageError(f"{name} must be above 0, got {value:g}")


@dataclass(frozen=True, slots=True)
class TerrainReport:
    """What the flight does over the ground: height above ground on camera legs and anywhere after the take-off."""

    lowest_survey_m: float
    highest_survey_m: float
    lowest_m: float
    ground_range_m: tuple[float, float]
    """Lowest and highest ground below the flight, above the model's zero."""
    waypoints_added: int


def on_flat_ground(plan: SurveyPlan) -> SurveyPlan:
    """Return the plan with the warning that it knows nothing of the terrain."""
    return plan if any(_FLAT in w for w in plan.warnings) else replace(plan, warnings=(*plan.warnings, FLAT_GROUND))


def by_the_vehicles_terrain(plan: SurveyPlan) -> SurveyPlan:
    """Return a plan whose heights are above the ground as the vehicle itself knows it; no model is asked here."""
    if plan.frame is not AltitudeFrame.RELATIVE:
        raise UsageError(
            f"only a plan above the take-off place can be bent to the ground, not one that is {plan.frame}"
        )
    kept = tuple(w for w in plan.warnings if _FLAT not in w)
    return replace(plan, frame=AltitudeFrame.TERRAIN, warnings=(*kept, _VEHICLES_TERRAIN))


def follow_terrain(
    plan: SurveyPlan, ground: Ground, settings: FollowSettings, frame: AltitudeFrame = AltitudeFrame.RELATIVE
) -> tuple[SurveyPlan, TerrainReport]:
    """Return a plan whose heights above the take-off place have become heights above the ground below.

    ``plan`` is over flat ground (RELATIVE). Waypoints are added where the ground asks for it, and only there. The
    result's frame is ``frame``; with TERRAIN the waypoints stay as they are, since the vehicle follows by itself.
    Raises ``DataError`` where an elevation is not known: it is never taken as 0.
    """
    if plan.frame is not AltitudeFrame.RELATIVE:
        raise UsageError(
            f"only a plan above the take-off place can be bent to the ground, not one that is {plan.frame}"
        )
    home = _home(plan)
    home_m = float(_known(ground, np.array([home]), "the take-off place")[0])
    bent = [_bend(sortie, ground, settings) for sortie in plan.sorties]
    shift_m = _shift_to_amsl(ground, home, settings, needed=frame is AltitudeFrame.AMSL)
    if frame is AltitudeFrame.TERRAIN:
        sorties = plan.sorties
    else:
        # The profiles are above the model's zero.
        zero = home_m if frame is AltitudeFrame.RELATIVE else -(shift_m or 0.0)
        sorties = tuple(_with_zero(b.sortie, zero) for b in bent)
    lowest, highest = min(b.survey_low for b in bent), max(b.survey_high for b in bent)
    added = sum(len(s.waypoints) for s in sorties) - sum(len(s.waypoints) for s in plan.sorties)
    report = TerrainReport(
        lowest,
        highest,
        min(b.low for b in bent),
        (min(b.ground[0] for b in bent), max(b.ground[1] for b in bent)),
        added,
    )
    warnings = [w for w in plan.warnings if _FLAT not in w] + _warnings(plan, ground, settings, frame, report)
    result = replace(
        plan,
        frame=frame,
        sorties=sorties,
        home=home,
        home_alt_amsl_m=None if shift_m is None else round(home_m + shift_m, 2),
        warnings=tuple(warnings),
    )
    return result, report


@dataclass(frozen=True, slots=True)
class _Bent:
    sortie: Sortie
    survey_low: float
    survey_high: float
    low: float
    ground: tuple[float, float]


def _bend(sortie: Sortie, ground: Ground, settings: FollowSettings) -> _Bent:
    """The sortie with altitudes above the model's zero."""
    waypoints = sortie.waypoints
    frame = LocalFrame.about(waypoints[0].lat_deg, waypoints[0].lon_deg)
    xy = frame.to_xy([(w.lat_deg, w.lon_deg) for w in waypoints])
    legs = np.hypot(*np.diff(xy, axis=0).T)
    spacing = max(ground.cell_m / 2.0, 1.0, float(legs.sum()) / _MOST_SAMPLES)
    counts = np.maximum(np.ceil(legs / spacing).astype(int), 1)
    # samples: every leg's start and its inner points, then the last waypoint
    leg = np.append(np.repeat(np.arange(len(legs)), counts), len(legs) - 1 if len(legs) else 0)
    share = np.append(np.concatenate([np.arange(n) / n for n in counts]) if len(legs) else np.zeros(0), 1.0)
    first = np.append(np.concatenate(([0], np.cumsum(counts)[:-1])), int(counts.sum())).astype(int)
    if len(legs) == 0:
        raise DataError("a flight of one waypoint cannot follow the terrain")
    step = np.diff(xy, axis=0)
    at = xy[leg] + share[:, None] * step[leg]
    along = np.concatenate(([0.0], np.cumsum(legs)))[leg] + share * legs[leg]
    floor = _highest_beside(ground, frame, at, step[leg] / np.maximum(legs[leg], 1e-9)[:, None], settings.beside_m)
    above = np.array([w.alt_m for w in waypoints])
    # What is asked for above ground changes linearly along a leg, as the flat plan flies it.
    wanted = floor + above[leg] + share * (above[leg + 1] - above[leg])
    speeds = _speeds(waypoints)[leg[:-1]]
    height = flyable(along, wanted, settings.climb_m_s / speeds, settings.descent_m_s / speeds)
    for sample, waypoint in zip(first, waypoints, strict=True):
        if waypoint.role is WaypointRole.LAND:
            height[sample] = wanted[sample]  # comes down on the spot
    made: list[Waypoint] = []
    flown = np.empty(len(height))
    for i in range(len(legs)):
        samples = np.arange(first[i], first[i + 1] + 1)
        kept = samples[fewest(along[samples], height[samples], settings.tolerance_m)]
        flown[samples] = np.interp(along[samples], along[kept], height[kept])
        places = frame.to_lat_lon(at[kept])
        for j, sample in enumerate(kept[:-1]):
            made.append(_placed(waypoints, i, j, places[j], float(height[sample])))
    made.append(replace(waypoints[-1], alt_m=float(height[-1])))
    clear = flown - floor
    camera = np.array([w.trigger is not None for w in waypoints])[leg]
    airborne = np.array([w.role is not WaypointRole.LAND for w in waypoints])[np.minimum(leg + (share > 0), len(legs))]
    survey = clear[camera] if camera.any() else clear[airborne]
    return _Bent(
        replace(sortie, waypoints=tuple(made)),
        float(survey.min()),
        float(survey.max()),
        float(clear[airborne].min()),
        (float(floor.min()), float(floor.max())),
    )


def _placed(waypoints: tuple[Waypoint, ...], leg: int, nth: int, place: FloatArray, height_m: float) -> Waypoint:
    """The leg's first waypoint at its height, or a new one on the way that changes nothing else."""
    start = waypoints[leg]
    if nth == 0:
        return replace(start, alt_m=height_m)
    trigger = start.trigger if start.trigger is not None and not start.trigger.hover else None
    role = start.role
    if role is WaypointRole.TAKEOFF:
        role = WaypointRole.TRANSIT
    elif role is WaypointRole.SURVEY and trigger is None:
        role = WaypointRole.TURN
    return Waypoint(float(place[0]), float(place[1]), height_m, role, trigger, heading_deg=start.heading_deg)


def _highest_beside(
    ground: Ground, frame: LocalFrame, at: FloatArray, direction: FloatArray, beside_m: float
) -> FloatArray:
    """The highest ground at each sample and to both sides of it."""
    side = np.column_stack((direction[:, 1], -direction[:, 0])) * beside_m
    found = [_known(ground, frame.to_lat_lon(at), "the flight")]
    if beside_m > 0:
        for shift in (side, -side):
            values = ground.elevation_m(frame.to_lat_lon(at + shift))
            found.append(np.where(np.isfinite(values), values, found[0]))  # beyond the model's edge: its edge
    return np.max(found, axis=0)


def _known(ground: Ground, lat_lon: FloatArray, what: str) -> FloatArray:
    values = ground.elevation_m(lat_lon)
    missing = ~np.isfinite(values)
    if missing.any():
        lat, lon = lat_lon[int(np.argmax(missing))]
        raise DataError(
            f"the elevation model says nothing of {100 * missing.mean():.0f} % of {what}, first at {lat:.6f}, "
            f"{lon:.6f}: give one that reaches there and has no holes"
        )
    return values


def _speeds(waypoints: tuple[Waypoint, ...]) -> FloatArray:
    """The speed on the way on from each waypoint."""
    speeds, speed = [], next((w.speed_m_s for w in waypoints if w.speed_m_s), _DEFAULT_SPEED_M_S)
    for waypoint in waypoints:
        speed = waypoint.speed_m_s or speed
        speeds.append(speed)
    return np.array(speeds)


def _home(plan: SurveyPlan) -> tuple[float, float]:
    if plan.home is not None:
        return plan.home
    first = plan.sorties[0].waypoints[0]
    return first.lat_deg, first.lon_deg


def _shift_to_amsl(
    ground: Ground, home: tuple[float, float], settings: FollowSettings, *, needed: bool
) -> float | None:
    """Metres to add to the model's heights to get heights above the sea; None where that is not known nor needed."""
    if ground.vertical is not VerticalDatum.ELLIPSOID:
        return 0.0
    if settings.geoid_m is not None:
        return -settings.geoid_m
    try:
        return -float(geoid_m(np.array([home]))[0])
    except DataError:
        if needed:
            raise
        return None


def _with_zero(sortie: Sortie, zero_m: float) -> Sortie:
    return replace(sortie, waypoints=tuple(replace(w, alt_m=round(w.alt_m - zero_m, 2)) for w in sortie.waypoints))


def _warnings(
    plan: SurveyPlan, ground: Ground, settings: FollowSettings, frame: AltitudeFrame, report: TerrainReport
) -> list[str]:
    said = []
    if not ground.stated:
        said.append(
            "the elevation model does not say what its heights are above: mean sea level is assumed (--dem-vertical)"
        )
    if frame is AltitudeFrame.TERRAIN:
        said.append(_VEHICLES_TERRAIN)
    asked = max((w.alt_m for s in plan.sorties for w in s.waypoints if w.trigger is not None), default=None)
    if asked is not None and report.highest_survey_m > asked + settings.tolerance_m + 0.5:
        said.append(
            f"climb and descent limits keep the camera up to {report.highest_survey_m:.0f} m above ground where "
            f"{asked:.0f} m were asked for: fly slower, or across the slope less steeply (--angle)"
        )
    return said
