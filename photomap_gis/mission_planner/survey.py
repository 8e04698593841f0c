"""From an area and a camera to flights that are sure to see all of it: lanes, gaps, order, sorties, proof."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import AltitudeFrame, CameraTrigger, Sortie, SurveyPlan
from photomap_gis.mission_planner.area import SurveyArea, geo_polygons
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.free_space import FreeSpace
from photomap_gis.mission_planner.lanes import Lane, candidate_headings, corridor_lanes, estimate_s, sweep
from photomap_gis.mission_planner.optics import Optics, Spacing, SureFootprint, Tolerances, space, sure_footprint
from photomap_gis.mission_planner.proof import spots_for, uncovered
from photomap_gis.mission_planner.route import order_lanes
from photomap_gis.mission_planner.sorties import FlightStyle, fly, split

FloatArray = npt.NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MOST_LANES = 20_000
_MOST_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """How to survey; heights are above the take-off place, angles clockwise from north."""

    optics: Optics
    height_m: float
    front_overlap: float = 0.8
    side_overlap: float = 0.65
    tolerances: Tolerances = field(default_factory=Tolerances)
    model: FlightModel = field(default_factory=FlightModel)
    angle_deg: float | None = None
    crosshatch: bool = False
    inset: bool = False
    overshoot_m: float = 0.0
    lead_in_m: float = 0.0
    trigger: str = "distance"
    trigger_in_turns: bool = False
    fixed_heading: bool = False
    """The nose stays where it is: at ``nose_deg``, or along the first lane where that is None."""
    nose_deg: float | None = None
    transit_height_m: float | None = None
    endurance_s: float | None = None
    home: tuple[float, float] | None = None
    lands: bool = False
    avoid_margin_m: float = 2.0
    most_crab_deg: float = 30.0
    least_interval_s: float = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A plan with what drew it: lanes as they are flown, in local metres of ``area.frame``."""

    plan: SurveyPlan
    area: SurveyArea
    lanes: tuple[Lane, ...]
    spacing: Spacing
    sure: SureFootprint
    headings_deg: tuple[float, ...]
    ground_speed_m_s: float
    left: BaseGeometry


def plan_survey(
    area: SurveyArea, settings: SurveySettings, on_progress: Progress = lambda stage, done, total: None
) -> Survey:
    """Return the flights over ``area``. Raises ``UsageError`` where the settings cannot be flown."""
    s, warnings = settings, list(area.warnings)
    if not (math.isfinite(s.height_m) and 1.0 <= s.height_m <= 10_000.0):
        raise UsageError(f"the height comes to {s.height_m:g} m: 1 m to 10 km can be planned")
    free = FreeSpace(area.avoid, margin_m=s.avoid_margin_m, inside=area.area if s.inset else None)
    home = _given_home(area, s, free, warnings)
    sure = sure_footprint(s.optics, s.height_m, s.tolerances)
    spacing = _spaced(s, sure)
    model = _limited(s, spacing)
    lanes, headings, sure, spacing = _all_lanes(area, s, model, free, home, on_progress)
    model = _limited(s, spacing)
    if len(lanes) > MOST_LANES:
        raise UsageError(f"the survey needs {len(lanes)} lanes: fly higher (--height, --gsd) or plan parts of the area")
    left = uncovered(area.target, lanes, spacing, sure)
    if not left.is_empty:
        lanes = [*lanes, *spots_for(left, free, sure, headings[0])]
    if home is None:
        home = free.nearest(lanes[0].xy[0] if lanes else area.target.representative_point().coords[0])
        warnings.append("no --home was given: take-off is planned at the survey's beginning")
    style = _style(s, spacing, model, headings)
    if s.transit_height_m is not None and s.transit_height_m < s.height_m:
        warnings.append(f"--transit-height is below the survey's height: {s.height_m:.0f} m is flown on the way too")
    for number in range(_MOST_ROUNDS):
        on_progress("sorties", number, number + 1)
        bases, sorties, flown = _flights(area, lanes, home, free, model, style)
        left = uncovered(area.target, flown, spacing, sure)
        # Which shot of a lane comes first hangs on the way it is flown: a lane cut short may show a little less.
        more = [] if left.is_empty else spots_for(left, free, sure, headings[0])
        if not more or number == _MOST_ROUNDS - 1:
            break
        lanes = [*lanes, *more]
    on_progress("sorties", 1, 1)
    if not sorties:
        raise UsageError(
            "there is no place to see the area from: the margins leave no room to fly; take a smaller "
            "--avoid-margin, or leave --inset away"
        )
    if bases > 1:
        warnings.append(
            "parts of the area cannot be reached from home without crossing a no-fly zone or leaving the polygon: "
            "they have a take-off of their own"
        )
    share = max(0.0, 1.0 - left.area / area.target.area)
    if not left.is_empty:
        warnings.append(f"{left.area:.1f} m² cannot be seen for sure from where the vehicle may fly (see uncovered)")
    warnings.append("flat ground is assumed: heights are above the take-off place; --dem FILE follows the terrain")
    if s.front_overlap + 0.01 < spacing.front_overlap or s.side_overlap + 0.01 < spacing.side_overlap:
        warnings.append("the tolerances ask for more overlap than was wished: pictures and lanes lie closer")
    if model.most_ground_speed_m_s < s.model.speed_m_s:
        warnings.append(
            f"the speed is limited to {model.most_ground_speed_m_s:.1f} m/s by blur or the camera's interval"
        )
    lat, lon = area.frame.to_lat_lon(home)[0]
    plan = SurveyPlan(
        area=geo_polygons(area.frame, area.area),
        avoid=geo_polygons(area.frame, area.avoid),
        frame=AltitudeFrame.RELATIVE,
        sorties=tuple(sorties),
        covered_share=share,
        uncovered=geo_polygons(area.frame, left),
        gsd_m_per_px=s.optics.gsd_m_per_px(s.height_m),
        pattern="corridor" if area.corridor else "crosshatch" if s.crosshatch else "survey",
        home=(round(float(lat), 9), round(float(lon), 9)),
        warnings=tuple(warnings),
    )
    speed = min(model.speed_m_s, model.most_ground_speed_m_s)
    degrees = tuple(round(math.degrees(h) % 360.0, 2) for h in headings)
    return Survey(plan, area, tuple(flown), spacing, sure, degrees, speed, left)


def _flights(
    area: SurveyArea, lanes: Sequence[Lane], home: FloatArray, free: FreeSpace, model: FlightModel, style: FlightStyle
) -> tuple[int, list[Sortie], list[Lane]]:
    """How many places to take off from, the sorties, and the lanes as they are flown."""
    sorties: list[Sortie] = []
    flown: list[Lane] = []
    groups = _reachable(lanes, home, free)
    for base, group in groups:
        for part in split(order_lanes(group, base, free, model), base, free, model, style):
            flown += part
            sorties.append(fly(part, base, area.frame, free, model, style))
    return len(groups), sorties, flown


def _given_home(area: SurveyArea, s: SurveySettings, free: FreeSpace, warnings: list[str]) -> FloatArray | None:
    if s.home is None:
        return None
    home = area.frame.to_xy([s.home])[0]
    if not np.hypot(*home) < 150_000.0:
        raise UsageError("--home is more than 150 km from the area: latitude comes first")
    if area.avoid.intersects(shapely.Point(home)):
        raise UsageError("--home lies in a no-fly zone: move it, or the zone")
    if not free.holds(home)[0]:
        moved = free.nearest(home)
        words = "outside the area, which --inset never leaves" if s.inset else "within the margin of a no-fly zone"
        warnings.append(f"--home is {words}: take-off is planned {np.hypot(*(moved - home)):.1f} m from it")
        return moved
    return home


def _spaced(s: SurveySettings, sure: SureFootprint, noses_rad: Sequence[float] = (0.0,)) -> Spacing:
    made = space(
        s.optics, s.height_m, sure, front_overlap=s.front_overlap, side_overlap=s.side_overlap, noses_rad=noses_rad
    )
    step = math.floor(made.step_m * 100.0) / 100.0  # as files and autopilots keep it
    if step < 0.05:
        raise UsageError("pictures would lie less than 5 cm apart: fly higher, or take less --front-overlap")
    return replace(made, step_m=step)


def _limited(s: SurveySettings, spacing: Spacing) -> FlightModel:
    interval = math.inf if s.least_interval_s <= 0 or s.trigger == "hover" else spacing.step_m / s.least_interval_s
    return replace(s.model, most_ground_speed_m_s=min(s.model.most_ground_speed_m_s, interval))


def _nose_rad(s: SurveySettings, first_rad: float) -> float:
    """Where a nose that stays where it is points."""
    return first_rad if s.nose_deg is None else math.radians(s.nose_deg)


def _style(s: SurveySettings, spacing: Spacing, model: FlightModel, headings: Sequence[float]) -> FlightStyle:
    if s.trigger == "hover":
        trigger = CameraTrigger(hover=True)
    elif s.trigger == "time":
        fastest = min(model.speed_m_s + model.wind_m_s, model.most_ground_speed_m_s)
        trigger = CameraTrigger(interval_s=max(0.1, math.floor(spacing.step_m / fastest * 10.0) / 10.0))
    else:
        trigger = CameraTrigger(distance_m=spacing.step_m)
    transit = max(s.height_m, s.transit_height_m or 0.0)
    return FlightStyle(
        s.height_m, transit, trigger, spacing.step_m, s.overshoot_m, s.lead_in_m, s.trigger_in_turns,
        round(math.degrees(_nose_rad(s, headings[0])) % 360.0, 6) if s.fixed_heading else None, s.lands, s.endurance_s,
    )  # fmt: skip


def _all_lanes(
    area: SurveyArea,
    s: SurveySettings,
    model: FlightModel,
    free: FreeSpace,
    home: FloatArray | None,
    on_progress: Progress,
) -> tuple[list[Lane], list[float], SureFootprint, Spacing]:
    """The lanes of every part of the area, their headings, and the footprint and spacing that hold for all of them."""
    if area.corridor:
        ways = np.concatenate([_ways(np.asarray(line.coords)) for line in area.corridor])
        if s.fixed_heading:
            noses = _apart(_nose_rad(s, float(ways[0])) - ways)
            sure = sure_footprint(s.optics, s.height_m, s.tolerances, noses_rad=noses)
        else:
            noses = [0.0]
            sure = sure_footprint(s.optics, s.height_m, s.tolerances, crab_deg=_most_crab(model))
        spacing = _spaced(s, sure, noses)
        made = [lane for line in area.corridor for lane in corridor_lanes(line, area.corridor_width_m, spacing, sure)]
        return _clipped(made, free), [float(ways[0])], sure, spacing
    width = s.optics.footprint_m(s.height_m)[0]
    groups = _groups(area.target, width)
    plain = sure_footprint(s.optics, s.height_m, s.tolerances)
    rough = _spaced(s, plain)
    headings: list[float] = []
    for number, group in enumerate(groups):
        on_progress("sweep angle", number, len(groups))
        if s.angle_deg is not None:
            headings.append(math.radians(s.angle_deg))
        elif (s.fixed_heading or len(groups) > 40) and headings:
            headings.append(headings[0])
        else:
            headings.append(_best_heading(group, s, model, free, home, plain, rough))
    on_progress("sweep angle", len(groups), len(groups))
    turns = [0.0, math.pi / 2] if s.crosshatch else [0.0]
    noses = _apart(np.array([_nose_rad(s, headings[0]) - h - t for h in headings for t in turns]))
    crab = 0.0 if s.fixed_heading else max(model.crab_deg(h + t) for h in headings for t in turns)
    if crab > s.most_crab_deg and s.angle_deg is not None:
        raise UsageError(
            f"at {s.angle_deg:g} degrees the wind turns the nose by {crab:.0f} degrees: leave --angle away, fly "
            "faster, or raise --max-crab-deg"
        )
    if s.fixed_heading:
        sure = sure_footprint(s.optics, s.height_m, s.tolerances, noses_rad=noses)
        spacing = _spaced(s, sure, noses)
    else:
        sure = plain if crab < 0.01 else sure_footprint(s.optics, s.height_m, s.tolerances, crab_deg=crab)
        spacing = rough if sure is plain else _spaced(s, sure)
    gap = _merge_gap(model)
    lanes = [
        lane
        for turn in turns
        for heading, group in zip(headings, groups, strict=True)
        for lane in sweep(group, heading + turn, spacing, sure, merge_gap_m=gap)
    ]
    return _clipped(lanes, free), headings, sure, spacing


def _ways(xy: FloatArray) -> FloatArray:
    """The headings of a path's legs, and those that cut its sharp corners, as lanes beside it do."""
    legs = np.diff(xy, axis=0)
    legs = legs / np.maximum(np.hypot(*legs.T), 1e-9)[:, None]
    cuts = (legs[1:] + legs[:-1])[np.einsum("ij,ij->i", legs[1:], legs[:-1]) < 0.0]
    every = np.concatenate([legs, cuts])
    return np.asarray(np.arctan2(every[:, 0], every[:, 1]))


def _apart(noses_rad: FloatArray) -> list[float]:
    """The angles that are different ones to a picture, which looks the same both ways round."""
    return [math.radians(d) for d in sorted({round(math.degrees(n) % 180.0, 2) % 180.0 for n in noses_rad})]


def _most_crab(model: FlightModel) -> float:
    return math.degrees(math.asin(model.wind_m_s / model.speed_m_s))


def _merge_gap(model: FlightModel) -> float:
    """Flying on over what need not be seen beats turning back to it up to about two stops."""
    return 2.0 * model.speed_m_s**2 / model.accel_m_s2


def _clipped(lanes: Sequence[Lane], free: FreeSpace) -> list[Lane]:
    if free.is_open:
        return list(lanes)
    pieces = [(lane, piece) for lane in lanes for piece in free.clip(shapely.LineString(lane.xy))]
    return [
        Lane(shapely.get_coordinates(piece), nose_rad=lane.nose_rad) for lane, piece in pieces if piece.length > 0.05
    ]


def _groups(target: BaseGeometry, width_m: float) -> list[BaseGeometry]:
    """The parts of the target, those that one picture spans together."""
    parts = shapely.get_parts(target)
    if len(parts) == 1:
        return [target]
    near = shapely.get_parts(shapely.union_all(shapely.buffer(parts, width_m / 2.0, quad_segs=2)))
    homes = shapely.STRtree(near).query(shapely.point_on_surface(parts), predicate="within")
    found = [parts[homes[0][homes[1] == k]] for k in range(len(near))]
    return [shapely.multipolygons(list(f)) for f in found if len(f)]


def _best_heading(
    target: BaseGeometry,
    s: SurveySettings,
    model: FlightModel,
    free: FreeSpace,
    home: FloatArray | None,
    sure: SureFootprint,
    spacing: Spacing,
) -> float:
    """The heading whose flight is the shortest: all roughly, the promising ones to the end."""
    rings = shapely.get_parts(shapely.boundary(target))
    edges = np.concatenate([np.hstack([p[:-1], p[1:]]) for p in map(shapely.get_coordinates, rings)])
    turn_s = 2.0 * math.sqrt(spacing.lane_m / model.accel_m_s2) + model.speed_m_s / model.accel_m_s2
    rough = []
    for heading in candidate_headings(target):
        if not s.fixed_heading and model.crab_deg(heading) > s.most_crab_deg:
            continue
        if s.fixed_heading:
            sure, spacing = _turned_pictures(s, float(heading))
        along = np.array([math.sin(heading), math.cos(heading)])
        speeds = [float(v) for v in model.ground_speed(np.stack([along, -along]), survey=True)]
        rough.append((estimate_s(edges, float(heading), spacing, speeds_m_s=speeds, turn_s=turn_s), float(heading)))
    if not rough:  # the wind lets only lanes along it be flown
        return math.atan2(model.wind_east_m_s, model.wind_north_m_s) % math.pi
    rough.sort()
    size = len(edges) * max(1.0, math.sqrt(target.area) / spacing.lane_m)
    tries = 12 if size < 2_000 else 6 if size < 10_000 else 2
    exact = []
    for _, heading in rough[:tries]:
        if s.fixed_heading:
            sure, spacing = _turned_pictures(s, heading)
        lanes = _clipped(sweep(target, heading, spacing, sure, merge_gap_m=_merge_gap(model)), free)
        if lanes:
            exact.append((_tour_s(lanes, home, free, s, model), heading))
    return min(exact)[1] if exact else rough[0][1]


def _turned_pictures(s: SurveySettings, heading_rad: float) -> tuple[SureFootprint, Spacing]:
    """What lanes of a heading are sure to show, and how they lie, where the nose does not turn with them."""
    noses = _apart(np.array([_nose_rad(s, heading_rad) - heading_rad]))
    sure = sure_footprint(s.optics, s.height_m, s.tolerances, noses_rad=noses)
    return sure, _spaced(s, sure, noses)


def _tour_s(
    lanes: list[Lane], home: FloatArray | None, free: FreeSpace, s: SurveySettings, model: FlightModel
) -> float:
    """The seconds of a tour without its take-offs; blocked hops as the crow flies, which all headings share."""
    if len(lanes) > (400 if free.is_open else 120):
        xy = np.concatenate([lane.xy if i % 2 == 0 else lane.xy[::-1] for i, lane in enumerate(lanes)])
        return model.path_s(xy)
    start = lanes[0].xy[0] if home is None else home
    xy = np.concatenate([start[None], *(lane.xy for lane in order_lanes(lanes, start, free, model)), start[None]])
    return model.path_s(xy)


def _reachable(lanes: Sequence[Lane], home: FloatArray, free: FreeSpace) -> list[tuple[FloatArray, list[Lane]]]:
    """The lanes by where one must take off to reach them: home, then places of their own."""
    groups: list[tuple[FloatArray, list[Lane]]] = []
    rest, base = list(lanes), home
    while rest:
        if free.is_open:
            return [*groups, (base, rest)]
        reached = [free.path(base, lane.xy[0]) is not None for lane in rest]
        inside = [lane for lane, ok in zip(rest, reached, strict=True) if ok]
        rest = [lane for lane, ok in zip(rest, reached, strict=True) if not ok]
        if inside:
            groups.append((base, inside))
        elif groups or not np.array_equal(base, home):
            rest = rest[1:]  # a place that even its own lane cannot be reached from; the proof will tell
        if rest:
            base = rest[0].xy[0]
    return groups
