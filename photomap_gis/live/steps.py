"""What the loop says of a frame: its state, its pose, and what else it decided by it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef, ImageArray
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.chart import Belief
from photomap_gis.live.look import Witness


class FrameState(StrEnum):
    """What became of a frame in the loop."""

    TRACKED = "tracked"
    KEY = "key"
    REPEATED = "repeated"
    """The picture before once more, as pulled-down or stuttering video has it: it lies where that lay."""
    ERROR = "error"
    WAITING = "waiting"


@dataclass(frozen=True, slots=True)
class Tie:
    """A motion ``T_a_b`` between the planes of two key frames that the loop has seen; the graph measures it anew."""

    a: int
    b: int
    T_a_b: Similarity2D
    kind: EdgeKind = EdgeKind.SEQUENTIAL


@dataclass(frozen=True, slots=True, eq=False)
class NewKey:
    """A key frame that the loop has chosen: ``grey`` ``(h, w)`` is its raster, ``tie`` what it was reached from."""

    ref: FrameRef
    grey: ImageArray
    belief: Belief
    segment: int
    stream_time_s: float
    tie: Tie | None


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """A segment was recognised: the tie that says so, and the key frames that moved."""

    segment: int
    into: int
    tie: Tie
    moved: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What the loop made of a frame: its pose (``None``: the map waits), and what else it decided.

    ``promoted`` is the frame before, where it became a key frame because this one does not reach back any further.
    ``witness`` tells of a frame that was tracked whether it is spoilt in part.
    """

    ref: FrameRef
    state: FrameState
    belief: Belief | None
    view: PlaneView
    segment: int
    reason: str | None = None
    promoted: NewKey | None = None
    key: NewKey | None = None
    joined: Joined | None = None
    began: int | None = None
    probability: float = 0.0
    witness: Witness | None = None
