"""From measurements to placements: the graph is built, solved, and its result kept with every frame's status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import FixLag, PointObservation
from photomap_gis.georef import accuracy, observe
from photomap_gis.pipeline.control import control_observations
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.ties import reference_points, reference_warnings
from photomap_gis.slam import (
    GraphBuilder,
    Leaning,
    bend_of,
    estimate_tilts,
    leans,
    level_from_tilt,
    placements,
    slopes_of_frames,
    solve,
)
from photomap_gis.store import (
    Mission,
    PreparedFrame,
    RegistrationRecord,
)

FLAT = (0.0, 0.0)
UNREFINED_SIGMA_S = 0.5
"""Of the shift of a whole track that the solver could not refine."""


def solve_mission(
    mission: Mission,
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    measurements: Measurements,
    settings: MapSettings,
    *,
    with_control: bool = True,
    shifts_s: Mapping[int, float] | None = None,
) -> Solved:
    """Build the graph of all accepted registrations and observations, solve it, and say what became of every frame.

    Without ``with_control`` ground control and existing imagery are left out, and a map that only they place stays
    relative. ``shifts_s`` are the shifts of whole tracks, by flight, under which ``frames`` have their places;
    ``views`` are those that the frames were registered by.
    """
    shifts_s = shifts_s or {}
    prepared, map_frame = measurements.prepared, mission.header.map_frame
    if not with_control and all(f.fix is None for f in frames):
        map_frame = MapFrame(None)
    usable = [f for f in frames if prepared[f.index].usable]
    leanings = leanings_of({f.index: f for f in usable}, measurements.accepted, prepared)
    builder = graph_builder(
        usable, measurements.accepted, prepared, map_frame, leanings, antenna_offset_m=settings.antenna_offset_m
    )
    graph = builder.snapshot()
    slopes = slopes_of_frames(graph.edges)
    tilts = {f: leaning.tilt_rad for f, leaning in leanings.items()}
    views = {f: settled_view(view, tilts.get(f, FLAT), slopes.get(f, FLAT)) for f, view in views.items()}
    unused: list[str] = []
    if with_control:
        unused = observe_control(builder, mission, usable, views, map_frame, measurements.accepted)
        graph = builder.snapshot()
    if not graph.georeferenced:
        map_frame = MapFrame(None)  # what placed the map was taken away again
    solution = solve(graph, find_lag=settings.ingest.track_offset_s is None)
    predicted = accuracy(solution, graph)
    trajectory = placements(solution, graph, usable, views, max_off_nadir_rad=settings.max_off_nadir_rad)
    placed = {p.frame: p.status for p in trajectory.placements}
    statuses, reasons = {}, {}
    tie = "GPS" if graph.positions or map_frame.crs_wkt is None else "two control points in its piece"
    for ref in frames:
        verdict = prepared[ref.index]
        if not verdict.usable:
            statuses[ref.index], reasons[ref.index] = FrameStatus.ERROR_FRAME, verdict.reason or "unusable"
        elif ref.index in placed:
            statuses[ref.index] = placed[ref.index]
        elif ref.attitude is not None and ref.attitude.off_nadir_rad > settings.max_off_nadir_rad:
            statuses[ref.index] = FrameStatus.OBLIQUE
        else:
            statuses[ref.index], reasons[ref.index] = FrameStatus.UNPLACED, f"no {tie} and no registration"
        if statuses[ref.index] is FrameStatus.GPS_ONLY:
            reasons[ref.index] = "no registration to a neighbour could be trusted"
        elif statuses[ref.index] is FrameStatus.OBLIQUE:
            reasons[ref.index] = f"optical axis more than {settings.max_off_nadir_deg:g} degrees off nadir"
    return Solved(
        tuple(frames),
        map_frame,
        trajectory,
        statuses,
        reasons,
        solution.fit_to_gps_rms_m,
        None if predicted is None else predicted.predicted_ce90_m,
        (
            *_warnings(frames, map_frame, settings),
            *unused,
            *reference_warnings(mission.references if with_control else ()),
        ),
        solution,
        points=graph.points,
        fix_lags=whole_lags(solution.fix_lags, shifts_s),
        track_shifts_s=shifts_s,
    )


def graph_builder(
    usable: Sequence[FrameRef],
    accepted: Sequence[RegistrationRecord],
    prepared: Mapping[int, PreparedFrame],
    map_frame: MapFrame,
    leanings: Mapping[int, Leaning],
    *,
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> GraphBuilder:
    """Return the builder with the graph of accepted registrations and of what fixes, heights and attitudes say."""
    builder = GraphBuilder()
    for ref in usable:
        builder.add_frame(ref.index)
    for r in accepted:
        builder.add_registration(
            r.registration, prepared[r.a].T_plane_work, prepared[r.b].T_plane_work, kind=r.kind,
            leaning=(leanings[r.a], leanings[r.b]) if {r.a, r.b} <= leanings.keys() else None,
        )  # fmt: skip
    if map_frame.crs_wkt is not None:
        seen = observe(usable, map_frame, antenna_offset_m=antenna_offset_m)
        builder.observe(seen.positions, seen.scales, seen.headings)
    return builder


def observe_control(
    builder: GraphBuilder,
    mission: Mission,
    usable: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    map_frame: MapFrame,
    accepted: Sequence[RegistrationRecord],
) -> list[str]:
    """Add what the mission's known points and its ties to existing imagery say in these views.

    Returns what a user should know of points that could not be used.
    """
    control = mission.load_control()
    given = bool(control.points or control.picks)
    if map_frame.crs_wkt is None:
        words = "the control points cannot place the map: two or more are needed that its pictures show"
        return [words] if given else []
    points: list[PointObservation] = []
    unused: list[str] = []
    if given:
        lenses = {f.index for f in usable if f.camera is not None and f.camera.focal_px is not None}
        tried = {f for r in accepted for f in (r.a, r.b)} & lenses
        points, unused = control_observations(control, usable, views, map_frame, tried)
    # control points come first: what the solver puts aside is counted in this order
    builder.observe_points([*points, *reference_points(mission.references, {f.index: views[f.index] for f in usable})])
    return unused


def leanings_of(
    refs: Mapping[int, FrameRef], accepted: Sequence[RegistrationRecord], prepared: Mapping[int, PreparedFrame]
) -> dict[int, Leaning]:
    """Return how the frames' planes must be levelled still, flight by flight.

    Where a flight's pairs bend as no slope explains, its cameras leaned and did not say so (or wrongly): their tilts
    are estimated. Frames whose focal length is unknown are left out.
    """
    found: dict[int, Leaning] = {}
    focal = {i: f.camera.focal_px for i, f in refs.items() if f.camera is not None and f.camera.focal_px is not None}
    for flight in sorted({refs[i].flight for i in focal}):
        frames = {i for i in focal if refs[i].flight == flight}
        told = (
            bend_of(r.registration, prepared[r.a].T_plane_work, prepared[r.b].T_plane_work, (focal[r.a], focal[r.b]))
            for r in accepted
            if {r.a, r.b} <= frames
        )
        bends = [b for b in told if b is not None]
        tilts = estimate_tilts(bends) if leans(bends) else {}
        found |= {i: Leaning(focal[i], tilts.get(i, FLAT)) for i in frames}
    return found


def settled_view(view: PlaneView, tilt_rad: tuple[float, float], slope: tuple[float, float]) -> PlaneView:
    """Return a frame's view with what the solution found out of tilt and ground."""
    if tilt_rad == FLAT and slope == FLAT:
        return view
    return replace(view, R_level_camera=level_from_tilt(tilt_rad) @ view.R_level_camera, ground_slope=slope)


def whole_lags(fine: Mapping[int, FixLag], shifts_s: Mapping[int, float]) -> dict[int, FixLag]:
    """Return each flight's lag: what its whole track was shifted by, and what the solver found after that."""
    lags = dict(fine)
    for flight, shift in shifts_s.items():
        left = lags.get(flight, FixLag(0.0, UNREFINED_SIGMA_S))
        lags[flight] = FixLag(shift + left.lag_s, left.sigma_s)
    return lags


def lag_warnings(mission: Mission, lags: Mapping[int, FixLag]) -> list[str]:
    """Return what a user should know of clocks that were found to be off."""
    names = {f.id: f.name for f in mission.flights}
    words = (
        "{}: positions were {:+.2f} s older than the pictures by the motion seen (sigma {:.2f} s); corrected; "
        "--track-offset SECONDS sets it"
    )
    return [
        words.format(names.get(flight, flight), lag.lag_s, lag.sigma_s)
        for flight, lag in sorted(lags.items())
        if lag.believed
    ]


def _warnings(frames: Sequence[FrameRef], map_frame: MapFrame, settings: MapSettings) -> tuple[str, ...]:
    found = []
    blind = sum(f.fix is not None and f.attitude is None for f in frames)
    if any(settings.antenna_offset_m) and blind:
        found.append(
            f"--antenna-offset: {blind} frames tell no heading; their positions are taken as the antenna gave them"
        )
    if map_frame.crs_wkt is None:
        found.append(
            "no positions: the map is relative, not georeferenced; give --track FILE or --gcp FILE, put the .SRT "
            "beside the video, or pick two places by 'photomap georeference MISSION --pick X,Y=LAT,LON'"
        )
    if any(f.problem is None and (f.camera is None or f.camera.focal_px is None) for f in frames):
        found.append(
            "the lens is unknown: scale comes from GPS against registration, tilt cannot be levelled; "
            "give --fov-deg or --focal-35mm"
        )
    return tuple(found)
