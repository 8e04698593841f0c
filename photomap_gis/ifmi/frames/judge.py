"""Frames that cannot be used, told from the picture itself and its predecessor, before anything is registered.

Conservative on purpose: a good frame that is thrown away leaves a hole in the map, a bad one that slips through is
looked at again when it has been registered (``registered.py``). What the predecessor shows too (letter boxes, overlays,
a soft lens) is the camera's habit, not this frame's fault.
"""

from __future__ import annotations

from photomap_gis.core.frame import ImageArray
from photomap_gis.ifmi.frames import blur
from photomap_gis.ifmi.frames.doubt import FLAT_SHARE, doubt_of
from photomap_gis.ifmi.frames.look import LEAST_SIDE_PX, FrameLook, look_at
from photomap_gis.ifmi.frames.still import is_frozen, stillness
from photomap_gis.ifmi.frames.traits import Traits
from photomap_gis.ifmi.frames.verdict import Fault, FrameVerdict, rejected

EMPTY_DEVIATION, EMPTY_NOISE, EMPTY_COHERENCE = 1.0, 2.7, 0.5
"""Standard deviation in grey levels up to which a frame shows nothing; up to the second, where it is noise only."""
FLAT_SHARE_ALONE = 0.85
STRIPED = 0.004
SNOW_COHERENCE, SNOW_LIKENESS, SNOW_DEVIATION = 0.33, 0.35, 6.0


def judge_frame(
    frame: ImageArray | FrameLook,
    predecessor: ImageArray | FrameLook | None = None,
    *,
    expected_px: float | None = None,
) -> FrameVerdict:
    """Return the verdict on a grey ``(h, w)`` uint8 frame, by itself and against its predecessor.

    Looks (``look_at``) may be given instead of pictures, so that a frame is looked at once. A predecessor of another
    size is not compared. ``expected_px`` is how far the frame should have moved, in pixels of a picture 256 wide, where
    that is known (from the motion before, or from GPS): a camera that stops dead has frozen.
    """
    look = look_at(frame)
    before = None if predecessor is None else look_at(predecessor)
    if before is not None and before.shape != look.shape:
        before = None
    if min(look.shape) < LEAST_SIDE_PX:
        return rejected(Fault.SIZE)
    empty = _empty(look.traits, None if before is None else before.traits)
    if empty is not None:
        return empty
    if _is_snow(look.traits) and (before is None or not _is_snow(before.traits)):
        return rejected(Fault.SNOW)
    if before is None:
        return FrameVerdict(True)
    if is_frozen(stillness(look, before), expected_px):
        return rejected(Fault.FROZEN)
    if blur.blur_score(look.traits, before.traits) > blur.SURE:
        return rejected(Fault.BLURRED)
    return FrameVerdict(True, doubt=doubt_of(look.traits, before.traits).of_kin)


def _empty(t: Traits, before: Traits | None) -> FrameVerdict | None:
    level = "black" if t.flat_level < 18.0 else "white" if t.flat_level > 238.0 else "one grey or colour"
    bare = t.deviation < EMPTY_DEVIATION or (t.deviation < EMPTY_NOISE and t.coherence < EMPTY_COHERENCE)
    if bare and (before is None or before.deviation > 2.0 * t.deviation):
        return rejected(Fault.EMPTY, f": {level}")
    if before is None:
        # white may be glare or snow, and black a night: without anything to compare with, it must be nearly all
        if t.flat_share > FLAT_SHARE_ALONE:
            return rejected(Fault.EMPTY, f": {t.flat_share:.0%} {level}")
    elif t.flat_share - before.flat_share > FLAT_SHARE:
        return rejected(Fault.EMPTY, f": {t.flat_share:.0%} {level}")
    if _stripes(t) < STRIPED and t.deviation > 4.0 and (before is None or _stripes(before) > 4.0 * STRIPED):
        return rejected(Fault.EMPTY, ": stripes or a test picture")
    return None


def _stripes(t: Traits) -> float:
    """Return how little a picture changes along one axis against the other."""
    along, down = float(t.far[0]), float(t.far[len(t.far) // 2])
    return min(along, down) / max(along, down, 0.1)


def _is_snow(t: Traits) -> bool:
    return (
        t.deviation > SNOW_DEVIATION
        and t.coherence < SNOW_COHERENCE
        and t.row_likeness < SNOW_LIKENESS
    )  # fmt: skip
