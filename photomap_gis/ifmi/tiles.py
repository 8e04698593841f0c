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
from photomap_gis.ifmi.kernels import Image32, forward_fft_stack, inverse_fft_stack
from photomap_gis.ifmi.overlap import full_mask
from photomap_gis.ifmi.pomf import gaussian_low_pass, whiten
from photomap_gis.ifmi.spectrum import Floor

LOW_PASS = 0.16
STRIDE = 0.5
COVERED = 0.85
MOST_TILES = 16
NEAR_PX = 3.0
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
    flags = cv2.INTER_LINEAR
    warped = cv2.warpPerspective(b.values, H, (w, h), flags=flags)
    inside = cv2.warpPerspective(full_mask(b), H, (w, h), flags=cv2.INTER_NEAREST)
    if a.mask is not None:
        inside = cv2.bitwise_and(inside, a.mask)
    side = tile_side(a.shape)
    # The share of each possible tile that lies in the overlap, from one integral image.
    total = cv2.integral(inside)
    rows = _starts(h, side)
    columns = _starts(w, side)
    y, x = (v.ravel() for v in np.meshgrid(rows, columns, indexing="ij"))
    covered = (total[y + side, x + side] - total[y, x + side] - total[y + side, x] + total[y, x]) / (255.0 * side**2)
    keep = covered >= COVERED
    x, y = x[keep], y[keep]
    if len(x) == 0:
        return None
    if len(x) > MOST_TILES:
        some = np.linspace(0, len(x) - 1, MOST_TILES).round().astype(np.intp)
        x, y = x[some], y[some]
    window = _tile_window(side)
    A = np.stack([a.values[r : r + side, c : c + side] for r, c in zip(y, x, strict=True)])
    B = np.stack([warped[r : r + side, c : c + side] for r, c in zip(y, x, strict=True)])
    A = (A - A.mean(axis=(1, 2), keepdims=True)) * window
    B = (B - B.mean(axis=(1, 2), keepdims=True)) * window
    D = whiten(forward_fft_stack(A)) * whiten(forward_fft_stack(B)).conj()
    pulses = inverse_fft_stack(D * gaussian_low_pass((side, side), LOW_PASS))
    flat = pulses.reshape(len(x), -1)
    best = flat.argmax(axis=1)
    shift = _signed(np.stack([best % side, best // side], axis=1), side)
    snr = flat[np.arange(len(x)), best] / np.maximum(flat.std(axis=1), 1e-9)
    near = np.hypot(shift[:, 0], shift[:, 1]) <= NEAR_PX
    summed = pulses.sum(axis=0)
    distance = _distance_from_zero(side)
    at_zero = float(summed[distance <= NEAR_PX].max())
    elsewhere = summed[distance > 2.5 * NEAR_PX]
    centre_a = np.stack([x, y], axis=1) + (side - 1) / 2.0
    centre_b = cv2.perspectiveTransform(centre_a[None].astype(np.float64), np.linalg.inv(H))[0]
    return TilePulses(
        centre=centre_b * f,
        shift=shift * f,
        snr=snr.astype(np.float64),
        near=near,
        summed_snr=at_zero / max(float(elsewhere.std()), 1e-9),
        rival=max(float(elsewhere.max()), 0.0) / max(at_zero, 1e-9),
    )


def tile_side(shape: tuple[int, int]) -> int:
    """Return the tiles' side: a power of two, about a third of the shorter side, 16 to 64 pixels."""
    return next((s for s in (64, 32) if min(shape) >= 2.5 * s), 16)


def _starts(length: int, side: int) -> npt.NDArray[np.intp]:
    count = max(1, round((length - side) / (STRIDE * side)) + 1)
    return np.linspace(0, length - side, count).round().astype(np.intp)


def _signed(cells: npt.NDArray[np.intp], side: int) -> FloatArray:
    return np.where(cells > side // 2, cells - side, cells).astype(np.float64)


@lru_cache(maxsize=4)
def _tile_window(side: int) -> Image32:
    one = np.hanning(side + 2)[1:-1]
    window: Image32 = np.outer(one, one).astype(np.float32)
    window.setflags(write=False)
    return window


@lru_cache(maxsize=4)
def _distance_from_zero(side: int) -> Image32:
    one = np.fft.fftfreq(side, 1.0 / side)
    distance: Image32 = np.hypot(one[:, None], one[None, :]).astype(np.float32)
    distance.setflags(write=False)
    return distance
