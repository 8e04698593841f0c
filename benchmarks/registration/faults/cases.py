"""A judged frame with its predecessor, and what is meant by a fault: damage that is measured, not intended.

A frame made by breaking a sound one is *faulty* only where at least ``FAULTY_SHARE`` of its pixels are damaged: no
pixel of the clean picture within ``NEAR`` of them (2 px at 256) comes near their value. Less is called harmless and
belongs to neither side: packets whose loss the decoder concealed, a band moved by a pixel. Frozen and blurred frames
are faulty by what was done to them: a repeat of the predecessor where the true frame differs from it, a blur beyond
``broken.HEAVY_BLUR`` and ``broken.HEAVY_SMEAR``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.ifmi.working import shrink

Grey = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Matrix = npt.NDArray[np.float64]
FAULTY_SHARE = 0.03
NEAR = 0.008
"""Displacement that is no damage, as a share of the width."""
SPECK = 0.016
"""Damage narrower than this share of the width is none (4 px at 256: a block of 10 px at 640)."""
NOTHING = 0.002
STRONG_GREY = 8.0
STRONG_CONTRAST = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What is judged: a working frame and the last sound one before it.

    ``kind`` is the fault or the kind of sound frame, ``variety`` how it was made; ``clean`` is the frame before it was
    broken and ``damaged`` ``(h, w)`` where it differs strongly from that. ``expected_px`` is how far the camera would
    have moved (in pixels of a picture 256 wide), as the motion before tells; ``H_previous_frame`` the true homography
    between working pixels, where it is asked for. ``suspect`` tells that the decoder lost data since the last key
    frame.
    """

    kind: str
    variety: str
    faulty: bool
    frame: Grey
    previous: Grey | None
    clean: Grey | None = None
    damaged: npt.NDArray[np.bool_] | None = None
    seed: int = 0
    expected_px: float | None = None
    H_previous_frame: npt.NDArray[np.float64] | None = None
    suspect: bool = False

    @property
    def damage(self) -> float:
        """Share of the pixels that differ strongly."""
        return 0.0 if self.damaged is None else float(self.damaged.mean())


def strong_difference(
    clean: Grey, shown: Grey, *, drifted: bool = False, motions: Sequence[Matrix] = ()
) -> npt.NDArray[np.bool_]:
    """``(h, w)`` True where a frame shows what its clean picture shows nowhere near.

    Strongly is by more than 0.3 of the clean picture's own standard deviation, and by 8 grey levels at least, after
    gain and offset of the whole are evened out. Where the frame as a whole fits better displaced (its link lost a
    motion, not the picture), it is compared displaced; by a smooth field of small displacements too where it may have
    ``drifted``, as a decoder's picture does when it goes on from a lost reference. ``motions`` ``(3, 3)`` carry the
    frame's pixels to where the clean picture would show them if the camera stood where it did at other moments.
    """
    best = _beyond(clean, shown)
    for moved in _displaced(clean, shown, motions) if float(best.mean()) >= FAULTY_SHARE else ():
        best = moved if moved.mean() < best.mean() else best
        if float(best.mean()) < NOTHING:
            break
    if drifted and float(best.mean()) >= FAULTY_SHARE:
        moved = _drifted(clean, shown)
        best = moved if moved.mean() < best.mean() else best
    return best


def _drifted(clean: Grey, shown: Grey) -> npt.NDArray[np.bool_]:
    """Compare with the clean picture displaced by a field that bends over a tenth of the width, up to 6 % of it."""
    h, w = clean.shape
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(
        shown, clean, np.zeros((h, w, 2), np.float32)
    )
    smooth = [cv2.GaussianBlur(np.ascontiguousarray(flow[..., k]), (0, 0), 0.1 * w) for k in (0, 1)]
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    dx, dy = (np.clip(f, -0.06 * w, 0.06 * w).astype(np.float32) for f in smooth)
    moved = cv2.remap(clean, x + dx, y + dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # what the clean picture does not reach to tells nothing, as where the frame is displaced as a whole
    reached = (x + dx > -0.5) & (x + dx < w - 0.5) & (y + dy > -0.5) & (y + dy < h - 0.5)
    return _beyond(np.asarray(moved, np.uint8), shown) & reached


def seen_before(
    H_ground_previous: Matrix, H_ground_frame: Matrix, whole: tuple[int, int], shape: tuple[int, ...]
) -> Mask:
    """``shape`` True where a working frame shows what its predecessor showed too; ``whole`` is the frames' shape."""
    h, w = whole
    H = np.linalg.inv(H_ground_previous) @ H_ground_frame
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    seen = cv2.warpPerspective(np.full((h, w), 255, np.uint8), H, (w, h), flags=flags)
    return np.asarray(cv2.resize(seen, shape[::-1], interpolation=cv2.INTER_AREA) > 250)


def _beyond(clean: Grey, shown: Grey) -> npt.NDArray[np.bool_]:
    side = 2 * max(1, round(NEAR * clean.shape[1])) + 1
    square = np.ones((side, side), np.uint8)
    limit = max(STRONG_GREY, STRONG_CONTRAST * float(clean.std()))
    # means over 3 x 3 pixels, or the sensor's noise would count
    whole, seen = (cv2.blur(g, (3, 3)).astype(np.float32) for g in (clean, shown))
    seen = _evened(seen, whole)
    beyond = np.maximum(seen - cv2.dilate(whole, square), cv2.erode(whole, square) - seen)
    # single pixels and thin lines, as along every edge that lies a pixel off, are no damage
    speck = np.ones((max(3, round(SPECK * clean.shape[1])),) * 2, np.uint8)
    return np.asarray(cv2.morphologyEx((beyond > limit).astype(np.uint8), cv2.MORPH_OPEN, speck), bool)


def _evened(seen: npt.NDArray[np.float32], whole: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Give a frame the brightness of its clean picture, where they have much in common."""
    s, c = seen.ravel()[::7], whole.ravel()[::7]
    if float(s.std()) < 2.0 or float(np.corrcoef(s, c)[0, 1]) < 0.6:
        return seen
    gain, offset = np.polyfit(s, c, 1)
    near = np.abs(gain * s + offset - c) < 1.5 * float(np.std(gain * s + offset - c)) + 1.0
    gain, offset = np.polyfit(s[near], c[near], 1)
    return np.asarray(gain * seen + offset, np.float32) if 0.7 < gain < 1.4 else seen


def _displaced(clean: Grey, shown: Grey, motions: Sequence[Matrix]) -> Iterator[npt.NDArray[np.bool_]]:
    """Compare with the clean picture laid under the frame by the affine motions that fit best, if there are any.

    ``motions`` are further ones to begin from.
    """
    k = max(1, clean.shape[1] // 128)
    a, b = (
        cv2.resize(g, None, fx=1 / k, fy=1 / k, interpolation=cv2.INTER_AREA).astype(np.float32) for g in (shown, clean)
    )
    (dx, dy), _ = cv2.phaseCorrelate(a, b, cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F))
    starts = [(0.0, 0.0)] + ([(dx, dy)] if 1.0 < max(abs(dx), abs(dy)) < 0.3 * a.shape[1] else [])
    middle = np.array([clean.shape[1] / 2.0, clean.shape[0] / 2.0, 1.0])
    for H in motions:
        there = H @ middle
        starts.append(tuple((there[:2] / there[2] - middle[:2]) / k))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)
    for x, y in starts:
        motion = np.array([[1.0, 0.0, x], [0.0, 1.0, y]], np.float32)
        try:
            _, motion = cv2.findTransformECC(a, b, motion, cv2.MOTION_AFFINE, criteria, None, 5)
        except cv2.error:
            continue
        motion[:, 2] *= k
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = clean.shape[::-1]
        moved = cv2.warpAffine(clean, motion, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        seen = cv2.warpAffine(np.full_like(clean, 255), motion, size, flags=flags)
        yield _beyond(moved, shown) & (seen > 250)


def repeats(frame: Grey, previous: Grey) -> bool:
    """Tell whether most of a frame is its predecessor to the bit: the coder left it out, so it is no sound frame."""
    return frame.shape == previous.shape and float((frame == previous).mean()) > 0.6


def moved_px(H_ground_previous: npt.NDArray[np.float64], H_ground_frame: npt.NDArray[np.float64], frame: Grey) -> float:
    """Return how far a frame's corners moved on average, in pixels of a picture 256 wide."""
    h, w = frame.shape
    corners = np.array([[0.0, w, 0.0, w], [0.0, 0.0, h, h], [1.0, 1.0, 1.0, 1.0]])
    p = np.linalg.inv(H_ground_previous) @ H_ground_frame @ corners
    d = p[:2] / p[2] - corners[:2]
    return float(np.hypot(d[0], d[1]).mean()) * 256.0 / max(w, h)


def working(frame: Grey, size_px: int) -> Grey:
    """Return the frame as the pipeline judges it."""
    return shrink(frame, size_px)[0]
