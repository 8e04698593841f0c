"""Where key frames lie: the newest solution, and behind it the chain that the loop has added since.

Poses are ``T_map_plane`` of the planes that frames were *registered* in; a solution may have levelled a plane further,
so it also tells the view and pose by which a frame is to be drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.georef import plane_view


class Belief(NamedTuple):
    """A pose and its ``(4, 4)`` covariance, right perturbations, in plane units."""

    T_map_plane: Similarity2D
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LiveSolution:
    """One solution over the key frames 0 .. n - 1, as arrays that travel lightly.

    ``motion`` ``(n, 4)``: ``T_map_plane`` (tx, ty, angle, log scale) of the registered plane, NaN where a frame is not
    placed; ``drawn`` ``(n, 4)``, ``level`` ``(n, 9)``, ``slope`` ``(n, 2)``: pose and view to draw by; ``covariance``
    ``(n, 4, 4)``; ``segment`` ``(n,)``, -1 where not placed. ``pairs`` are what the graph worker has registered since
    the solution before, ``ties`` how many recognised segments it had been told of.
    """

    revision: int
    map_frame: MapFrame
    motion: FloatArray
    drawn: FloatArray
    level: FloatArray
    slope: FloatArray
    covariance: FloatArray
    segment: npt.NDArray[np.intp]
    pairs: tuple[tuple[int, int], ...] = ()
    fit_to_gps_rms_m: float | None = None
    predicted_ce90_m: float | None = None
    ties: int = 0

    def __len__(self) -> int:
        return len(self.motion)

    def holds(self, key: int) -> bool:
        """Whether a key frame has a place in it."""
        return 0 <= key < len(self.motion) and bool(np.isfinite(self.motion[key, 0]))

    def belief(self, key: int) -> Belief:
        """Return the pose of a key frame that it holds."""
        return Belief(_similarity(self.motion[key]), self.covariance[key])


@dataclass(slots=True)
class Chart:
    """The key frames of a session and their places (a builder; its owner is the loop)."""

    map_frame: MapFrame = field(default_factory=lambda: MapFrame(None))
    solution: LiveSolution | None = None
    refs: list[FrameRef] = field(default_factory=list)
    segments: list[int] = field(default_factory=list)
    _chained: dict[int, Belief] = field(default_factory=dict)

    @property
    def revision(self) -> int:
        """Counts the solutions adopted."""
        return 0 if self.solution is None else self.solution.revision

    def __len__(self) -> int:
        return len(self.refs)

    def sigmas(self) -> FloatArray:
        """``(n,)`` predicted one sigma per axis of the key frames' plumb points, in map units."""
        out = np.zeros(len(self.refs))
        if self.solution is not None:
            n = min(len(self.solution), len(out))
            variance = np.trace(self.solution.covariance[:n, :2, :2], axis1=1, axis2=2) / 2.0
            out[:n] = np.sqrt(np.maximum(variance, 0.0)) * np.exp(np.nan_to_num(self.solution.motion[:n, 3]))
        for k, (T, covariance) in self._chained.items():
            out[k] = np.sqrt(max(covariance[0, 0] + covariance[1, 1], 0.0) / 2.0) * T.scale
        return out

    def add(self, ref: FrameRef, belief: Belief, segment: int) -> None:
        """Add the next key frame where the loop believes it to lie."""
        if ref.index != len(self.refs):
            raise ValueError(f"key frames come in order: expected {len(self.refs)}, got {ref.index}")
        self.refs.append(ref)
        self.segments.append(segment)
        self._chained[ref.index] = belief

    def belief(self, key: int) -> Belief:
        """Return the newest pose of a key frame."""
        if key in self._chained:
            return self._chained[key]
        assert self.solution is not None  # all others lie in it
        return self.solution.belief(key)

    def move_segment(self, segment: int, motion: Similarity2D, into: int) -> list[int]:
        """Move the key frames of a segment by a motion of the map, as part of another one; return which they were."""
        moved = [k for k, s in enumerate(self.segments) if s == segment]
        for k in moved:
            T, covariance = self.belief(k)
            self._chained[k] = Belief(motion @ T, covariance)
            self.segments[k] = into
        return moved

    def adopt(self, solution: LiveSolution) -> None:
        """Take a solution over whole; key frames that came since hang on the last one before them that it holds."""
        holds = np.zeros(len(self.refs), bool)
        known = min(len(solution), len(holds))
        holds[:known] = np.isfinite(solution.motion[:known, 0])
        before = {k: self.belief(k) for k in np.flatnonzero(~holds).tolist()}
        held = np.flatnonzero(holds)
        anchors: dict[int, tuple[Belief, Belief]] = {}
        moved: dict[int, Belief] = {}
        for k in before:
            row = int(np.searchsorted(held, k))
            last = int(held[row - 1]) if row else (int(held[0]) if len(held) else None)
            if last is None:
                moved[k] = before[k]
                continue
            if last not in anchors:
                anchors[last] = (solution.belief(last), self.belief(last))
            moved[k] = _hung_on(*anchors[last], before[k])
        self._chained = moved
        self.solution, self.map_frame = solution, solution.map_frame
        first = next((k for k in held.tolist() if self.segments[k] == 0), None)
        if first is not None:
            for k in held[solution.segment[held] == solution.segment[first]].tolist():
                self.segments[k] = 0

    def snapshot(self) -> Chart:
        """Return the chart as it is now, for readers in other threads; key frames that come later are not in it."""
        return Chart(self.map_frame, self.solution, self.refs[:], self.segments[:], dict(self._chained))

    def placement(self, key: int) -> FramePlacement:
        """Return how a key frame is drawn by the newest pose."""
        ref, sol = self.refs[key], self.solution
        view = plane_view(ref)
        segment = self.segments[key]
        if key in self._chained or sol is None:
            T, covariance = self.belief(key)
            return placed(ref, view, T, covariance, segment)
        level = PlaneView(
            view.camera, sol.level[key].reshape(3, 3), (float(sol.slope[key, 0]), float(sol.slope[key, 1]))
        )
        return placed(ref, level, _similarity(sol.drawn[key]), sol.covariance[key], segment)


def _hung_on(new: Belief, old: Belief, belief: Belief) -> Belief:
    """Return what becomes of a pose when the key frame that it hangs on moves, and is known otherwise than before."""
    T = old.T_map_plane.inverse() @ belief.T_map_plane
    ad = T.inverse().adjoint()
    own = belief.covariance - ad @ old.covariance @ ad.T
    values, vectors = np.linalg.eigh((own + own.T) / 2.0)
    grown = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Belief(new.T_map_plane @ T, ad @ new.covariance @ ad.T + grown)


def placed(
    ref: FrameRef, view: PlaneView, T_map_plane: Similarity2D, covariance: FloatArray, segment: int
) -> FramePlacement:
    """Return a placement on the plane."""
    where = PlanePlacement(view, T_map_plane)
    return FramePlacement(ref.index, ref.width_px, ref.height_px, where, covariance, FrameStatus.REGISTERED, segment)


def solution_of(
    placements: Sequence[FramePlacement],
    registered: Mapping[int, Similarity2D],
    count: int,
    map_frame: MapFrame,
    *,
    revision: int,
    pairs: Sequence[tuple[int, int]],
    fit_to_gps_rms_m: float | None,
    predicted_ce90_m: float | None,
    ties: int,
) -> LiveSolution:
    """Return placements on the plane, and the poses of the registered planes, as arrays over ``count`` key frames."""
    motion, drawn = np.full((count, 4), np.nan), np.full((count, 4), np.nan)
    level, slope = np.tile(np.eye(3).ravel(), (count, 1)), np.zeros((count, 2))
    covariance, segment = np.tile(np.eye(4), (count, 1, 1)), np.full(count, -1, np.intp)
    for p in placements:
        where = p.camera_to_map
        assert isinstance(where, PlanePlacement)
        motion[p.frame], drawn[p.frame] = _numbers(registered[p.frame]), _numbers(where.T_map_plane)
        level[p.frame], slope[p.frame] = where.view.R_level_camera.ravel(), where.view.ground_slope
        covariance[p.frame], segment[p.frame] = p.pose_covariance, p.segment
    return LiveSolution(
        revision, map_frame, motion, drawn, level, slope, covariance, segment, tuple(pairs), fit_to_gps_rms_m,
        predicted_ce90_m, ties,
    )  # fmt: skip


def _numbers(T: Similarity2D) -> tuple[float, float, float, float]:
    return T.tx, T.ty, T.angle_rad, T.log_scale


def _similarity(numbers: FloatArray) -> Similarity2D:
    tx, ty, angle, log_scale = (float(v) for v in numbers)
    return Similarity2D(tx, ty, angle, log_scale)
