"""The solution of a mission as the corridor hands it on: what became of every frame, kept in the mission folder."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
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
from photomap_gis.georef import plane_view, resolve_crs
from photomap_gis.pipeline.control import ControlResult
from photomap_gis.pipeline.measure import Cluster
from photomap_gis.store import GroundRecord, LensRecord, Mission, PlacementRecord, PosedRecord, SolutionRecord

_RESULTS: TypeAdapter[tuple[ControlResult, ...]] = TypeAdapter(tuple[ControlResult, ...])
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
        told = {r.frame for r in kept.placements}
        frames = tuple(f for f in mission.frames if f.index in told)  # of a flight under way more may have come
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
