"""The steps of all blocks towards their residual motion, compiled: see ``blocks``."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.descent import CAUCHY, Flags, look_up, typical
from photomap_gis.ifmi.kernels import Image32

LONGEST_STEP_PX = 2.0
FURTHEST_PX = 6.0
"""Blocks that want to move further than this many pixels of the floor have lost their way."""
SETTLED_PX = 0.25
"""Blocks that moved no more than this need no second step, .."""
FEW_UNSETTLED = 0.05
""".. nor where no more than this share of them moved further."""
LEAST_GAIN, MOST_GAIN = 0.05, 3.0
LEAST_CORRELATION = 0.3
LEAST_SURE_PX = 1.5
"""Blocks whose sigma is beyond this even in their best direction have nothing to say."""

Numbers = npt.NDArray[np.intp]


@compiled("UniTuple(f8, 3)(f8[:, ::1], f8, f8, f8)")
def through(T: FloatArray, xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Return the elements xx, xy and yy of ``T M T``, all matrices symmetric ``(2, 2)``."""
    p, q, r = T[0, 0], T[0, 1], T[1, 1]
    return (
        p * p * xx + 2.0 * p * q * xy + q * q * yy,
        p * q * xx + (p * r + q * q) * xy + q * r * yy,
        q * q * xx + 2.0 * q * r * xy + r * r * yy,
    )


@compiled("void(f8[:, ::1], i8, f4[:, ::1], i8[::1], f8[:, ::1], i8, f4[:, ::1])")
def place_moved(G: FloatArray, factor: int, Q: Image32, blocks: Numbers, d: FloatArray, n: int, xy: Image32) -> None:
    """Write where some blocks of ``n`` points each lie on a floor of a after moving by d ``(K, 2)``."""
    one, scale = np.float32(1.0), 1.0 / factor
    for k in range(len(blocks)):
        # the motion after a shift is the motion with another last column
        x0 = np.float32(scale * (G[0, 2] + G[0, 0] * d[k, 0] + G[0, 1] * d[k, 1]))
        y0 = np.float32(scale * (G[1, 2] + G[1, 0] * d[k, 0] + G[1, 1] * d[k, 1]))
        z0 = np.float32(G[2, 2] + G[2, 0] * d[k, 0] + G[2, 1] * d[k, 1])
        xu, xv = np.float32(scale * G[0, 0]), np.float32(scale * G[0, 1])
        yu, yv = np.float32(scale * G[1, 0]), np.float32(scale * G[1, 1])
        zu, zv = np.float32(G[2, 0]), np.float32(G[2, 1])
        at, to = blocks[k] * n, k * n
        for m in range(n):
            u, v = Q[0, at + m], Q[1, at + m]
            depth = one / (zu * u + zv * v + z0)
            xy[0, to + m] = (xu * u + xv * v + x0) * depth
            xy[1, to + m] = (yu * u + yv * v + y0) * depth


@compiled("void(f4[:, ::1], i8[::1], i8, f4[::1], b1[::1], f8[::1], f4[::1], f4[::1])")
def weigh_blocks(
    A: Image32, blocks: Numbers, n: int, seen: Image32, valid: Flags, gain: FloatArray, left: Image32, weight: Image32
) -> None:
    """Write every block's gain ``(K,)``, what it leaves of what is seen, and its points' weights."""
    for k in range(len(blocks)):
        cross, power = np.float32(0.0), np.float32(0.0)
        for m in range(n):
            to, at = k * n + m, blocks[k] * n + m
            if valid[to]:
                cross += A[0, at] * seen[to]
                power += A[0, at] * A[0, at]
        gain[k] = min(max(float(cross) / max(float(power), 1e-9), LEAST_GAIN), MOST_GAIN)
        for m in range(n):
            left[k * n + m] = seen[k * n + m] - np.float32(gain[k]) * A[0, blocks[k] * n + m]
    unit = np.float32(1.0 / (CAUCHY * typical(left, valid)))
    for to in range(len(weight)):
        far = left[to] * unit
        weight[to] = np.float32(valid[to]) / (np.float32(1.0) + far * far)


@compiled("void(f4[:, ::1], i8, i8, i8, f4[::1], f4[::1], f8, f8[:, ::1], f8, f8[:, ::1])")
def step_of(
    A: Image32,
    block: int,
    k: int,
    n: int,
    left: Image32,
    weight: Image32,
    gain: float,
    T: FloatArray,
    px: float,
    out: FloatArray,
) -> None:
    """Write the step of one block, the ``k``-th of those moved: x, y, curvature (xx, xy, yy), and that as it pulls.

    ``T`` is the root of the attenuation: what pulls is attenuated, the curvature is seen through the share of the
    slopes that both frames have. It goes into the row ``k`` of ``out`` ``(K, 8)``.
    """
    at, to = block * n, k * n
    hxx, hxy, hyy, bx, by = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for m in range(n):
        gx, gy, w = A[1, at + m], A[2, at + m], weight[to + m]
        hxx += w * gx * gx
        hxy += w * gx * gy
        hyy += w * gy * gy
        bx += w * gx * left[to + m]
        by += w * gy * left[to + m]
    ridge = 1e-3 * float(hxx + hyy) + 1e-6
    xx, xy, yy = through(T, float(hxx) + ridge, float(hxy), float(hyy) + ridge)
    cxx, cxy, cyy = gain * xx, gain * xy, gain * yy
    determinant = max(cxx * cyy - cxy * cxy, 1e-12)
    sx, sy = (cxy * by - cyy * bx) / determinant, (cxy * bx - cxx * by) / determinant
    cut = min(1.0, LONGEST_STEP_PX * px / max(math.hypot(sx, sy), 1e-9))
    out[k, 0], out[k, 1] = cut * sx, cut * sy
    out[k, 2], out[k, 3], out[k, 4] = hxx + ridge, hxy, hyy + ridge
    out[k, 5], out[k, 6], out[k, 7] = cxx, cxy, cyy


@compiled("void(f4[:, ::1], f4[:, ::1], i8, i8, i8, f4[::1], f4[::1], b1[::1], f8, f8[:, ::1], f8[:, ::1])")
def conclude(
    A: Image32,
    Q: Image32,
    block: int,
    k: int,
    n: int,
    left: Image32,
    weight: Image32,
    valid: Flags,
    gain: float,
    step: FloatArray,
    out: FloatArray,
) -> None:
    """Write of one block: its centre x, y, covariance (xx, xy, yy), correlation, share of points that can be seen.

    ``step`` is what ``step_of`` wrote. What is ``left`` was seen before it: what it explains is taken out of it.
    """
    at, to = block * n, k * n
    total, power, lost, present, say, cx, cy = 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0
    for m in range(n):
        value, gx, gy, w = A[0, at + m], A[1, at + m], A[2, at + m], weight[to + m]
        rest = left[to + m] + gain * (gx * step[k, 0] + gy * step[k, 1])
        total += w
        power += w * value * value
        lost += w * rest * rest
        present += valid[to + m]
        # A block's motion is that of where its contrast is, not of its middle.
        here = w * (gx * gx + gy * gy) + 1e-9
        say += here
        cx += here * Q[0, at + m]
        cy += here * Q[1, at + m]
    total = max(total, 1.0)
    sigma2, power_b = lost / total, gain * gain * power / total
    hxx, hxy, hyy, xx, xy, yy = step[k, 2], step[k, 3], step[k, 4], step[k, 5], step[k, 6], step[k, 7]
    determinant = max(xx * yy - xy * xy, 1e-12)
    unit = sigma2 / (determinant * determinant)
    out[k, 0], out[k, 1] = cx / say, cy / say
    out[k, 2] = unit * (yy * yy * hxx - 2.0 * yy * xy * hxy + xy * xy * hyy)
    out[k, 3] = unit * (-yy * xy * hxx + (xx * yy + xy * xy) * hxy - xx * xy * hyy)
    out[k, 4] = unit * (xy * xy * hxx - 2.0 * xx * xy * hxy + xx * xx * hyy)
    out[k, 5] = math.sqrt(power_b / max(power_b + sigma2, 1e-12))
    out[k, 6] = present / n


@compiled(
    "void(f4[:, ::1], f8[:, ::1], i8, f4[:, ::1], f4[:, ::1], b1[:, ::1], i8[::1], f8[:, ::1], f8[:, ::1], f8, i8,"
    " f8[:, ::1], f8[:, ::1], b1[::1], b1[::1])"
)
def settle(
    picture: Image32,
    G: FloatArray,
    factor: int,
    Q: Image32,
    A: Image32,
    usable: Flags,
    blocks: Numbers,
    start: FloatArray,
    T: FloatArray,
    px: float,
    steps: int,
    d: FloatArray,
    told: FloatArray,
    solved: Flags,
    visible: Flags,
) -> None:
    """Move K ``blocks`` from ``start`` ``(K, 2)`` to where they fit; see ``blocks.BlockMotion`` for what is written.

    ``px`` is a pixel of the floor in field coordinates, ``told`` ``(K, 7)`` what ``conclude`` says.
    """
    many, n = len(blocks), usable.shape[1]
    seen, left, weight = np.empty(many * n, np.float32), np.empty(many * n, np.float32), np.empty(many * n, np.float32)
    valid, gain, step = np.empty(many * n, np.bool_), np.empty(many), np.empty((many, 8))
    xy, those = np.empty((2, many * n), np.float32), np.empty(many * n, np.bool_)
    for k in range(many):
        d[k, 0], d[k, 1] = start[k, 0], start[k, 1]
        for m in range(n):
            those[k * n + m] = usable[blocks[k], m]
    for _ in range(steps):
        place_moved(G, factor, Q, blocks, d, n, xy)
        look_up(picture, xy, those, seen, valid)
        weigh_blocks(A, blocks, n, seen, valid, gain, left, weight)
        unsettled = 0
        for k in range(many):
            step_of(A, blocks[k], k, n, left, weight, gain[k], T, px, step)
            d[k, 0] += step[k, 0]
            d[k, 1] += step[k, 1]
            solved[k] = math.hypot(d[k, 0] - start[k, 0], d[k, 1] - start[k, 1]) <= FURTHEST_PX * px
            if not solved[k]:
                d[k, 0], d[k, 1] = start[k, 0], start[k, 1]
            unsettled += max(abs(step[k, 0]), abs(step[k, 1])) > SETTLED_PX * px
        if unsettled <= FEW_UNSETTLED * many:
            break
    for k in range(many):
        conclude(A, Q, blocks[k], k, n, left, weight, valid, gain[k], step, told)
        xx, xy, yy = told[k, 2], told[k, 3], told[k, 4]
        least = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
        visible[k] = told[k, 6] >= 0.5
        sure = least < (LEAST_SURE_PX * px) ** 2
        solved[k] = solved[k] and visible[k] and sure and gain[k] > LEAST_GAIN and told[k, 5] > LEAST_CORRELATION
