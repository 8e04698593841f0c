"""Frames judged again by registering each with the last sound one before it: what is spoilt in part is masked.

The registrations are those that the map needs anyway, so they go into the journal, and nothing is measured twice.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameRef, ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.ifmi import (
    Fault,
    FrameVerdict,
    judge_frame,
    judge_registered,
    look_at,
    make_spectrum,
    register,
)
from photomap_gis.ifmi.frames.rescue import register_part
from photomap_gis.ifmi.frames.still import EXPECTED_PX, is_frozen, stillness
from photomap_gis.ifmi.frames.verdict import GOOD, rejected
from photomap_gis.parallel import map_jobs
from photomap_gis.pipeline.settings import Progress
from photomap_gis.store import Mission, PreparedFrame, RegistrationRecord

logger = logging.getLogger(__name__)

LONGEST_STREAK = 5
"""So many frames in a row that do not fit one before them: not they have changed, the scene has."""
TRY_PARTS_DOUBT = 0.3

SPOILT_PHOTO = (Fault.TORN, Fault.STALE, Fault.BLOCKS)
"""What a photo that is still of use in part may be masked for."""

Mask = npt.NDArray[np.bool_]
Working = tuple[ImageArray, Mask | None]


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """What came of laying frame ``b`` on frame ``a``: how far it moved, and whether it stands still."""

    a: int
    b: int
    verdict: FrameVerdict
    registration: Registration
    moved_px: float
    still: bool
    video: bool = True


@dataclass(frozen=True, slots=True)
class WorkingImages:
    """The door to the working images on disk."""

    load: Callable[[int], Working]
    keep: Callable[[int, ImageArray, Mask], None]


def judge_neighbours(
    mission: Mission,
    frames: Sequence[FrameRef],
    prepared: dict[int, PreparedFrame],
    images: WorkingImages,
    *,
    workers: int | None,
    on_progress: Progress,
    scheduler: str | None = None,
) -> None:
    """Register every usable frame with the usable one before it, and mask or reject what does not fit.

    ``prepared`` and the mission's journals are brought up to date. A frame that is rejected or masked has its successor
    judged anew, in a further round.
    """
    videos = {f.index for f in frames if f.frame_number is not None}
    chain = _Chain(mission, prepared, images)
    done = 0
    while pairs := _open_pairs(frames, prepared, chain):
        total = done + len(pairs)
        chain.begin_round()
        jobs = [(pair, pair[1] in videos, prepared[pair[1]].is_suspect) for pair in pairs]
        results = map_jobs(partial(_met, images), jobs, workers=workers, scheduler=scheduler)
        for pair, found, following in _with_next(pairs, results):
            chain.take(pair, found, following)
            done += 1
            on_progress("register", min(done, total), total)


def _open_pairs(
    frames: Sequence[FrameRef], prepared: Mapping[int, PreparedFrame], chain: _Chain
) -> list[tuple[int, int]]:
    usable = [f for f in frames if prepared[f.index].usable]
    return [
        (a.index, b.index) for a, b in pairwise(usable) if a.flight == b.flight and (a.index, b.index) not in chain.met
    ]


def _with_next(
    pairs: Sequence[tuple[int, int]], results: Iterable[Met | None]
) -> Iterator[tuple[tuple[int, int], Met | None, Met | None]]:
    """Yield every pair with its result and the result after it."""
    waiting: tuple[tuple[int, int], Met | None] | None = None
    for pair, found in zip(pairs, results, strict=True):
        if waiting is not None:
            yield (*waiting, found)
        waiting = pair, found
    if waiting is not None:
        yield (*waiting, None)


def _met(images: WorkingImages, job: tuple[tuple[int, int], bool, bool]) -> Met | None:
    """``_meet`` as a job that can be sent to another machine."""
    pair, video, suspect = job
    return _meet(pair, images, video=video, suspect=suspect)


def _meet(pair: tuple[int, int], images: WorkingImages, *, video: bool, suspect: bool) -> Met | None:
    """Register a pair and judge its second frame; ``None`` where a working image cannot be read."""
    a, b = pair
    try:
        (grey_a, mask_a), (grey_b, mask_b) = images.load(a), images.load(b)
    except FrameReadError as error:
        logger.warning("%s", error)
        return None
    before, frame = make_spectrum(grey_a, mask=mask_a, index=a), make_spectrum(grey_b, mask=mask_b, index=b)
    found = register(before, frame)
    if grey_a.shape != grey_b.shape:
        return Met(a, b, GOOD, found, 0.0, False)
    look_a, look_b = look_at(grey_a, mask=mask_a), look_at(grey_b, mask=mask_b)
    # a levelled frame has straight, empty borders, which look like a fault by themselves
    doubt = judge_frame(look_b, look_a).doubt if mask_b is None else 0.0
    shown = found
    if not found.accepted and (video or doubt > TRY_PARTS_DOUBT):
        part = register_part(before, grey_b)
        shown = part or found
    verdict = judge_registered(look_b, look_a, shown, doubt=doubt, suspect=suspect)
    if not video and not (verdict.ok and verdict.fault in SPOILT_PHOTO):
        verdict = GOOD  # photos come from a card, not over a link: of a link's faults only the unmistakable is believed
    if verdict.ok and verdict.fault is not None and verdict.mask is not None:
        usable = verdict.mask if mask_b is None else verdict.mask & mask_b
        verdict = replace(verdict, mask=usable)
        found = register(before, make_spectrum(grey_b, mask=usable, index=b))
    moved = _moved_px(found)
    still = moved < 1.0 and mask_b is None and is_frozen(stillness(look_b, look_a), 2.0 * EXPECTED_PX)
    return Met(a, b, verdict, found, moved, still, video)


def _moved_px(r: Registration) -> float:
    """Return how far the frame's corners moved on average, in pixels of a picture 256 wide."""
    w, h = r.size_b_px
    corners = np.array([[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]])
    d = r.T_a_b.apply(corners) - corners
    return float(np.hypot(d[:, 0], d[:, 1]).mean()) * 256.0 / max(w, h)


class _Chain:
    """What the pairs met so far say, taken in order (a builder: it owns the journal while it works)."""

    def __init__(self, mission: Mission, prepared: dict[int, PreparedFrame], images: WorkingImages) -> None:
        self._mission, self._prepared, self._images = mission, prepared, images
        self.met = {(r.a, r.b) for r in mission.registrations}
        self._vouched = {r.b for r in mission.registrations if r.accepted}
        self._streaks: Counter[int] = Counter()
        self._changed: set[int] = set()
        self._last: Met | None = None

    def begin_round(self) -> None:
        """Forget which frames changed: the pairs that follow are measured after that."""
        self._changed.clear()

    def take(self, pair: tuple[int, int], found: Met | None, following: Met | None) -> None:
        """Take a pair's result, knowing that of the next pair too."""
        a, b = pair
        if a in self._changed:
            return  # judged against a frame that has just been rejected or masked: once more, in the next round
        self.met.add(pair)
        if found is None:
            return
        verdict = found.verdict
        if found.still and self._came_at_px(a) > EXPECTED_PX:
            verdict = rejected(Fault.FROZEN)
        if verdict.ok and verdict.fault is None:
            self._keep(found)
        elif found.video and a not in self._vouched and _agrees(following, b):
            # nobody vouches for the first frame, and the one after agrees with the second: the first is the odd one
            self._mark(a, replace(verdict, ok=False))
        elif not verdict.ok and self._streaks[a] >= LONGEST_STREAK:
            self._keep(found)
        else:
            self._streaks[a] += not verdict.ok
            self._mark(b, verdict)
            if verdict.ok:
                self._keep(found)

    def _came_at_px(self, frame: int) -> float:
        """Return how far a frame had moved since the one before it, 0 where that is not known."""
        last = self._last
        return last.moved_px if last is not None and last.b == frame and last.registration.accepted else 0.0

    def _keep(self, found: Met) -> None:
        if found.registration.accepted:
            self._vouched.add(found.b)
        self._last = found
        self._mission.registrations.append(RegistrationRecord.of(found.registration, EdgeKind.SEQUENTIAL))

    def _mark(self, frame: int, verdict: FrameVerdict) -> None:
        """Write down what is wrong with a frame, and its mask where a part of it can be used."""
        if verdict.ok and verdict.mask is not None:
            grey, _ = self._images.load(frame)
            self._images.keep(frame, grey, verdict.mask)
        record = replace(self._prepared[frame], usable=verdict.ok, reason=verdict.reason)
        self._mission.prepared.append(record)
        self._prepared[frame] = record
        self._changed.add(frame)


def _agrees(found: Met | None, a: int) -> bool:
    """Whether a pair that begins with frame ``a`` is registered and fits."""
    return (
        found is not None
        and found.a == a
        and found.registration.accepted
        and found.verdict.ok
        and found.verdict.fault is None
    )
