"""Frames judged again once they are registered: what fits nowhere, although the rest of the frame fits.

A decoder that lost data shows clean pictures, only of another moment: rows of the frame before, blocks that were not
renewed. They are told by laying the predecessor under the frame where the registration says.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.frames.blur import LIKELY, blur_score
from photomap_gis.ifmi.frames.doubt import doubt_of
from photomap_gis.ifmi.frames.drawn import drawn_out
from photomap_gis.ifmi.frames.fit import Fit, Mask8, fit
from photomap_gis.ifmi.frames.look import FrameLook, look_at
from photomap_gis.ifmi.frames.misfit import understand
from photomap_gis.ifmi.frames.rows import row_motion
from photomap_gis.ifmi.frames.traits import cut_ratio
from photomap_gis.ifmi.frames.verdict import GOOD, Fault, FrameVerdict, rejected

LEAST_OVERLAP = 0.08
LEAST_SURE = 0.5
"""A torn frame that overlaps less may be registered by the band that moved."""
MASKED_SHARE = 0.01
"""From this share of the frame on, what does not fit is masked."""
MOST_LOST = 0.45
"""Share of what both frames saw above which it is not sure any more which part is right."""
BELIEVED_DOUBT, NAMING_DOUBT = 0.5, 0.9
SUSPECT_DOUBT = 0.9
"""How faulty a frame is that the decoder complained of: what does not fit is then no car."""
KIN_PROBABILITY = 0.1
"""A registration that is not believed, but not quite out of the question either, shows the same ground."""
DRAWN_OUT = 0.7
LEAST_AGREEMENT = 0.55
"""A doubtful frame that agrees less with its predecessor is of no use, though it may be registered."""
MOST_SKEWED, LEVEL = 0.3, 0.06
SKEWED_AGREEMENT = 0.75
WRAPPED_SHARE = 0.08
WRAPPED_AGREEMENT = 0.57
WRAPPED_COVER = 0.35
NEARBY = tuple(float(v) for s in (-1.0, 1.0) for v in s * np.arange(0.04, 0.2, 0.0125))
"""Where else the other end is laid, as shares of the longer side: periods of furrows and rows are among them."""
WORSE = 0.2
SEAM_ROWS, SEAM_RATIO, SEAM_OVER_USUAL = 20, 1.1, 1.05
OBVIOUS_SEAM, ORDINARY_CUT = 5.0, 2.0
"""A cut so much sharper than anything the predecessor shows, where that ends, is the end of a picture."""


def judge_registered(
    frame: ImageArray | FrameLook,
    predecessor: ImageArray | FrameLook,
    registration: Registration,
    *,
    doubt: float = 0.0,
    suspect: bool = False,
) -> FrameVerdict:
    """Return the verdict on a frame that passed ``judge_frame``, compared with its predecessor where it is registered.

    ``registration`` carries the frame (b) into its predecessor (a), in pixels of the pictures given. ``doubt`` is that
    of the first verdict: it is believed where nothing could be registered. ``suspect`` tells that the decoder lost data
    since the last key frame. What does not fit is masked, a fault or not; a frame of which too much is lost is
    rejected.
    """
    look, before = look_at(frame), look_at(predecessor)
    if look.shape != before.shape:
        return GOOD
    if not registration.accepted:
        return _unregistered(look, before, 1.0 if suspect else doubt, registration.probability, suspect=suspect)
    H = registration.T_a_b.matrix if registration.H_a_b is None else registration.H_a_b
    doubt = max(doubt, SUSPECT_DOUBT) if suspect else doubt
    found = fit(look, before, np.asarray(H, np.float64))
    if skew(H) > MOST_SKEWED and found.agreement > SKEWED_AGREEMENT:
        return rejected(Fault.TORN, ": its rows are displaced")
    if found.overlap < LEAST_OVERLAP:
        return GOOD
    if doubt > BELIEVED_DOUBT and found.agreement < LEAST_AGREEMENT:
        blurred = blur_score(look.traits, before.traits) > LIKELY
        return rejected(Fault.BLURRED if blurred else Fault.BLOCKS)
    if _is_wrapped(look, before, found, H):
        return rejected(Fault.TORN, ": its parts have changed places")
    misfit = understand(found, doubt)
    if misfit.share < MASKED_SHARE:
        return GOOD
    if doubt >= 1.0:
        return rejected(misfit.fault or Fault.BLOCKS)
    fault = misfit.fault or (Fault.BLOCKS if doubt >= NAMING_DOUBT else None)
    words = None if fault is None else f"{fault.words}: {misfit.share:.0%} lost"
    if misfit.share > MOST_LOST * found.overlap or (fault is Fault.TORN and found.overlap < LEAST_SURE):
        fault = fault or Fault.BLOCKS
        return FrameVerdict(False, f"{fault.words}: {misfit.share:.0%} lost", fault, None, misfit.share)
    return FrameVerdict(True, words, fault, _usable(misfit.lost, look.shape), misfit.share)


def _unregistered(
    look: FrameLook, before: FrameLook, doubt: float, probability: float, *, suspect: bool
) -> FrameVerdict:
    """Return the verdict on a frame that fits nowhere as a whole: perhaps its rows do, or it is no picture at all."""
    if look.usable is not None or before.usable is not None:  # their borders are straight and stay where they are
        return rejected(Fault.BLOCKS, ", and it fits nowhere") if doubt > BELIEVED_DOUBT else GOOD
    rows = row_motion(look, before)
    if rows.is_torn:
        return rejected(Fault.TORN, ": its rows are displaced")
    if drawn_out(look.coarse) - max(0.0, drawn_out(before.coarse)) > DRAWN_OUT:
        return rejected(Fault.BLOCKS, ": drawn out")
    if rows.known_share == 0.0 and probability < KIN_PROBABILITY and not suspect:
        # no sign of ground in common: what is new about the frame may be the place
        doubt = min(doubt, doubt_of(look.traits, before.traits).of_strangers)
    return rejected(Fault.BLOCKS, ", and it fits nowhere") if doubt > BELIEVED_DOUBT else GOOD


def skew(H_a_b: FloatArray) -> float:
    """Return by how much each row lies further than the one above (px per px), 0 where rows do not stay rows.

    A camera that leans and turns skews a picture, too, but not along its rows alone.
    """
    H = np.asarray(H_a_b, np.float64) / H_a_b[2, 2]
    level = abs(H[1, 0]) < LEVEL and abs(H[1, 1] - H[0, 0]) < 2.0 * LEVEL
    return float(abs(H[0, 1])) if level else 0.0


def _usable(lost: Mask8, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return what is not lost as a mask of the whole frame."""
    whole = cv2.resize(lost * np.uint8(255), (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole < 64)


def _is_wrapped(look: FrameLook, before: FrameLook, found: Fit, H_a_b: FloatArray) -> bool:
    """Tell whether the part that the predecessor seems not to show is its other end: a picture that rolled over."""
    h, w = look.shape
    unseen = found.seen == 0
    for axis, dx, dy in ((0, 0.0, float(h)), (1, float(w), 0.0)):
        lines = unseen.mean(axis=1 - axis) > 0.9
        if lines.mean() < WRAPPED_SHARE or not (lines[0] or lines[-1]):
            continue
        seam = _seam(look.fine, axis, lines)
        if seam > OBVIOUS_SEAM and _cuts(before.fine, axis).max(initial=0.0) < ORDINARY_CUT:
            return True
        sign = 1.0 if lines[0] else -1.0
        rolled = np.array([[1.0, 0.0, sign * dx], [0.0, 1.0, sign * dy], [0.0, 0.0, 1.0]])
        other = fit(look, before, np.asarray(H_a_b @ rolled, np.float64))
        if (
            other.agreement > WRAPPED_AGREEMENT
            and other.overlap > WRAPPED_COVER * float(unseen.mean())
            and (seam > SEAM_RATIO or _fits_only_there(look, before, H_a_b, rolled, other.agreement))
        ):
            return True
    return False


def _fits_only_there(
    look: FrameLook, before: FrameLook, H_a_b: FloatArray, rolled: FloatArray, agreement: float
) -> bool:
    """Tell whether the other end fits worse a little before and after: ground that repeats itself fits there too."""
    step = rolled[:2, 2] / np.linalg.norm(rolled[:2, 2]) * max(look.shape)
    for share in NEARBY:
        near = rolled.copy()
        near[:2, 2] += share * step
        if fit(look, before, np.asarray(H_a_b @ near, np.float64)).agreement > agreement - WORSE:
            return False
    return True


def _seam(fine: ImageArray, axis: int, unseen: npt.NDArray[np.bool_]) -> float:
    """Return how sharply the picture is cut near what was not seen, 0 where it is cut as sharply elsewhere.

    Ground that repeats itself fits a frame's height off, too, but is not cut there.
    """
    ratio = _cuts(fine, axis)
    if not len(ratio):
        return 0.0
    # the camera moved besides: the cut may lie anywhere in what was not seen
    rows = cv2.resize(unseen.astype(np.uint8)[:, None], (1, len(ratio)), interpolation=cv2.INTER_NEAREST)
    near = cv2.dilate(rows, np.ones((2 * SEAM_ROWS + 1, 1), np.uint8))[:, 0] > 0
    usual = float(ratio[~near].max(initial=0.0))  # furrows along the axis cut it everywhere
    sharpest = float(ratio[near].max(initial=0.0))
    return sharpest if sharpest > SEAM_OVER_USUAL * usual else 0.0


def _cuts(fine: ImageArray, axis: int) -> npt.NDArray[np.float32]:
    """Return how sharply each row (axis 0) or column (axis 1) is cut off from the next."""
    return cut_ratio(fine if axis == 0 else np.ascontiguousarray(fine.T))
