"""The graph worker's work: loops where footprints overlap by prediction, solutions, the map's place on Earth.

It owns no thread and no clock: told of key frames in their order, it registers what is asked and solves when told to,
so that a replay that asks the same in the same order gets the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameRef, FrameStatus, ImageArray
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import EdgeKind, Trajectory
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.georef import accuracy, choose_map_frame, fix_to_map, observe, plane_view
from photomap_gis.ifmi import Prior, make_working, register
from photomap_gis.live.chart import LiveSolution, solution_of
from photomap_gis.live.steps import Tie
from photomap_gis.pipeline.measure import MIN_OVERLAP
from photomap_gis.pipeline.prepare import SpectrumShelf, keep_working
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.pipeline.solved import Solved, plane_outline
from photomap_gis.slam import GraphBuilder, Leaning, candidates, placements, slopes_of_frames, solve
from photomap_gis.store import Mission, PreparedFrame, RegistrationRecord

LOOPS_A_KEY = 2
"""Registrations across strips tried for each new key frame."""
NEIGHBOURS = 24
"""So many of the nearest key frames are looked at for overlap."""
IN_CHAIN = 4
"""Key frames nearer in order than this are held together by the chain."""
FEWEST_FIXES, EXTENT_M, EXTENT_SIGMAS = 4, 15.0, 6.0
"""The map is laid on the ground when so many fixes lie so far apart: a heading is told then."""
USUAL_SIGMA_M = 2.0
JOINS_A_STEP = 4
SPECTRA = 64
"""Spectra held: about two megabytes each."""
TIE_SIGMA_PX, TIE_SIGMA = 8.0, 0.03
"""How far a motion between levelled pictures may be from what the loop saw between the pictures as they came."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyNews:
    """A key frame as the graph hears of it: its raster, where the loop believed it, and what it was reached from."""

    ref: FrameRef
    grey: ImageArray
    T_map_plane: Similarity2D
    tie: Tie | None


class _Held(NamedTuple):
    """Of a registration that was accepted, what is asked for again: the motion between its planes."""

    a: int
    b: int
    T_a_b: Similarity2D


class GraphWork:
    """All that is known between key frames, and its solutions (a builder with one owner).

    It is the one writer of the mission's working images, verdicts and registrations, of its header and its solution.
    """

    def __init__(self, mission: Mission, settings: MapSettings) -> None:
        self._mission, self._settings = mission, settings
        self._shelf = SpectrumShelf(mission, capacity=SPECTRA)
        self._refs: list[FrameRef] = []
        self._views: dict[int, PlaneView] = {}
        self._prepared: dict[int, PreparedFrame] = {}
        self._start: dict[int, Similarity2D] = {}
        self._centre: FloatArray = np.zeros((0, 2))
        self._pose: dict[int, Similarity2D] = {}
        self._accepted: dict[tuple[int, int], _Held] = {}
        self._tried: set[tuple[int, int]] = set()
        self._map_frame = mission.header.map_frame
        self._revision = 0
        self._unsaid: list[tuple[int, int]] = []
        self._ties = 0
        self._builder = GraphBuilder()
        self._solved: Solved | None = None

    @property
    def count(self) -> int:
        """Key frames known."""
        return len(self._refs)

    @property
    def map_frame(self) -> MapFrame:
        """Where the map lies, by the newest solution."""
        return self._map_frame

    def place_of(self, key: int) -> Similarity2D:
        """Return where a key frame lies by what is known; the map's origin where there is none."""
        return self._pose.get(key, Similarity2D())

    def add(self, news: KeyNews) -> None:
        """Take the next key frame in: keep its working image, and measure what it was reached from."""
        k = news.ref.index
        view = plane_view(news.ref)
        work = make_working(news.grey, view, size_px=self._settings.work_size_px)
        keep_working(self._mission, k, work.grey, work.mask)
        self._know(news.ref, PreparedFrame(k, True, None, work.T_plane_work), news.T_map_plane)
        self._mission.prepared.append(self._prepared[k])
        if news.tie is not None:
            self.tie(news.tie)
        self._place(k)

    def recall(self, ref: FrameRef, prepared: PreparedFrame, T_map_plane: Similarity2D) -> None:
        """Take a key frame in that a session which was cut off had; then its registrations come by ``recall_pair``."""
        self._know(ref, prepared, T_map_plane)
        self._place(ref.index)

    def recall_pair(self, record: RegistrationRecord) -> None:
        """Take a registration in that the journal holds, of key frames that were recalled."""
        self._tried.add(_key(record.a, record.b))
        if record.accepted:
            self._hold(record)

    def tie(self, tie: Tie) -> bool:
        """Measure a motion that the loop has seen, between levelled pictures; return whether it was accepted."""
        self._ties += tie.kind is EdgeKind.LOOP
        work_a, work_b = (self._prepared[k].T_plane_work for k in (tie.a, tie.b))
        prior = Prior(work_a.inverse() @ tie.T_a_b @ work_b, TIE_SIGMA_PX, TIE_SIGMA, TIE_SIGMA)
        try:
            found = register(self._shelf[tie.a], self._shelf[tie.b], prior=prior, fallback=False)
            if not found.accepted:
                found = register(self._shelf[tie.a], self._shelf[tie.b], fallback=tie.kind is EdgeKind.SEQUENTIAL)
        except FrameReadError:
            return False
        return self._keep(RegistrationRecord.of(replace(found, a=tie.a, b=tie.b), tie.kind))

    def _know(self, ref: FrameRef, prepared: PreparedFrame, T_map_plane: Similarity2D) -> None:
        self._refs.append(ref)
        self._views[ref.index] = plane_view(ref)
        self._prepared[ref.index] = prepared
        self._start[ref.index] = T_map_plane
        self._builder.add_frame(ref.index)

    def _place(self, k: int) -> None:
        self._pose[k] = self._placed_by(k)
        centre = self._pose[k].apply(plane_outline(self._views[k]).mean(axis=0))
        self._centre = np.concatenate([self._centre, centre[None]])

    def _keep(self, record: RegistrationRecord) -> bool:
        self._tried.add(_key(record.a, record.b))
        self._mission.registrations.append(record)
        if record.accepted:
            self._hold(record)
        return record.accepted

    def _hold(self, record: RegistrationRecord) -> None:
        known = self._prepared.keys() >= {record.a, record.b}
        if known:
            leaning = [self._leaning(k) for k in (record.a, record.b)]
            both = (leaning[0], leaning[1]) if leaning[0] is not None and leaning[1] is not None else None
            self._builder.add_registration(
                record.registration, self._prepared[record.a].T_plane_work, self._prepared[record.b].T_plane_work,
                kind=record.kind, leaning=both,
            )  # fmt: skip
            T_a_b, _ = record.registration.seen_from(
                self._prepared[record.a].T_plane_work, self._prepared[record.b].T_plane_work
            )
            # An hour's flight has tens of thousands: all else stays in the journal.
            self._accepted[_key(record.a, record.b)] = _Held(record.a, record.b, T_a_b)

    def _leaning(self, key: int) -> Leaning | None:
        focal = self._views[key].camera.focal_px
        return None if focal is None else Leaning(focal, (0.0, 0.0))

    def loops_of(self, key: int) -> list[tuple[int, int]]:
        """Return the pairs that a new key frame should be registered in, the likeliest first."""
        distance = np.hypot(*(self._centre - self._centre[key]).T)
        distance[max(0, key - IN_CHAIN) :] = np.inf
        near = [int(k) for k in np.argsort(distance, kind="stable")[:NEIGHBOURS] if np.isfinite(distance[k])]
        if not near:
            return []
        frames = [*near, key]
        found = candidates(
            {f: (self._pose[f], None) for f in frames},
            {f: plane_outline(self._views[f]) for f in frames},
            exclude=self._tried,
            min_overlap=MIN_OVERLAP,
            max_per_frame=LOOPS_A_KEY,
        )
        return [(c.a, c.b) for c in found if key in (c.a, c.b)][:LOOPS_A_KEY]

    def joins(self) -> list[tuple[int, int]]:
        """Return pairs that might tie the newest piece to the others, where it hangs in the air and has no GPS."""
        if len(self._refs) < 3 or self._map_frame.crs_wkt is not None:
            return []
        label = self._components()
        last = len(self._refs) - 1
        mine = [k for k in range(last, -1, -1) if label[k] == label[last]][:2]
        others = [k for k in range(last) if label[k] != label[last]]
        pairs = [(b, a) for a in mine for b in others[::-1] if _key(a, b) not in self._tried]
        return pairs[:JOINS_A_STEP]

    def measure(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Register pairs; return how many were accepted."""
        gained = 0
        for a, b in pairs:
            self._tried.add(_key(a, b))
            self._unsaid.append((a, b))
            try:
                found = register(self._shelf[a], self._shelf[b], fallback=False)
            except FrameReadError:
                continue
            gained += self._keep(RegistrationRecord.of(replace(found, a=a, b=b), EdgeKind.LOOP))
        return gained

    def solve(self) -> LiveSolution | None:
        """Solve all that is known on the plane; ``None`` where nothing hangs together yet."""
        if self._map_frame.crs_wkt is None and self._tells_place():
            fixes = [r.fix for r in self._refs if r.fix is not None]
            self._map_frame = choose_map_frame(fixes, self._settings.crs)
        if self._map_frame.crs_wkt is not None:
            seen = observe(self._refs, self._map_frame, antenna_offset_m=self._settings.antenna_offset_m)
            self._builder.observe(seen.positions, seen.scales, seen.headings)
        graph = self._builder.snapshot()
        found = solve(graph)
        slopes = slopes_of_frames(graph.edges)
        views = {
            k: view if k not in slopes else replace(view, ground_slope=slopes[k]) for k, view in self._views.items()
        }
        trajectory = placements(found, graph, self._refs, views, max_off_nadir_rad=self._settings.max_off_nadir_rad)
        if not trajectory.placements:
            return None
        self._revision += 1
        predicted = accuracy(found, graph)
        placed = {p.frame: p.status for p in trajectory.placements}
        statuses = {r.index: placed.get(r.index, FrameStatus.UNPLACED) for r in self._refs}
        solved = Solved(
            tuple(self._refs), self._map_frame, Trajectory(trajectory.placements, self._revision), statuses,
            {k: "not tied to the map yet" for k, s in statuses.items() if s is FrameStatus.UNPLACED},
            found.fit_to_gps_rms_m, None if predicted is None else predicted.predicted_ce90_m,
        )  # fmt: skip
        laid, registered = self._gauged(solved)
        self._solved = replace(solved, trajectory=Trajectory(tuple(laid), self._revision))
        for k, T in registered.items():
            self._pose[k] = T
            self._centre[k] = T.apply(plane_outline(self._views[k]).mean(axis=0))
        for k in range(len(self._refs)):
            if k not in registered:
                self._pose[k] = self._placed_by(k)
        pairs, self._unsaid = self._unsaid, []
        return solution_of(
            laid, registered, len(self._refs), self._map_frame, revision=self._revision, pairs=pairs,
            fit_to_gps_rms_m=solved.fit_to_gps_rms_m, predicted_ce90_m=solved.predicted_ce90_m, ties=self._ties,
        )  # fmt: skip

    def _gauged(self, solved: Solved) -> tuple[list[FramePlacement], dict[int, Similarity2D]]:
        """Return placements and registered poses; pieces without a place are laid where the loop believed them."""
        registered: dict[int, Similarity2D] = {}
        segment_of: dict[int, int] = {}
        for cluster in solved.clusters(self._views):
            registered |= {f: T for f, (T, _) in cluster.poses.items()}
            segment_of |= dict(cluster.segments)
        if solved.georeferenced:
            return list(solved.trajectory.placements), registered
        gauge: dict[int, Similarity2D] = {}
        for f in sorted(registered):
            if segment_of[f] not in gauge:
                gauge[segment_of[f]] = self._start[f] @ registered[f].inverse()
        laid = []
        for p in solved.trajectory.placements:
            where = p.camera_to_map
            assert isinstance(where, PlanePlacement)
            moved = replace(where, T_map_plane=gauge[p.segment] @ where.T_map_plane)
            laid.append(replace(p, camera_to_map=moved))
        return laid, {f: gauge[segment_of[f]] @ T for f, T in registered.items()}

    def save(self) -> None:
        """Keep the newest solution in the mission folder, as every reader of missions takes it."""
        if self._solved is None:
            return
        if self._mission.header.map_frame != self._map_frame:
            self._mission.save_header(replace(self._mission.header, map_frame=self._map_frame))
        self._solved.save(self._mission)

    def _placed_by(self, k: int) -> Similarity2D:
        """Return where a key frame lies by its registrations to earlier ones, else where the loop believed it."""
        for r in (self._accepted[p] for p in ((k - 1, k), *self._with(k)) if p in self._accepted):
            other = r.a if r.b == k else r.b
            if other not in self._pose:
                continue
            return self._pose[other] @ (r.T_a_b if r.b == k else r.T_a_b.inverse())
        return self._start[k]

    def _with(self, k: int) -> list[tuple[int, int]]:
        return [p for p in islice(reversed(self._accepted), 8) if k in p][::-1]

    def _tells_place(self) -> bool:
        """Whether the fixes lie far enough apart to turn the map rightly."""
        fixes = [r.fix for r in self._refs if r.fix is not None]
        if len(fixes) < FEWEST_FIXES:
            return False
        frame = choose_map_frame(fixes)
        xy = fix_to_map(frame, [f.lat_deg for f in fixes], [f.lon_deg for f in fixes])
        extent = float(np.hypot(*np.ptp(xy[np.isfinite(xy).all(axis=1)], axis=0)))
        sigma = float(np.median([f.sigma_m or USUAL_SIGMA_M for f in fixes]))
        return extent >= max(EXTENT_M, EXTENT_SIGMAS * sigma)

    def _components(self) -> list[int]:
        label = list(range(len(self._refs)))

        def root(k: int) -> int:
            while label[k] != k:
                label[k] = label[label[k]]
                k = label[k]
            return k

        for a, b in self._accepted:
            label[root(a)] = root(b)
        return [root(k) for k in range(len(self._refs))]


def worth_solving(count: int, last_count: int, solve_every: int) -> bool:
    """Whether so many key frames have come that a solution is due: less often as the graph grows."""
    return count - last_count >= max(solve_every, math.ceil(0.03 * last_count))


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)
