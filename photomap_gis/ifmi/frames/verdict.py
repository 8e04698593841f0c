"""What can be found about a frame: that it is sound, spoilt in part, or of no use, and in which way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt


class Fault(StrEnum):
    """What can be wrong with a frame."""

    SIZE = "size"
    EMPTY = "empty"
    SNOW = "snow"
    FROZEN = "frozen"
    BLURRED = "blurred"
    TORN = "torn"
    BLOCKS = "blocks"
    STALE = "stale"
    MENU = "menu"

    @property
    def words(self) -> str:
        """A few words for people."""
        return _WORDS[self]


_WORDS = {
    Fault.SIZE: "too small",
    Fault.EMPTY: "empty: one grey or colour",
    Fault.SNOW: "snow: noise without a picture",
    Fault.FROZEN: "frozen: repeats the frame before",
    Fault.BLURRED: "blurred",
    Fault.TORN: "torn",
    Fault.BLOCKS: "corrupt blocks",
    Fault.STALE: "parts of an earlier frame",
    Fault.MENU: "on-screen menu",
}


@dataclass(frozen=True, slots=True, eq=False)
class FrameVerdict:
    """Whether a frame can be used, and what is wrong with it.

    ``reason`` says so in words; ``fault`` is ``None`` for a sound frame. A frame that is spoilt in part is ``ok`` with
    a ``mask``, ``(h, w)`` bool of the frame, True where it can be used; ``lost_share`` is the rest. A sound frame may
    have a mask too: of what is drawn over the picture. ``doubt`` (0..1) is how faulty a frame looks that passed; where
    it cannot be registered either, more of it is believed.
    """

    ok: bool
    reason: str | None = None
    fault: Fault | None = None
    mask: npt.NDArray[np.bool_] | None = None
    lost_share: float = 0.0
    doubt: float = 0.0

    def __post_init__(self) -> None:
        if self.mask is not None:
            mask = np.array(self.mask, np.bool_)
            mask.setflags(write=False)
            object.__setattr__(self, "mask", mask)


GOOD = FrameVerdict(True)


def rejected(fault: Fault, detail: str = "") -> FrameVerdict:
    """Return the verdict on a frame of no use."""
    return FrameVerdict(False, f"{fault.words}{detail}", fault, None, 1.0)
