"""The loop's one step: judge a frame, register it to the key frame, chain its pose, choose key frames.

It is told frames and solutions in one order and knows no clock but the stream's, so that the same order gives the same
poses to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameRef, ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.georef import fix_to_map, plane_view
from photomap_gis.ifmi import (
    Fault,
    FrameLook,
    FrameVerdict,
    Prior,
    Spectrum,
    judge_frame,
    judge_registered,
    look_at,
    make_spectrum,
    register,
)
from photomap_gis.ifmi.frames.verdict import GOOD
from photomap_gis.ifmi.working import shrink
from photomap_gis.ingest.stills import PHOTO_SUFFIXES
from photomap_gis.live.chart import Belief, Chart, LiveSolution, placed
from photomap_gis.live.look import Witness
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.steps import FrameState, Joined, NewKey, Step, Tie
from photomap_gis.pipeline.solved import plane_outline

LONGEST_STREAK = 8
"""So many frames rejected in a row: not they have changed, the scene has."""
PRIOR_UP_TO_S = 0.7
"""Of a frame that comes later after the last one, motion tells nothing that would restrict the search."""
FOREIGN_SIGMA = 0.4
"""How far, as a share of the frame, a new segment may lie off where it is believed, at first."""
RECENT = 48
"""Small pictures of the newest key frames that are kept in memory: a spectrum is made of one in a few milliseconds."""
FROZEN_AFTER_S = 0.5
"""A picture that repeats itself for so long is a link that froze; before that the video only stutters."""
MOST_SPOILT = 5
"""So many frames in a row that are spoilt in part: not they are, the ground has changed or leans."""
MANY, FEW = 120, 8
"""Key frames that a new segment is compared with, and each of its further key frames."""
TRIED_EVERY_S = 0.1
"""One of them in so much of the stream: each costs as much as tracking a frame or two."""
FIX_REACH_M = 25.0
"""Two fixes of a plain receiver may be so much further from each other than their frames are."""
GRID = np.stack(np.meshgrid((np.arange(9) + 0.5) / 9.0, (np.arange(9) + 0.5) / 9.0), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A frame that was looked at, ready to be registered; ``T_px_small`` is the way from its small picture."""

    ref: FrameRef
    view: PlaneView
    grey: ImageArray
    small: ImageArray
    T_px_small: Similarity2D
    look: FrameLook
    spectrum: Spectrum
    time_s: float
    is_suspect: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Tracked:
    """The last frame with a place: its motion to the key frame, between pixels of both."""

    seen: _Seen
    T_key_px: Similarity2D
    found: Registration | None


class Tracker:
    """The loop's memory; one owner, which calls ``take`` for each frame and ``adopt`` between two of them.

    ``load`` returns the grey raster of a key frame that was chosen before; ``FrameReadError`` where it is gone.
    """

    def __init__(self, options: LiveOptions, load: Callable[[int], ImageArray]) -> None:
        self.chart = Chart()
        self._options, self._load = options, load
        self._size_px = options.settings.work_size_px
        self._key: _Seen | None = None
        self._last: _Tracked | None = None
        self._before: _Tracked | None = None
        self._look: tuple[FrameLook, float] | None = None
        self._rejected = 0
        self._since_s: float | None = None
        self._segment = 0
        self._joined = True
        self._candidates: list[int] = []
        self._tried_s = -math.inf
        self._recent: dict[int, ImageArray] = {}
        self._spoilt_in_a_row = 0

    @property
    def pieces(self) -> int:
        """How many pieces the map has that are not tied to each other."""
        return len(set(self.chart.segments))

    def adopt(self, solution: LiveSolution) -> None:
        """Take a solution over: the chain goes on from where it lays the key frame."""
        self.chart.adopt(solution)
        if self._key is not None:
            self._segment = self.chart.segments[self._key.ref.index]
            if self._segment == 0:
                self._joined, self._candidates = True, []

    def take(self, ref: FrameRef, grey: ImageArray, stream_time_s: float, *, is_suspect: bool = False) -> Step:
        """Return what becomes of the next frame; ``ref`` gets its number as a key frame here.

        ``is_suspect`` tells that the decoder lost data since the last key frame of its own.
        """
        view = plane_view(ref)
        small, T_px_small = shrink(grey, self._size_px)
        look = look_at(small)
        gap = self._look is not None and stream_time_s - self._look[1] > self._options.gap_s
        verdict = self._judged(ref, look, gap)
        if verdict.fault is Fault.FROZEN and self._is_fresh(stream_time_s):
            return self._repeats(ref, view)
        if not verdict.ok:
            self._rejected += 1
            if self._rejected >= LONGEST_STREAK:
                self._look, self._rejected = None, 0
            return self._waits(ref, view, FrameState.ERROR, verdict.reason)
        seen = _Seen(ref, view, grey, small, T_px_small, look, make_spectrum(small), stream_time_s, is_suspect)
        if self._key is None or self._last is None:
            self._accept_look(seen)
            return self._begin(seen)
        promoted: NewKey | None = None
        found = self._register(self._key, seen, self._prior(seen))
        if not found.accepted and self._last.seen is not self._key:
            again = self._register(self._last.seen, seen, None)
            if again.accepted and not self._is_spoilt(self._last.seen, seen, again, verdict):
                promoted = self._promote(self._last)
                found = again
        if not found.accepted:
            return self._lost(seen, found, verdict, gap)
        self._accept_look(seen)
        return self._track(seen, found, promoted, verdict)

    def _is_fresh(self, stream_time_s: float) -> bool:
        return self._look is not None and self._last is not None and stream_time_s - self._look[1] < FROZEN_AFTER_S

    def _repeats(self, ref: FrameRef, view: PlaneView) -> Step:
        key, last = self._key, self._last
        assert key is not None and last is not None
        belief = self._pose(key, last.seen, last.T_key_px, last.found)
        return Step(ref, FrameState.REPEATED, belief, last.seen.view, self._segment)

    def _judged(self, ref: FrameRef, look: FrameLook, gap: bool) -> FrameVerdict:
        verdict = judge_frame(look, None if gap or self._look is None else self._look[0])
        if not is_video(ref) and verdict.fault in (Fault.BLURRED, Fault.FROZEN):
            return GOOD  # photos differ: whether one can be used, registration tells
        return verdict

    def _accept_look(self, seen: _Seen) -> None:
        self._look, self._rejected, self._since_s = (seen.look, seen.time_s), 0, None

    def _waits(self, ref: FrameRef, view: PlaneView, state: FrameState, reason: str | None) -> Step:
        return Step(ref, state, None, view, self._segment, reason)

    def _prior(self, seen: _Seen) -> Prior | None:
        """Return the motion expected by the last two frames, in small pixels of the key frame."""
        last, before, key = self._last, self._before, self._key
        assert last is not None and key is not None
        dt = seen.time_s - last.seen.time_s
        if dt > PRIOR_UP_TO_S or not is_video(seen.ref):
            return None
        T = last.T_key_px
        if before is not None:
            step_s = last.seen.time_s - before.seen.time_s
            if 0.0 < step_s < PRIOR_UP_TO_S:
                share = min(dt / step_s, 4.0)
                T = T @ Similarity2D.exp(share * (before.T_key_px.inverse() @ T).log())
        T_small = key.T_px_small.inverse() @ T @ seen.T_px_small
        return Prior(T_small, 6.0 + 60.0 * dt, 0.015 + 0.3 * dt, 0.012 + 0.1 * dt)

    def _register(self, a: _Seen, b: _Seen, prior: Prior | None) -> Registration:
        found = register(a.spectrum, b.spectrum, prior=prior, fallback=False)
        if not found.accepted and prior is not None:
            found = register(a.spectrum, b.spectrum, fallback=False)
        if not found.accepted and not is_video(b.ref):
            found = register(a.spectrum, b.spectrum)
        return found

    def _is_spoilt(self, a: _Seen, b: _Seen, found: Registration, verdict: FrameVerdict) -> bool:
        """Whether a frame that is to be pasted shows what it cannot have seen."""
        return _witness(a, b, found, verdict).is_spoilt()

    def _chained(self, key: _Seen, seen: _Seen, found: Registration) -> tuple[Similarity2D, Belief]:
        """Return ``T_keypx_px`` and the pose that a registration to a key frame gives a frame."""
        T_key_px = key.T_px_small @ found.T_a_b @ seen.T_px_small.inverse()
        return T_key_px, self._pose(key, seen, T_key_px, found)

    def _pose(self, key: _Seen, seen: _Seen, T_key_px: Similarity2D, found: Registration | None) -> Belief:
        T_key_plane = between_planes(key.view, seen.view, T_key_px, seen.ref)
        T_map_key, key_covariance = self.chart.belief(key.ref.index)
        ad = T_key_plane.inverse().adjoint()
        covariance = ad @ key_covariance @ ad.T
        if found is not None:
            shift = seen.view.to_plane(np.array([[(seen.ref.width_px - 1) / 2.0, (seen.ref.height_px - 1) / 2.0]]))[0]
            centre = Similarity2D.translation_of(-(seen.ref.width_px - 1) / 2.0, -(seen.ref.height_px - 1) / 2.0)
            T_plane_small = Similarity2D.translation_of(*shift) @ centre @ seen.T_px_small
            covariance = covariance + found.seen_from(Similarity2D(), T_plane_small)[1]
        return Belief(T_map_key @ T_key_plane, covariance)

    def _track(self, seen: _Seen, found: Registration, promoted: NewKey | None, verdict: FrameVerdict) -> Step:
        key, last = self._key, self._last
        assert key is not None and last is not None
        T_key_px, belief = self._chained(key, seen, found)
        new_key: NewKey | None = None
        if _new_share(key.ref, seen.ref, T_key_px) >= self._options.new_ground:
            if self._is_spoilt(key, seen, found, verdict) and self._spoilt_in_a_row < MOST_SPOILT:
                self._spoilt_in_a_row += 1
                waits = self._waits(seen.ref, seen.view, FrameState.ERROR, "spoilt in part")
                return replace(waits, promoted=promoted)
            T_key_plane = between_planes(key.view, seen.view, T_key_px, seen.ref)
            before = _Tracked(last.seen, T_key_px.inverse() @ last.T_key_px, None)
            new_key = self._make_key(seen, belief, self._segment, T_key_plane, before)
        else:
            self._before, self._last = last, _Tracked(seen, T_key_px, found)
        joined = None if self._joined else self._recognise(seen.time_s)
        if joined is not None:
            belief = (
                self.chart.belief(new_key.ref.index) if new_key is not None else self._pose(key, seen, T_key_px, found)
            )
        return Step(
            seen.ref if new_key is None else new_key.ref, FrameState.TRACKED if new_key is None else FrameState.KEY,
            belief, seen.view, self._segment, None, promoted, new_key, joined, None, found.probability,
            None if new_key is not None else _witness(key, seen, found, verdict),
        )  # fmt: skip

    def _promote(self, last: _Tracked) -> NewKey:
        """Make the last tracked frame a key frame: the next one does not reach the present one any more."""
        key = self._key
        assert key is not None
        belief = self._pose(key, last.seen, last.T_key_px, last.found)
        T_key_plane = between_planes(key.view, last.seen.view, last.T_key_px, last.seen.ref)
        before = self._before
        if before is not None:
            before = _Tracked(before.seen, last.T_key_px.inverse() @ before.T_key_px, None)
        return self._make_key(last.seen, belief, self._segment, T_key_plane, before)

    def _make_key(
        self, seen: _Seen, belief: Belief, segment: int, T_key_plane: Similarity2D | None, before: _Tracked | None
    ) -> NewKey:
        index = len(self.chart)
        ref = replace(seen.ref, index=index)
        tie = None
        if self._key is not None and T_key_plane is not None:
            tie = Tie(self._key.ref.index, index, T_key_plane)
        self.chart.add(ref, belief, segment)
        spectrum = replace(seen.spectrum, index=index)
        kept = replace(seen, ref=ref, spectrum=spectrum)
        self._key, self._spoilt_in_a_row = kept, 0
        self._before, self._last = before, _Tracked(kept, Similarity2D(), None)
        self._recent[index] = seen.small
        self._recent.pop(index - RECENT, None)
        if not self._joined:
            self._candidates = self._nearest(belief, seen, FEW) + self._candidates[-MANY:]
        return NewKey(ref, seen.grey, belief, segment, seen.time_s, tie)

    def _lost(self, seen: _Seen, found: Registration, verdict: FrameVerdict, gap: bool) -> Step:
        """Wait a little, then begin a new segment; a frame that looks faulty by itself begins none."""
        before = None if self._look is None else self._look[0]
        if (
            before is not None
            and is_video(seen.ref)
            and not judge_registered(seen.look, before, found, doubt=verdict.doubt, suspect=seen.is_suspect).ok
        ):
            return self._waits(seen.ref, seen.view, FrameState.ERROR, "fits nowhere and looks damaged")
        if self._since_s is None:
            self._since_s = seen.time_s if not gap else seen.time_s - self._options.lost_after_s
        if seen.time_s - self._since_s < self._options.lost_after_s and is_video(seen.ref):
            return self._waits(seen.ref, seen.view, FrameState.WAITING, "not recognised yet")
        self._accept_look(seen)
        return self._begin(seen)

    def _begin(self, seen: _Seen) -> Step:
        """Begin a segment with a frame, where GPS or the last motion put it."""
        first = not len(self.chart)
        number = 0 if first else max(self.chart.segments) + 1
        belief = self._guess(seen)
        self._key = None
        self._joined, self._candidates = first, []
        new_key = self._make_key(seen, belief, number, None, None)
        self._segment = number
        joined = None
        if not first:
            self._candidates = self._nearest(belief, seen, MANY)
            joined = self._recognise(seen.time_s)
        if joined is not None:
            belief = self.chart.belief(new_key.ref.index)
        return Step(
            new_key.ref, FrameState.KEY, belief, seen.view, self._segment, None, None, new_key, joined,
            None if first else number,
        )  # fmt: skip

    def _guess(self, seen: _Seen) -> Belief:
        """Return where a frame that nothing ties lies: by its fix where the map has a place, else by the last pose."""
        wide = wide_covariance(seen.ref)
        if not len(self.chart):
            return Belief(Similarity2D(), np.diag([1e-6, 1e-6, 1e-12, 1e-12]))
        if self._last is not None and self._key is not None:
            T = self._pose(self._key, self._last.seen, self._last.T_key_px, None).T_map_plane
        else:
            T = self.chart.belief(len(self.chart) - 1).T_map_plane
        if self.chart.map_frame.crs_wkt is not None and seen.ref.fix is not None:
            fix = seen.ref.fix
            x, y = fix_to_map(self.chart.map_frame, fix.lat_deg, fix.lon_deg)[0]
            if math.isfinite(x) and math.isfinite(y):
                T = replace(T, tx=float(x), ty=float(y))
        return Belief(T, wide)

    def _nearest(self, belief: Belief, seen: _Seen, count: int) -> list[int]:
        """Return key frames of other segments, the nearest to a place last: that is where they are taken from.

        Where fixes tell how far off they are, those that cannot show the same ground are left out.
        """
        outline = belief.T_map_plane.apply(plane_outline(seen.view))
        centre = outline.mean(axis=0)
        mine = self.chart.segments[-1]
        others = [k for k in range(len(self.chart)) if self.chart.segments[k] != mine]
        if not others:
            return []
        origins = np.array([self.chart.belief(k).T_map_plane.translation for k in others])
        distance = np.hypot(*(origins - centre).T)
        if self.chart.map_frame.crs_wkt is not None and seen.ref.fix is not None:
            reach = 2.0 * float(np.hypot(*(outline - centre).T).max()) + FIX_REACH_M
            fixed = np.array([self.chart.refs[k].fix is not None for k in others])
            distance[fixed & (distance > reach)] = np.inf
        order = np.argsort(distance, kind="stable")[:count]
        return [others[int(k)] for k in order if np.isfinite(distance[k])][::-1]

    def _recognise(self, time_s: float) -> Joined | None:
        """Try the next key frame that might show the ground of this segment; few a second, so that the loop goes on."""
        key = self._key
        assert key is not None
        if not self._candidates or 0.0 <= time_s - self._tried_s < TRIED_EVERY_S:
            return None
        self._tried_s = time_s
        other = self._candidates.pop()
        try:
            seen = self._seen_again(other)
        except FrameReadError:
            return None
        found = register(seen[0], key.spectrum, fallback=False)
        if not found.accepted:
            return None
        ref = self.chart.refs[other]
        T_other_px = seen[1] @ found.T_a_b @ key.T_px_small.inverse()
        T_other_key = between_planes(plane_view(ref), key.view, T_other_px, key.ref)
        T_map_key = self.chart.belief(other).T_map_plane @ T_other_key
        motion = T_map_key @ self.chart.belief(key.ref.index).T_map_plane.inverse()
        segment, into = self._segment, self.chart.segments[other]
        moved = self.chart.move_segment(segment, motion, into)
        self._segment, self._joined, self._candidates = into, into == 0, []
        return Joined(segment, into, Tie(other, key.ref.index, T_other_key, EdgeKind.LOOP), tuple(moved))

    def _seen_again(self, key: int) -> tuple[Spectrum, Similarity2D]:
        """Return the spectrum of an earlier key frame, and the way from its small picture to its pixels."""
        ref = self.chart.refs[key]
        small = self._recent.get(key)
        if small is None:
            small, T_px_small = shrink(self._load(key), self._size_px)
        else:
            _, T_px_small = shrink(np.zeros((ref.height_px, ref.width_px), np.uint8), self._size_px)
        return make_spectrum(small, index=key), T_px_small


def _witness(a: _Seen, b: _Seen, found: Registration, verdict: FrameVerdict) -> Witness:
    return Witness(b.look, a.look, found, verdict.doubt, is_video(b.ref), b.is_suspect)


def wide_covariance(ref: FrameRef) -> FloatArray:
    """``(4, 4)`` of a frame that nothing ties to the map yet."""
    side = FOREIGN_SIGMA * float(max(ref.width_px, ref.height_px))
    return np.diag([side**2, side**2, 0.25, 0.04])


def between_planes(view_a: PlaneView, view_b: PlaneView, T_apx_bpx: Similarity2D, ref_b: FrameRef) -> Similarity2D:
    """Return the motion between planes that a motion between pixels is: exact for rigid views, else the best fit."""
    if view_a.is_rigid and view_b.is_rigid:
        ca, cb = view_a.camera.principal_xy_px, view_b.camera.principal_xy_px
        return Similarity2D.translation_of(*-ca) @ T_apx_bpx @ Similarity2D.translation_of(*cb)
    px = GRID * (ref_b.width_px, ref_b.height_px) - 0.5
    a, b = view_a.to_plane(T_apx_bpx.apply(px)), view_b.to_plane(px)
    ok = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if ok.sum() < 3:
        return T_apx_bpx
    return fit_similarity(a[ok], b[ok])


def _new_share(key: FrameRef, ref: FrameRef, T_key_px: Similarity2D) -> float:
    """Return the share of a frame that its key frame does not show."""
    back = T_key_px.apply(GRID * (ref.width_px, ref.height_px) - 0.5)
    inside = (back >= -0.5) & (back <= (key.width_px - 0.5, key.height_px - 0.5))
    return 1.0 - float(inside.all(axis=1).mean())


def is_video(ref: FrameRef) -> bool:
    """Whether a frame comes from a stream of pictures rather than being a photo."""
    return ref.frame_number is not None or Path(ref.source).suffix.lower() not in PHOTO_SUFFIXES


def frame_placement(step: Step) -> FramePlacement | None:
    """Return a frame of the loop as a placement of the map it was chained in; ``None`` where it has none."""
    if step.belief is None:
        return None
    return placed(step.ref, step.view, step.belief.T_map_plane, step.belief.covariance, step.segment)
