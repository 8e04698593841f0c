"""Registrations of one mission: first frame to frame, then across strips where the poses say that frames overlap."""

from __future__ import annotations

import logging
import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from uuid import uuid4

import numpy as np

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi import Prior, register
from photomap_gis.parallel import ExecutorName, map_jobs, usable_cpus
from photomap_gis.pipeline.prepare import SpectrumShelf
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.slam.candidates import Candidate, candidates
from photomap_gis.store import Mission, MissionPaths, PreparedFrame, RegistrationRecord

logger = logging.getLogger(__name__)

MIN_OVERLAP = 0.3
"""Frames that share less of the smaller one's ground, by prediction, are not tried."""
PER_FRAME = 12
"""Registrations across strips tried a frame in one pass."""
MAX_PRIOR_ANGLE_RAD = 0.5
"""A heading less sure than this does not restrict the search."""
WORTH_PROCESSES = 1500
"""So many registrations outweigh the start of processes that make their own spectra."""
WELL_TIED = 4
"""A frame with this many registrations needs no second try."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two frames to register, and what is expected of them."""

    a: int
    b: int
    kind: EdgeKind
    prior: Prior | None = None
    fallback: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Frames whose poses share a map frame: each one's pose and covariance, plane outline ``(N, 2)`` and segment."""

    poses: Mapping[int, tuple[Similarity2D, FloatArray | None]]
    footprints: Mapping[int, FloatArray]
    segments: Mapping[int, int]

    def only(self, frames: Iterable[int]) -> Cluster:
        """Return the cluster of some of its frames."""
        kept = set(frames)
        return Cluster(
            {f: p for f, p in self.poses.items() if f in kept},
            {f: o for f, o in self.footprints.items() if f in kept},
            self.segments,
        )


def sequential_pairs(frames: Sequence[FrameRef], prepared: Mapping[int, PreparedFrame]) -> list[Pair]:
    """Return every usable frame with its usable predecessor of the same flight."""
    usable = [f for f in frames if prepared[f.index].usable]
    return [Pair(a.index, b.index, EdgeKind.SEQUENTIAL) for a, b in pairwise(usable) if a.flight == b.flight]


def rejoining_pairs(
    groups: Sequence[Sequence[int]], tried: set[tuple[int, int]], *, reach: int = 6, budget: int = 600
) -> list[Pair]:
    """Return untried pairs between unconnected groups of frames whose place is unknown: near in order first.

    ``groups`` are the connected components, as frame indices. ``reach`` is how far apart in order two frames may lie
    where there are too many for all of them.
    """
    component = {f: n for n, group in enumerate(groups) for f in group}
    order = sorted(component)
    found = [
        (j - i, order[i], order[j])
        for i in range(len(order))
        for j in range(i + 1, len(order))
        if component[order[i]] != component[order[j]] and (order[i], order[j]) not in tried
    ]
    if len(found) > budget:
        found = sorted(p for p in found if p[0] <= reach)[:budget]
    return [Pair(a, b, EdgeKind.LOOP) for _, a, b in sorted(found)]


class Measurements:
    """All registrations of a mission: those of earlier runs, and those that this run adds to the journal.

    An interrupted run is taken up where it was by going its way again: each pair that the journal holds is taken from
    there instead of being measured, at the moment when it is asked for. What is tried next depends on what has been
    found until then, so the way is the same, and so is the map.
    """

    def __init__(
        self,
        mission: Mission,
        shelf: SpectrumShelf,
        prepared: Mapping[int, PreparedFrame],
        settings: MapSettings,
        on_progress: Progress,
    ) -> None:
        self._mission = mission
        self._shelf = shelf
        self._settings = settings
        self._on_progress = on_progress
        self.prepared = prepared
        self._run = uuid4().hex
        self.records: dict[tuple[int, int], RegistrationRecord] = {}
        self._tries: Counter[tuple[int, int]] = Counter()
        self._earlier: defaultdict[tuple[int, int], deque[RegistrationRecord]] = defaultdict(deque)
        for r in mission.registrations:
            self._earlier[_key(r.a, r.b)].append(r)

    @property
    def accepted(self) -> list[RegistrationRecord]:
        """The registrations that are probably right, in one order whatever the way they were found on."""
        return sorted((r for r in self.records.values() if r.accepted), key=lambda r: (r.a, r.b))

    def count_accepted(self) -> dict[str, int]:
        """Return how many registrations of each kind were accepted."""
        return {kind.value: sum(r.kind is kind for r in self.accepted) for kind in EdgeKind}

    def take_sequential(self, frames: Sequence[FrameRef]) -> None:
        """Register every usable frame to its usable predecessor."""
        self._take(sequential_pairs(frames, self.prepared), "register")

    def take_loops(self, clusters: Sequence[Cluster]) -> int:
        """Register frames that overlap by the first solution; return how many registrations were won.

        Poses from a chain and GPS may be off by more than they say: the search is free, by spectra alone. Each cluster
        of frames has a map frame of its own; where there are several, nothing says how they lie to each other, and
        pairs between them are tried in order. Asked again with a newer solution, it tries what that shows besides: a
        frame's registrations so far count against what may be spent on it.
        """
        spent: Counter[int] = Counter()
        for r in self.accepted:
            if r.kind is EdgeKind.LOOP:
                spent.update((r.a, r.b))
        pairs = [
            Pair(c.a, c.b, EdgeKind.LOOP, fallback=False)
            for cluster in map(self._usable, clusters)
            for c in candidates(
                cluster.poses,
                cluster.footprints,
                exclude=self._tries.keys(),
                min_overlap=MIN_OVERLAP,
                max_per_frame=PER_FRAME,
                spent=spent,
            )
        ]
        if len(clusters) > 1:
            pairs += rejoining_pairs([sorted(self._usable(c).poses) for c in clusters], set(self._tries))
        return self._take(pairs, "loops")

    def take_missing(self, clusters: Sequence[Cluster]) -> int:
        """Try again, with the poses as priors and by features too, where the map still hangs by little.

        These are pairs of which one frame has few registrations, or which would join two segments. What earlier runs
        with fewer frames registered, and nothing has asked for now, is added.
        """
        degree: Counter[int] = Counter()
        for r in self.accepted:
            degree.update((r.a, r.b))
        settled = {key for key, r in self.records.items() if r.accepted or self._tries[key] > 1}
        pairs = []
        for cluster in map(self._usable, clusters):
            for c in candidates(
                cluster.poses, cluster.footprints, exclude=settled, min_overlap=MIN_OVERLAP, max_per_frame=PER_FRAME
            ):
                if min(degree[c.a], degree[c.b]) < WELL_TIED or cluster.segments[c.a] != cluster.segments[c.b]:
                    pairs.append(Pair(c.a, c.b, EdgeKind.LOOP, prior_of(c, self.prepared)))
        return self._take(pairs, "join", again=True) + self.take_kept()

    def take_kept(self) -> int:
        """Take over what the journal still holds; return how many accepted registrations that adds."""
        gained = 0
        for key, left in self._earlier.items():
            for record in left:
                self._tries[key] += 1
                if key in self.records and self.records[key].accepted:
                    continue  # found again by now: an earlier failure does not undo it
                self.records[key] = record
                gained += record.accepted
        self._earlier.clear()
        return gained

    def _usable(self, cluster: Cluster) -> Cluster:
        return cluster.only(f for f in cluster.poses if self.prepared[f].usable)

    def _take(self, pairs: Sequence[Pair], stage: str, *, again: bool = False) -> int:
        """Register pairs and journal each result; return how many were accepted.

        Pairs that this run has tried are left out unless they are to be tried ``again``. They are taken in the order
        of their frames: by worth, a long flight's would ask for spectra that were given up a moment ago.
        """
        todo = sorted((p for p in pairs if again or _key(p.a, p.b) not in self._tries), key=lambda p: _key(p.a, p.b))
        known = [left.popleft() if (left := self._earlier.get(_key(p.a, p.b))) else None for p in todo]
        new = [p for p, record in zip(todo, known, strict=True) if record is None]
        executor = self._executor(new)
        measure = self._measure
        if executor in ("processes", "dask"):
            measure = partial(measure_there, self._mission.paths, self._run)
        measured = map_jobs(
            measure, new, executor=executor, workers=self._settings.workers, scheduler=self._settings.scheduler
        )
        gained = done = 0
        for pair, record in zip(todo, known, strict=True):
            key = _key(pair.a, pair.b)
            self._tries[key] += 1
            if record is None:
                record = next(measured)
                done += 1
                if record is not None:
                    self._mission.registrations.append(record)
                self._on_progress(stage, done, len(new))
            if record is not None:
                self.records[key] = record
                gained += record.accepted
        return gained

    def _executor(self, pairs: Sequence[Pair]) -> ExecutorName:
        """Return where pairs are best registered.

        A registration by spectra is many short calls: two threads hand Python's lock to and fro and take half as long
        again as one. Features are few long calls. Processes start slowly and make spectra of their own.
        """
        if self._settings.scheduler is not None:
            return "dask"
        if self._settings.processes and len(pairs) >= WORTH_PROCESSES and (self._settings.workers or usable_cpus()) > 1:
            return "processes"
        return "threads" if any(p.fallback for p in pairs) else "serial"

    def _measure(self, pair: Pair) -> RegistrationRecord | None:
        return measured_pair(self._shelf, pair)


def measured_pair(shelf: SpectrumShelf, pair: Pair) -> RegistrationRecord | None:
    """Return the registration of a pair; ``None`` where a working image cannot be read."""
    try:
        found = register(shelf[pair.a], shelf[pair.b], prior=pair.prior, fallback=pair.fallback)
    except FrameReadError as error:  # costs this frame's pairs only
        logger.warning("%s", error)
        return None
    return RegistrationRecord.of(found, pair.kind)


def measure_there(paths: MissionPaths, run: str, pair: Pair) -> RegistrationRecord | None:
    """Register a pair on the machine where this is called: it opens the working images itself.

    ``run`` names a run of the mission: the spectra of another one may be of images that have been masked since.
    """
    return measured_pair(_shelf_of(paths, run), pair)


@lru_cache(maxsize=1)
def _shelf_of(paths: MissionPaths, run: str) -> SpectrumShelf:
    return SpectrumShelf(paths)


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def prior_of(candidate: Candidate, prepared: Mapping[int, PreparedFrame]) -> Prior | None:
    """Return the predicted motion as a prior between working images; ``None`` where it hardly restricts the search."""
    if candidate.covariance is None:
        return None
    work_a, work_b = prepared[candidate.a].T_plane_work, prepared[candidate.b].T_plane_work
    T_a_b = work_a.inverse() @ candidate.T_a_b @ work_b
    sigma = np.sqrt(np.maximum(np.diag(candidate.covariance), 0.0))
    # Position sigmas are in b's plane pixels: into a's plane by the motion's scale, then into a's working pixels.
    sigma_xy_px = float(max(sigma[0], sigma[1])) * candidate.T_a_b.scale / work_a.scale
    sigma_angle, sigma_log_scale = float(sigma[2]), float(sigma[3])
    if not all(map(math.isfinite, (sigma_xy_px, sigma_angle, sigma_log_scale))) or sigma_angle > MAX_PRIOR_ANGLE_RAD:
        return None
    # What the flat model leaves out (tilt, relief) is in no pose's covariance: hence the floors.
    return Prior(T_a_b, max(sigma_xy_px, 15.0), max(sigma_angle, 0.03), max(sigma_log_scale, 0.03))
