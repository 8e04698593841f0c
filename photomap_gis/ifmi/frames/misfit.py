"""What it means that a place does not fit: lost blocks, rows of another picture, a menu, or just a car."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.ifmi.frames.fit import Fit, Mask8
from photomap_gis.ifmi.frames.verdict import Fault

STALE_SHARE = 0.006
"""A place that shows the predecessor's own pixels counts as a lost block from this share of the frame."""
GHOST_SHARE = 0.3
DRAWN_SHARE, MOST_DRAWN = 0.08, 0.12
NEAR_BASE, WIDE_BASE = 0.78, 0.55
"""From the first overlap down trees and walls look different; below the second so much that only large places count."""
NAMED_SHARE, NAMED_SHARE_WIDE = 0.012, 0.06
SCATTERED_SHARE = 0.035
"""Small places that do not fit, all together: more than cars and leaves account for."""
SCATTERED_SHARE_WIDE = 0.14
LEAST_LIMIT = 0.2
ROW_WIDTH, ROW_HEIGHT = 0.7, 0.06
PANEL_FILL, PANEL_SHARE = 0.6, 0.06

_THREE = np.ones((3, 3), np.uint8)
_FIVE = np.ones((5, 5), np.uint8)
_SEVEN = np.ones((7, 7), np.uint8)
_WIDE = np.ones((3, 15), np.uint8)
_LARGE = np.ones((9, 9), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """What of a frame cannot be used, ``(h, w)`` of its coarse picture, 1 where it is lost; and the fault, if any.

    ``share`` of the frame does not fit; ``lost`` is that with a rim.
    """

    lost: Mask8
    share: float
    fault: Fault | None


def understand(fit: Fit, doubt: float = 0.0) -> Misfit:
    """Tell what does not fit in a comparison, and why; ``doubt`` (0..1) is how faulty the frame looks by itself."""
    places = cv2.morphologyEx(fit.misfit, cv2.MORPH_OPEN, _THREE)
    jumps = fit.light.size >= 1.0
    if not places.any() and not jumps:
        return Misfit(places, 0.0, None)
    stale, drawn = _still_places(fit)
    made = _made_by_machines(places & (1 - drawn))
    fault = _fault(made, stale, places & (1 - drawn), fit, max(LEAST_LIMIT, 1.0 - doubt))
    if jumps and fault in (None, Fault.BLOCKS):
        fault, places = Fault.BLOCKS, places | (fit.light.beyond & fit.seen)
    # between two lost places of a fault nothing is to be trusted either, though nothing may show there
    whole = places if fault is None else cv2.morphologyEx(places, cv2.MORPH_CLOSE, _LARGE) & fit.seen
    lost = cv2.dilate(whole, _THREE if fault is None else _SEVEN)
    return Misfit(lost, float(np.count_nonzero(whole)) / whole.size, fault)


def _fault(made: Mask8, stale: Mask8, loose: Mask8, fit: Fit, trust: float) -> Fault | None:
    if _is_torn(made, fit.seen):
        return Fault.TORN
    wide = min(max((NEAR_BASE - fit.overlap) / (NEAR_BASE - WIDE_BASE), 0.0), 1.0)
    named = NAMED_SHARE + wide * (NAMED_SHARE_WIDE - NAMED_SHARE)
    scattered = SCATTERED_SHARE + wide * (SCATTERED_SHARE_WIDE * fit.overlap - SCATTERED_SHARE)
    if float(made.mean()) > named * trust:
        return _name(made, stale)
    if float(stale.mean()) > named * trust:
        return Fault.STALE
    if float(loose.mean()) > scattered * trust:
        return Fault.BLOCKS
    return None


def _still_places(fit: Fit) -> tuple[Mask8, Mask8]:
    """Tell apart what stayed where it was: blocks that were not renewed, and what is drawn over every picture.

    What is drawn over both pictures leaves a second trace, where the motion carries the predecessor's copy to.
    """
    h, w = fit.misfit.shape
    stale, drawn = np.zeros((h, w), np.uint8), np.zeros((h, w), np.uint8)
    still = cv2.morphologyEx(fit.still, cv2.MORPH_CLOSE, _FIVE)
    if not still.any():
        return stale, drawn
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    apart = (cv2.dilate(still, _THREE) == 0) & (fit.seen > 0)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(still, connectivity=8)
    carried = cv2.warpPerspective(labels.astype(np.float32), fit.M_a_b, (w, h), flags=flags).astype(np.int32)
    carried[~apart] = 0
    sizes = np.bincount(carried.ravel(), minlength=count)
    traces = np.bincount(carried.ravel(), weights=fit.misfit.ravel(), minlength=count)
    large = stats[:, cv2.CC_STAT_AREA] > STALE_SHARE * still.size
    renewed = (sizes >= 8) & (traces < GHOST_SHARE * sizes)
    # what is drawn over every picture is small, or the camera would be of no use
    huge = stats[:, cv2.CC_STAT_AREA] > DRAWN_SHARE * still.size
    huge |= bool(float(still.mean()) > MOST_DRAWN)
    is_stale = (large & renewed) | huge
    is_stale[0] = False
    stale = is_stale[labels].astype(np.uint8)
    overlay = cv2.dilate(still & (1 - stale), _FIVE)
    if overlay.any():
        drawn = overlay | cv2.warpPerspective(overlay, fit.M_a_b, (w, h), flags=flags)
    return stale, drawn


def _made_by_machines(places: Mask8) -> Mask8:
    """Keep what is large, or long and level: cars and people are neither."""
    wide = cv2.morphologyEx(places, cv2.MORPH_OPEN, _WIDE)
    large = cv2.morphologyEx(places, cv2.MORPH_OPEN, _LARGE)
    return np.asarray(wide | large, np.uint8)


def _is_torn(made: Mask8, seen: Mask8) -> bool:
    """Tell whether whole rows of what both frames saw do not fit."""
    h, w = made.shape
    known = np.count_nonzero(seen, axis=1)
    closed = cv2.morphologyEx(made, cv2.MORPH_CLOSE, _FIVE) & seen
    rows = (np.count_nonzero(closed, axis=1) > ROW_WIDTH * known) & (known > 0.25 * w)
    return bool(np.count_nonzero(rows) > ROW_HEIGHT * h)


def _name(made: Mask8, stale: Mask8) -> Fault:
    w = made.shape[1]
    if stale.mean() > 0.5 * made.mean():
        return Fault.STALE
    count, _, stats, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(made, cv2.MORPH_CLOSE, _LARGE))
    if count > 1:
        bw, bh, area = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])), 2:]
        if area > PANEL_FILL * bw * bh and area > PANEL_SHARE * made.size and bw < 0.95 * w:
            return Fault.MENU
    return Fault.BLOCKS
