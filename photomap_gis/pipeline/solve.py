"""From measurements to placements: the graph is built, solved, and its result kept with every frame's status."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import TypeAdapter

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import CameraToMap, FramePlacement, PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import FixLag, PointObservation, Solution, Trajectory
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.export.crs import crs_label
from photomap_gis.georef import accuracy, observe, plane_view, resolve_crs
from photomap_gis.pipeline.control import ControlResult, control_observations
from photomap_gis.pipeline.measure import Cluster, Measurements
from photomap_gis.pipeline.settings import MapSettings
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
    GroundRecord,
    LensRecord,
    Mission,
    PlacementRecord,
    PosedRecord,
    PreparedFrame,
    RegistrationRecord,
    SolutionRecord,
)

FLAT = (0.0, 0.0)
_RESULTS: TypeAdapter[tuple[ControlResult, ...]] = TypeAdapter(tuple[ControlResult, ...])
UNREFINED_SIGMA_S = 0.5
"""Of the shift of a whole track that the solver could not refine."""
PASTED = (FrameStatus.REGISTERED, FrameStatus.GPS_ONLY)


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """One solution: what became of every frame, and where the placed ones lie.

    ``solution`` is the flat one as the solver left it, ``None`` where it was read from the mission; ``lenses`` say what
    the full solution found of them.
    """

    frames: tuple[FrameRef, ...]
    map_frame: MapFrame
    trajectory: Trajectory
    statuses: Mapping[int, FrameStatus]
    reasons: Mapping[int, str]
    fit_to_gps_rms_m: float | None = None
    predicted_ce90_m: float | None = None
    warnings: tuple[str, ...] = ()
    solution: Solution | None = None
    lenses: tuple[LensRecord, ...] = ()
    points: tuple[PointObservation, ...] = ()
    control: tuple[ControlResult, ...] = ()
    fix_lags: Mapping[int, FixLag] = field(default_factory=dict)
    track_shifts_s: Mapping[int, float] = field(default_factory=dict)

    @property
    def georeferenced(self) -> bool:
        """Whether the map has a place on Earth."""
        return self.map_frame.crs_wkt is not None

    def crs_name(self, asked: str | None = None) -> str | None:
        """Return the written map's CRS as people write it, e.g. EPSG:32614; ``None`` for a relative map.

        The work is done in metres true to scale; a CRS that was ``asked`` for and is not (degrees, Mercator) is warped
        to at the end.
        """
        if self.map_frame.crs_wkt is None:
            return None
        return crs_label(resolve_crs(asked) if asked else self.map_frame.crs_wkt)

    @property
    def segment_numbers(self) -> list[int]:
        """The segments that have something to paste, the largest first."""
        sizes = Counter(p.segment for p in self.trajectory.placements if p.status in PASTED)
        return [s for s, _ in sorted(sizes.items(), key=lambda item: (-item[1], item[0]))]

    @property
    def segments(self) -> int:
        """How many connected pieces of registered frames there are."""
        return len({p.segment for p in self.trajectory.placements if p.status is not FrameStatus.GPS_ONLY})

    @property
    def why_nothing(self) -> str:
        """What to tell a user none of whose frames can be pasted."""
        if self.georeferenced and all(f.fix is None for f in self.frames):
            return "no piece of the map has two control points of its own: give more by --gcp, or pick places on it"
        if any(s is FrameStatus.OBLIQUE for s in self.statuses.values()):
            return "every frame looks too far off the plumb line for a map: raise --max-off-nadir to paste them anyway"
        return (
            "no frame could be placed: no two frames could be registered and there is no GPS; "
            "fly with more overlap, or give --track FILE"
        )

    def count_by_status(self) -> dict[str, int]:
        """Return the number of frames of every status, 0 included."""
        counts = Counter(self.statuses.values())
        return {s.value: counts.get(s, 0) for s in FrameStatus}

    def count_reasons(self) -> dict[str, dict[str, int]]:
        """Return how often each reason was given, status by status."""
        found: defaultdict[str, Counter[str]] = defaultdict(Counter)
        for frame, status in self.statuses.items():
            if reason := self.reasons.get(frame):
                found[status.value][reason] += 1
        return {status: dict(counts.most_common(4)) for status, counts in found.items()}

    def clusters(self, views: Mapping[int, PlaneView]) -> list[Cluster]:
        """Return the placed frames by the map frame that they share: all of them, or a segment each without GPS."""
        groups: defaultdict[int, list[FramePlacement]] = defaultdict(list)
        for p in self.trajectory.placements:
            groups[0 if self.georeferenced else p.segment].append(p)
        found = []
        for group in groups.values():
            poses = {}
            for p in group:
                assert isinstance(p.camera_to_map, PlanePlacement)
                # Registrations are between the planes of ``views``; the solution may have levelled them further.
                origin = p.camera_to_map.view.to_plane(views[p.frame].to_pixel(np.zeros((1, 2))))[0]
                T = p.camera_to_map.T_map_plane @ Similarity2D.translation_of(*origin)
                poses[p.frame] = (T, p.pose_covariance)
            outlines = {f: plane_outline(views[f]) for f in poses}
            found.append(Cluster(poses, outlines, {p.frame: p.segment for p in group}))
        return found

    def track_lags(self, names: Mapping[int, str]) -> dict[str, dict[str, float | bool]]:
        """Return by flight how much older its positions were than its pictures, where its motion tells."""
        return {
            names.get(flight, str(flight)): {
                "lag_s": round(lag.lag_s, 3), "sigma_s": round(lag.sigma_s, 3), "corrected": lag.believed
            }
            for flight, lag in sorted(self.fix_lags.items())
        }  # fmt: skip

    def save(self, mission: Mission) -> None:
        """Keep the solution in the mission folder."""
        placed = {p.frame: p for p in self.trajectory.placements}

        def record(ref: FrameRef) -> PlacementRecord:
            status, reason = self.statuses[ref.index], self.reasons.get(ref.index, "")
            p = placed.get(ref.index)
            if p is None:
                return PlacementRecord(ref.index, status, reason)
            covariance, where = _row_by_row(p.pose_covariance), p.camera_to_map
            common = (ref.index, status, reason, p.segment, p.method)
            if isinstance(where, PosedPlacement):
                lens = where.camera.focal_px or 0.0, where.camera.k1
                centre, R = _row_by_row(where.centre_map), _row_by_row(where.R_map_camera)
                return PlacementRecord(*common, covariance=covariance, posed=PosedRecord(centre, R, *lens))
            assert isinstance(where, PlanePlacement)
            view, R = where.view, _row_by_row(where.view.R_level_camera)
            return PlacementRecord(*common, where.T_map_plane, covariance, R, view.ground_slope)

        summary = {
            "fit_to_gps_rms_m": self.fit_to_gps_rms_m,
            "predicted_ce90_m": self.predicted_ce90_m,
            "warnings": list(self.warnings),
            "control": _RESULTS.dump_python(self.control, mode="json"),
            "fix_lags": {str(flight): [lag.lag_s, lag.sigma_s] for flight, lag in self.fix_lags.items()},
            "track_shifts_s": {str(flight): shift for flight, shift in self.track_shifts_s.items()},
        }
        grounds = (p.camera_to_map.ground for p in placed.values() if isinstance(p.camera_to_map, PosedPlacement))
        ground = next(grounds, None)
        records = tuple(map(record, self.frames))
        kept = None if ground is None else GroundRecord.of(ground)
        mission.save_solution(SolutionRecord(self.trajectory.revision, records, summary, kept, self.lenses))

    @classmethod
    def load(cls, mission: Mission) -> Solved:
        """Return the newest solution of a mission; ``DataError`` where there is none."""
        kept = mission.load_solution()
        frames = tuple(mission.frames)
        refs = {f.index: f for f in frames}
        ground = HeightField.level() if kept.ground is None else kept.ground.height_field
        placed = tuple(
            FramePlacement(
                r.frame,
                refs[r.frame].width_px,
                refs[r.frame].height_px,
                where,
                r.covariance_matrix,
                r.status,
                r.segment or 0,
                r.method,
            )
            for r in kept.placements
            if (where := _kept_place(refs[r.frame], r, ground)) is not None
        )
        return cls(
            frames,
            mission.header.map_frame,
            Trajectory(placed, kept.revision),
            {r.frame: r.status for r in kept.placements},
            {r.frame: r.reason for r in kept.placements if r.reason},
            kept.summary.get("fit_to_gps_rms_m"),
            kept.summary.get("predicted_ce90_m"),
            tuple(kept.summary.get("warnings", ())),
            lenses=kept.lenses,
            control=_RESULTS.validate_python(kept.summary.get("control", ())),
            fix_lags={int(flight): FixLag(*lag) for flight, lag in kept.summary.get("fix_lags", {}).items()},
            track_shifts_s={
                int(flight): float(shift) for flight, shift in kept.summary.get("track_shifts_s", {}).items()
            },
        )


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


def _row_by_row(matrix: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in matrix.ravel())


def _kept_place(ref: FrameRef, record: PlacementRecord, ground: HeightField) -> CameraToMap | None:
    """Return where a frame was placed, ``None`` where it was not."""
    if record.T_map_plane is not None:
        return PlanePlacement(_kept_view(ref, record), record.T_map_plane)
    if record.posed is None:
        return None
    posed = record.posed
    camera = replace(plane_view(ref).camera, focal_px=posed.focal_px, k1=posed.k1)
    return PosedPlacement(camera, np.array(posed.centre), np.array(posed.R_map_camera).reshape(3, 3), ground)


def _kept_view(ref: FrameRef, record: PlacementRecord) -> PlaneView:
    """Return the view that a frame was placed with."""
    view = plane_view(ref)
    if record.R_level_camera is None:
        return view
    return PlaneView(view.camera, np.array(record.R_level_camera).reshape(3, 3), record.ground_slope)


def plane_outline(view: PlaneView) -> FloatArray:
    """``(4, 2)`` the raster's corners in its plane."""
    w, h = view.camera.width_px, view.camera.height_px
    return view.to_plane([[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]])


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
