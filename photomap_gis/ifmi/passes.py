"""Single passes over spectra, pulses and pairs of pictures, compiled: what NumPy takes apart into many."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.descent import look_up
from photomap_gis.ifmi.kernels import UNSEEN, Image32, Spectrum64

Numbers = npt.NDArray[np.intp]
TINY = 1e-12
"""Coefficients of no length have no phase: they stay 0."""


@compiled("void(c8[:, ::1], c8[:, ::1])")
def whitened(F: Spectrum64, out: Spectrum64) -> None:
    """Write ``exp(i PHASE(F))``."""
    for r in range(F.shape[0]):
        for c in range(F.shape[1]):
            x, y = F[r, c].real, F[r, c].imag
            one = np.float32(1.0) / (np.float32(math.sqrt(x * x + y * y)) + np.float32(TINY))
            out[r, c] = complex(x * one, y * one)


@compiled("void(c8[:, ::1], c8[:, ::1], Array(f4, 2, 'C', True), c8[:, ::1])")
def phase_difference(A: Spectrum64, B: Spectrum64, low_pass: Image32, out: Spectrum64) -> None:
    """Write ``exp(i (PHASE(A) - PHASE(B)))``, low-passed; spectra of one shape, or stacks of the low-pass's."""
    rows = low_pass.shape[0]
    for start in range(0, A.shape[0], rows):
        for r in range(rows):
            for c in range(A.shape[1]):
                a, b = A[start + r, c], B[start + r, c]
                x, y, u, v = a.real, a.imag, b.real, b.imag
                length = np.float32(math.sqrt(x * x + y * y)) * np.float32(math.sqrt(u * u + v * v))
                one = low_pass[r, c] / (length + np.float32(TINY))
                out[start + r, c] = complex((x * u + y * v) * one, (y * u - x * v) * one)


@compiled("void(c8[:, ::1], c8[:, ::1])")
def powers(F: Spectrum64, out: Spectrum64) -> None:
    """Write the squared magnitudes as a spectrum."""
    for r in range(F.shape[0]):
        for c in range(F.shape[1]):
            x, y = F[r, c].real, F[r, c].imag
            out[r, c] = complex(x * x + y * y, np.float32(0.0))


@compiled("b1(f4[:, ::1], f4[:, ::1], b1[:, ::1], f8)")
def reaches(values: Image32, weight: Image32, allowed: npt.NDArray[np.bool_], least: float) -> bool:
    """Return whether a weighted value reaches ``least`` where it is allowed to."""
    limit = np.float32(least)
    for r in range(values.shape[0]):
        count = 0
        for c in range(values.shape[1]):
            count += allowed[r, c] and values[r, c] * weight[r, c] >= limit
        if count > 0:
            return True
    return False


@compiled("i8(f4[:, ::1], f4[:, ::1], f8[:, ::1], f8[::1])")
def compare(a: Image32, b: Image32, H_b_a: FloatArray, sums: FloatArray) -> int:
    """Compare a with b where a homography takes its pixels; return how many can be seen in both.

    Written are the sums ``(5,)`` of a, b, a a, a b, b b over them.
    """
    h, w = a.shape
    xy, seen = np.empty((2, w), np.float32), np.empty(w, np.float32)
    usable, valid = np.empty(w, np.bool_), np.empty(w, np.bool_)
    count = 0
    sums[:] = 0.0
    for r in range(h):
        for c in range(w):
            depth = H_b_a[2, 0] * c + H_b_a[2, 1] * r + H_b_a[2, 2]
            xy[0, c] = (H_b_a[0, 0] * c + H_b_a[0, 1] * r + H_b_a[0, 2]) / depth
            xy[1, c] = (H_b_a[1, 0] * c + H_b_a[1, 1] * r + H_b_a[1, 2]) / depth
            usable[c] = a[r, c] < UNSEEN
        here = look_up(b, xy, usable, seen, valid)
        if here == 0:
            continue
        count += here
        x, y, xx, cross, yy = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for c in range(w):
            u = a[r, c] if valid[c] else np.float32(0.0)
            v = seen[c] if valid[c] else np.float32(0.0)
            x += u
            y += v
            xx += u * u
            cross += u * v
            yy += v * v
        sums[0] += x
        sums[1] += y
        sums[2] += xx
        sums[3] += cross
        sums[4] += yy
    return count


@compiled("void(f4[:, ::1], f4[:, ::1], i4[:, ::1])")
def count_common(a: Image32, b: Image32, total: npt.NDArray[np.int32]) -> None:
    """Write the integral image ``(h + 1, w + 1)`` of where both pictures can be seen."""
    total[0, :] = 0
    for r in range(a.shape[0]):
        here = 0
        total[r + 1, 0] = 0
        for c in range(a.shape[1]):
            here += a[r, c] < UNSEEN and b[r, c] < UNSEEN
            total[r + 1, c + 1] = total[r, c + 1] + here


@compiled("void(f4[:, ::1], f4[:, ::1], i8[::1], i8[::1], Array(f4, 2, 'C', True), f4[:, :, ::1])")
def cut(a: Image32, b: Image32, y: Numbers, x: Numbers, window: Image32, tiles: Image32) -> None:
    """Write K windowed tiles of a, and behind them those of b, freed of their mean; what is not seen is 0.

    ``tiles`` is ``(2 K, side, side)``; they begin at rows y and columns x.
    """
    many, side = len(y), len(window)
    for k in range(2 * many):
        picture, r0, c0 = (a, y[k], x[k]) if k < many else (b, y[k - many], x[k - many])
        total = np.float32(0.0)
        for r in range(side):
            for c in range(side):
                value = picture[r0 + r, c0 + c]
                tiles[k, r, c] = value if value < UNSEEN else np.float32(0.0)
                total += tiles[k, r, c]
        mean = total / np.float32(side * side)
        for r in range(side):
            for c in range(side):
                tiles[k, r, c] = (tiles[k, r, c] - mean) * window[r, c]


@compiled("UniTuple(f8, 3)(f4[:, :, ::1], f8, f8)")
def read_sum(pulses: Image32, near_px: float, far_px: float) -> tuple[float, float, float]:
    """Return of the sum of K pulses its height near zero shift, the highest value far from it, and the scatter there.

    ``pulses`` is ``(K, side, side)``.
    """
    many, side = len(pulses), pulses.shape[1]
    summed = np.zeros((side, side), np.float32)
    for k in range(many):
        for r in range(side):
            for c in range(side):
                summed[r, c] += pulses[k, r, c]
    near, far, total, squares, count = -np.inf, -np.inf, 0.0, 0.0, 0
    for r in range(side):
        for c in range(side):
            distance2 = float(min(r, side - r) ** 2 + min(c, side - c) ** 2)
            if distance2 <= near_px**2:
                near = max(near, float(summed[r, c]))
            elif distance2 > far_px**2:
                far = max(far, float(summed[r, c]))
                total += summed[r, c]
                squares += summed[r, c] * summed[r, c]
                count += 1
    mean = total / count
    return near, far, math.sqrt(max(squares / count - mean * mean, 0.0))
