"""The cross-examination: many small matched filters over the overlap, each of which may say something else.

One strong line (a road, a shore) correlates wherever it is laid along itself, and rows of anything correlate at every
period. A phase-only filter gives no direction and no contrast more weight than another, and small tiles that are asked
one by one must all name the same shift. Their pulses summed show a single peak at zero only where the motion is right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.field import project
from photomap_gis.ifmi.kernels import Image32, forward_fft_stack, inverse_fft_stack
from photomap_gis.ifmi.pomf import gaussian_low_pass, whiten
from photomap_gis.ifmi.spectrum import FAR, Floor

LOW_PASS = 0.16
STRIDE = 0.5
COVERED = 0.85
MOST_TILES = 16
NEAR_PX = 2.0
"""A tile votes for the motion when its peak lies this near zero, in pixels of the floor."""


@dataclass(frozen=True, slots=True, eq=False)
class TilePulses:
    """What K tiles said.

    ``centre`` ``(K, 2)`` in b's frame pixels, ``shift`` ``(K, 2)`` the motion that is missing there, in a's frame
    pixels; ``snr`` ``(K,)`` of each peak; ``near`` ``(K,)`` whether it lies at zero. ``summed_snr`` is the height near
    zero of the summed pulse over its scatter, ``rival`` the highest other value over that height.
    """

    centre: FloatArray
    shift: FloatArray
    snr: FloatArray
    near: npt.NDArray[np.bool_]
    summed_snr: float
    rival: float


def tile_pulses(a: Floor, b: Floor, H_a_b: FloatArray) -> TilePulses | None:
    """Ask the tiles under the homography ``H_a_b`` (``(3, 3)``, frame pixels); ``None`` where none fits."""
    f = a.factor
    scale = np.diag([1.0 / f, 1.0 / f, 1.0])
    H = scale @ H_a_b @ np.linalg.inv(scale)
    h, w = a.shape
    warped = cv2.warpPerspective(
        b.seen, H, (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(FAR,) * 4
    )
    inside = warped < np.float32(30.0)
    if a.mask is not None:
        inside &= a.mask > 0
    warped *= inside
    side = tile_side(a.shape)
    # The share of each possible tile that lies in the overlap, from one integral image.
    total = cv2.integral(inside.view(np.uint8))
    y, x = _starts_in(a.shape, side)
    covered = total[y + side, x + side] - total[y, x + side] - total[y + side, x] + total[y, x]
    keep = np.flatnonzero(covered >= COVERED * side**2)
    if len(keep) == 0:
        return None
    if len(keep) > MOST_TILES:
        keep = keep[np.linspace(0, len(keep) - 1, MOST_TILES).round().astype(np.intp)]
    x, y = x[keep], y[keep]
    window = _tile_window(side)
    both = np.empty((2, len(x), side, side), np.float32)
    for k, (r, c) in enumerate(zip(y.tolist(), x.tolist(), strict=True)):
        both[0, k] = a.values[r : r + side, c : c + side]
        both[1, k] = warped[r : r + side, c : c + side]
    both -= both.mean(axis=(2, 3), keepdims=True)
    both *= window
    F = whiten(forward_fft_stack(both.reshape(-1, side, side)))
    D = F[: len(x)] * F[len(x) :].conj()
    D *= gaussian_low_pass((side, side), LOW_PASS)
    pulses = inverse_fft_stack(D)
    flat = pulses.reshape(len(x), -1)
    best = flat.argmax(axis=1)
    shift = _signed(np.stack([best % side, best // side], axis=1), side)
    snr = flat[np.arange(len(x)), best] / np.maximum(flat.std(axis=1), 1e-9)
    near = np.hypot(shift[:, 0], shift[:, 1]) <= NEAR_PX
    summed = pulses.sum(axis=0)
    at_zero, elsewhere = _around_zero(side)
    height = float(summed[at_zero].max())
    rest = summed[elsewhere]
    centre_a = np.stack([x, y], axis=1) + (side - 1) / 2.0
    centre_b = project(np.asarray(np.linalg.inv(H), np.float64), np.asarray(centre_a, np.float64))
    return TilePulses(
        centre=centre_b * f,
        shift=shift * f,
        snr=snr.astype(np.float64),
        near=near,
        summed_snr=height / max(float(rest.std()), 1e-9),
        rival=max(float(rest.max()), 0.0) / max(height, 1e-9),
    )


def tile_side(shape: tuple[int, int]) -> int:
    """Return the tiles' side: a power of two, about a third of the shorter side, 16 to 64 pixels."""
    return next((s for s in (64, 32) if min(shape) >= 2.5 * s), 16)


@lru_cache(maxsize=16)
def _starts_in(shape: tuple[int, int], side: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the row and the column of the first pixel of every possible tile."""
    starts = []
    for length in shape:
        count = max(1, round((length - side) / (STRIDE * side)) + 1)
        starts.append(np.linspace(0, length - side, count).round().astype(np.intp))
    y, x = np.meshgrid(*starts, indexing="ij")
    return y.ravel(), x.ravel()


def _signed(cells: npt.NDArray[np.intp], side: int) -> FloatArray:
    return np.where(cells > side // 2, cells - side, cells).astype(np.float64)


@lru_cache(maxsize=4)
def _tile_window(side: int) -> Image32:
    one = np.hanning(side + 2)[1:-1]
    window: Image32 = np.outer(one, one).astype(np.float32)
    window.setflags(write=False)
    return window


@lru_cache(maxsize=4)
def _around_zero(side: int) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """``(side, side)`` masks of the cells near zero shift and of those well away from it."""
    one = np.fft.fftfreq(side, 1.0 / side)
    distance = np.hypot(one[:, None], one[None, :])
    return distance <= NEAR_PX, distance > 2.5 * NEAR_PX
