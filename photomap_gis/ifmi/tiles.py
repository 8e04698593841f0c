"""The cross-examination: many small matched filters over the overlap, each of which may say something else.

One strong line (a road, a shore) correlates wherever it is laid along itself, and rows of anything correlate at every
period. A phase-only filter gives no direction and no contrast more weight than another, and small tiles that are asked
one by one must all name the same shift. Their pulses summed show a single peak at zero only where the motion is right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.field import project
from photomap_gis.ifmi.field_sums import inverse
from photomap_gis.ifmi.kernels import FAR, Image32, forward_fft_stack, inverse_fft_stack
from photomap_gis.ifmi.passes import count_common, cut, phase_difference, read_sum
from photomap_gis.ifmi.pomf import gaussian_low_pass
from photomap_gis.ifmi.spectrum import Floor

LOW_PASS = 0.16
STRIDE = 0.5
COVERED = 0.85
MOST_TILES = 16
SMALLEST_SIDE = 16
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


def tile_pulses(a: Floor, b: Floor, H_a_b: FloatArray, *, narrow: bool = False) -> TilePulses | None:
    """Ask the tiles under the homography ``H_a_b`` (``(3, 3)``, frame pixels); ``None`` where none fits.

    ``narrow`` takes the smallest tiles there are: for overlaps into which no others fit.
    """
    f = a.factor
    H = np.array(H_a_b, np.float64, order="C")  # in the floor's pixels
    H[:2, 2] /= f
    H[2, :2] *= f
    h, w = a.shape
    warped = cv2.warpPerspective(
        b.seen, H, (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(FAR,) * 4
    )
    side = SMALLEST_SIDE if narrow else tile_side(a.shape)
    # The share of each possible tile that lies in the overlap, from one integral image.
    common = np.empty((h + 1, w + 1), np.int32)
    count_common(a.seen, warped, common)
    y, x, corners = _starts_in(a.shape, side)
    covered = common.ravel()[corners]
    keep = np.flatnonzero(covered[0] - covered[1] - covered[2] + covered[3] >= COVERED * side**2)
    if len(keep) == 0:
        return None
    if len(keep) > MOST_TILES:
        keep = keep[_evenly(len(keep), MOST_TILES)]
    x, y = x[keep], y[keep]
    k = len(x)
    both = np.empty((2 * k, side, side), np.float32)
    cut(a.seen, warped, y, x, _tile_window(side), both)
    F = forward_fft_stack(both).reshape(2 * k * side, -1)
    D = np.empty((k * side, F.shape[1]), np.complex64)
    phase_difference(F[: k * side], F[k * side :], gaussian_low_pass((side, side), LOW_PASS), D)
    pulses = inverse_fft_stack(D.reshape(k, side, -1))
    flat = pulses.reshape(k, -1)
    best = flat.argmax(axis=1)
    shift = np.empty((k, 2))
    shift[:, 0], shift[:, 1] = best % side, best // side
    shift[shift > side // 2] -= side
    snr = flat[np.arange(k), best].astype(np.float64) / _scatter_of_pulses(side)
    near = shift[:, 0] ** 2 + shift[:, 1] ** 2 <= NEAR_PX**2
    height, highest_far, scatter_far = read_sum(pulses, NEAR_PX, 2.5 * NEAR_PX)
    centre_a = np.empty((k, 2))
    centre_a[:, 0], centre_a[:, 1] = x + (side - 1) / 2.0, y + (side - 1) / 2.0
    centre_b = project(inverse(H), centre_a)
    return TilePulses(
        centre=centre_b * f,
        shift=shift * f,
        snr=snr,
        near=near,
        summed_snr=height / max(scatter_far, 1e-9),
        rival=max(highest_far, 0.0) / max(height, 1e-9),
    )


def tile_side(shape: tuple[int, int]) -> int:
    """Return the tiles' side: a power of two, about a third of the shorter side, 16 to 64 pixels."""
    return next((s for s in (64, 32) if min(shape) >= 2.5 * s), SMALLEST_SIDE)


Cells = npt.NDArray[np.intp]


@lru_cache(maxsize=16)
def _starts_in(shape: tuple[int, int], side: int) -> tuple[Cells, Cells, Cells]:
    """Return row and column of the first pixel of every possible tile, and its corners in the flat integral image.

    The corners are ``(4, tiles)``: the far one, the two beside it, the first.
    """
    starts = []
    for length in shape:
        count = max(1, round((length - side) / (STRIDE * side)) + 1)
        starts.append(np.linspace(0, length - side, count).round().astype(np.intp))
    y, x = (v.ravel() for v in np.meshgrid(*starts, indexing="ij"))
    row = shape[1] + 1
    first = y * row + x
    return y, x, np.stack([first + side * row + side, first + side, first + side * row, first])


@lru_cache(maxsize=256)
def _evenly(count: int, most: int) -> Cells:
    """Return ``most`` of ``count`` numbers, evenly spread."""
    return np.linspace(0, count - 1, most).round().astype(np.intp)


@lru_cache(maxsize=4)
def _scatter_of_pulses(side: int) -> float:
    """Return the standard deviation of a pulse: by Parseval's theorem that of the low-pass, whatever the tiles show."""
    g = gaussian_low_pass((side, side), LOW_PASS)
    twice = np.full(g.shape[1], 2.0)
    twice[0] = twice[-1] = 1.0
    power = float((g.astype(np.float64) ** 2 * twice).sum()) - float(g[0, 0]) ** 2
    return math.sqrt(power) / side**2


@lru_cache(maxsize=4)
def _tile_window(side: int) -> Image32:
    one = np.hanning(side + 2)[1:-1]
    window: Image32 = np.outer(one, one).astype(np.float32)
    window.setflags(write=False)
    return window
