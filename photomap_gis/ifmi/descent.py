"""The loop of the refinement, compiled: Gauss-Newton steps over the points of a template (see ``align``).

One step looks b's points up in a, weighs what is left of them robustly, and gathers all sums of products of b's value
and derivatives, ``A`` ``(9, N)``, in one pass. Everything here writes into what it is given.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.kernels import UNSEEN, Image32
from photomap_gis.ifmi.small import eigen, ranked, solve

Flags = npt.NDArray[np.bool_]

CAUCHY = 2.0
"""Residuals beyond this many robust sigmas lose weight: shadows, cars, people, relief."""
SCALE_STEPS = 2
"""So many steps measure the robust sigma; later ones take it over."""
YIELDING = 0.25
"""Stiffness falls to so much of itself at every step."""
PATIENCE, RISE = 4, 0.003
"""After so many steps more are taken only while each raises the correlation by this much."""
FEWEST_POINTS = 50
LONGEST_STEP_PX = 4.0
LEAST_GAIN = 0.03
CLEAN = 0.97
"""From this correlation on b's own slopes are as good as those of both frames."""
LEAST_ATTENUATION = 0.15
SLACK_PX = 0.4
"""So far may a point lie from where the motion puts it, in pixels of the floor, before it counts as an outlier."""
COMPANY = 0.1
""".. and so large a share of its block's points must be outliers with it."""
CHUNK = 512
"""So many points of all derivatives stay in the processor's first cache."""


@compiled("f4(f4[:, ::1], f4, f4)")
def value_or_zero(picture: Image32, x: np.float32, y: np.float32) -> np.float32:
    """Return the bilinear value at a place that may lie on the border or beyond, where the picture holds 0."""
    h, w = picture.shape
    if not (-1.0 < x < w and -1.0 < y < h):
        return np.float32(0.0)
    column, row = math.floor(x), math.floor(y)
    dx, dy, value = x - np.float32(column), y - np.float32(row), np.float32(0.0)
    for i in range(max(row, 0), min(row + 2, h)):
        for j in range(max(column, 0), min(column + 2, w)):
            share = (dx if j > column else np.float32(1.0) - dx) * (dy if i > row else np.float32(1.0) - dy)
            value += share * picture[i, j]
    return value


@compiled("void(f8[:, ::1], i8, f4[:, ::1], f4[:, ::1])")
def place(G: FloatArray, factor: int, Q: Image32, xy: Image32) -> None:
    """Write where b's field coordinates Q ``(3, N)`` lie on a floor of a, in its pixels, into xy ``(2, N)``."""
    g = np.empty((3, 3), np.float32)
    for i in range(3):
        for j in range(3):
            g[i, j] = G[i, j] if i == 2 else G[i, j] / factor
    for n in range(Q.shape[1]):
        u, v = Q[0, n], Q[1, n]
        depth = np.float32(1.0) / (g[2, 0] * u + g[2, 1] * v + g[2, 2])
        xy[0, n] = (g[0, 0] * u + g[0, 1] * v + g[0, 2]) * depth
        xy[1, n] = (g[1, 0] * u + g[1, 1] * v + g[1, 2]) * depth


@compiled("i8(f4[:, ::1], f4[:, ::1], b1[::1], f4[::1], b1[::1])")
def look_up(picture: Image32, xy: Image32, usable: Flags, seen: Image32, valid: Flags) -> int:
    """Write the picture's values at xy ``(2, N)``, 0 where nothing can be seen; return at how many something can."""
    h, w = picture.shape
    flat, below, one = picture.ravel(), np.uint64(w), np.uint64(1)
    zero, right, bottom, unseen = np.float32(0.0), np.float32(w - 1), np.float32(h - 1), np.float32(UNSEEN)
    last_column, last_row = np.float32(w - 2), np.float32(h - 2)
    for n in range(len(seen)):
        x, y = xy[0, n], xy[1, n]
        inside = x >= zero and x <= right and y >= zero and y <= bottom
        # What is no number or lies outside is read at the first pixel. Everything is written out without a branch, and
        # with numbers that cannot be negative: this is the innermost of all loops.
        x, y = x if inside else zero, y if inside else zero
        left, top = x if x < last_column else last_column, y if y < last_row else last_row
        column, row = np.uint64(left), np.uint64(top)
        dx, dy, at = x - np.float32(column), y - np.float32(row), row * below + column
        v00, v01, v10, v11 = flat[at], flat[at + one], flat[at + below], flat[at + below + one]
        upper, lower = v00 + dx * (v01 - v00), v10 + dx * (v11 - v10)
        value = upper + dy * (lower - upper)
        can = inside and value < unseen
        seen[n] = value if can else zero
        valid[n] = can
    count = 0
    for n in range(len(seen)):
        valid[n] = valid[n] and usable[n]
        count += valid[n]
    return count


@compiled("f8(f4[::1], b1[::1])")
def typical(residual: Image32, valid: Flags) -> float:
    """Return the robust sigma of residuals; some hundreds are enough to tell it."""
    stride = max(1, len(residual) // 600)
    some = np.empty(len(residual) // stride + 1, np.float32)
    count = 0
    for n in range(0, len(residual), stride):
        if valid[n]:
            some[count] = abs(residual[n])
            count += 1
    if count == 0:
        return 1.0
    return 1.4826 * ranked(some[:count], count // 2) + 1e-6


@compiled("void(f4[::1], f4[::1], b1[::1], f8, f8, f4[::1])")
def weigh(seen: Image32, value: Image32, valid: Flags, gain: float, unit: float, weight: Image32) -> None:
    """Write Cauchy's weight of every point: less where what is left of it is large in units of ``1 / unit``."""
    g, u = np.float32(gain), np.float32(unit)
    for n in range(len(weight)):
        left = (seen[n] - g * value[n]) * u
        weight[n] = np.float32(valid[n]) / (np.float32(1.0) + left * left)


@compiled("f8(f4[::1], f4[::1], b1[::1])")
def _dot(x: Image32, y: Image32, valid: Flags) -> float:
    total = np.float32(0.0)
    for n in range(len(x)):
        total += x[n] * y[n] * np.float32(valid[n])
    return float(total)


@compiled("void(f4[:, ::1], f4[:, ::1], f4[::1], b1, f8[:, ::1])")
def products(A: Image32, B: Image32, weight: Image32, symmetric: bool, sums: FloatArray) -> None:
    """Write the weighted sums of products of the first rows of A with those of B, their symmetric part.

    As many rows as ``sums`` has; ``symmetric`` says that B is A.
    """
    m = len(sums)
    sums[:] = 0.0
    row = np.empty(CHUNK, np.float32)
    for start in range(0, len(weight), CHUNK):
        w = weight[start : start + CHUNK]
        for i in range(m):
            x = A[i, start : start + CHUNK]
            for n in range(len(w)):
                row[n] = w[n] * x[n]
            for j in range(i if symmetric else 0, m):
                y = B[j, start : start + CHUNK]
                total = np.float32(0.0)
                for n in range(len(w)):
                    total += row[n] * y[n]
                sums[i, j] += total
    for i in range(m):
        for j in range(i):
            sums[i, j] = sums[j, i] = sums[j, i] if symmetric else 0.5 * (sums[i, j] + sums[j, i])


@compiled("void(f4[:, ::1], f4[::1], f4[::1], f8[::1])")
def pulls(A: Image32, seen: Image32, weight: Image32, sums: FloatArray) -> None:
    """Write the weighted sums of products of the first rows of A with what is seen, as many as ``sums`` has."""
    for i in range(len(sums)):
        total = np.float32(0.0)
        for n in range(len(weight)):
            total += weight[n] * seen[n] * A[i, n]
        sums[i] = total


@compiled("void(f4[:, ::1], f4[:, ::1])")
def write_derivative(Q: Image32, J: Image32) -> None:
    """Fill the rows of J ``(4 or 8, N)`` after the first two, the slopes by x and y at Q, with those by the field's
    further parameters."""
    bends = len(J) > 4
    for n in range(J.shape[1]):
        x, y, gx, gy = Q[0, n], Q[1, n], J[0, n], J[1, n]
        radial = gx * x + gy * y
        J[2, n] = gy * x - gx * y
        J[3, n] = radial
        if bends:
            J[4, n] = gx * x - gy * y
            J[5, n] = gx * y + gy * x
            J[6, n] = radial * x
            J[7, n] = radial * y


@compiled("void(f4[:, ::1], f8[:, ::1], i8, f4[:, ::1], f4[:, ::1], f4[:, ::1])")
def slopes_of_a(picture: Image32, G: FloatArray, factor: int, Q: Image32, xy: Image32, J: Image32) -> None:
    """Write the derivative of a's values at b's points by the first ``len(J)`` parameters of the motion."""
    # The chain rule, with the motion's linear part in the frame's middle: a good curvature is enough.
    unit = 0.5 / (G[2, 2] * factor)
    xu = np.float32(unit * (G[0, 0] - G[0, 2] * G[2, 0] / G[2, 2]))
    xv = np.float32(unit * (G[0, 1] - G[0, 2] * G[2, 1] / G[2, 2]))
    yu = np.float32(unit * (G[1, 0] - G[1, 2] * G[2, 0] / G[2, 2]))
    yv = np.float32(unit * (G[1, 1] - G[1, 2] * G[2, 1] / G[2, 2]))
    h, w = picture.shape
    flat, below, one = picture.ravel(), np.uint64(w), np.uint64(1)
    first, right, bottom = np.float32(1.0), np.float32(w - 2), np.float32(h - 2)
    for n in range(xy.shape[1]):
        x, y = xy[0, n], xy[1, n]
        inside = x >= first and x < right and y >= first and y < bottom
        x, y = x if inside else first, y if inside else first  # without a branch, as ``look_up``
        column, row = np.uint64(x), np.uint64(y)
        dx, dy, at = x - np.float32(column), y - np.float32(row), row * below + column
        v00, v01, v10, v11 = flat[at], flat[at + one], flat[at + below], flat[at + below + one]
        before, after = v01 - flat[at - one], flat[at + one + one] - v00
        upper = before + dx * (after - before)
        before, after = v11 - flat[at + below - one], flat[at + below + one + one] - v10
        J[0, n] = upper + dy * (before + dx * (after - before) - upper)
        before, after = v10 - flat[at - below], v11 - flat[at - below + one]
        upper = before + dx * (after - before)
        before, after = flat[at + below + below] - v00, flat[at + below + below + one] - v01
        J[1, n] = upper + dy * (before + dx * (after - before) - upper)
    for n in range(xy.shape[1]):
        x, y = xy[0, n], xy[1, n]
        near_border = not (x >= first and x < right and y >= first and y < bottom)
        if near_border and x >= 0.0 and x < w and y >= 0.0 and y < h:  # what lies further out cannot be seen anyway
            J[0, n] = value_or_zero(picture, x + first, y) - value_or_zero(picture, x - first, y)
            J[1, n] = value_or_zero(picture, x, y + first) - value_or_zero(picture, x, y - first)
    for n in range(xy.shape[1]):
        sx, sy = J[0, n], J[1, n]
        J[0, n] = xu * sx + yu * sy
        J[1, n] = xv * sx + yv * sy
    write_derivative(Q, J)


@compiled("void(f8[:, ::1], f8[:, ::1])")
def keep_within(both: FloatArray, alone: FloatArray) -> None:
    """Keep a curvature between a small share of another and all of it, direction by direction."""
    n = len(both)
    scale, unit, axes = np.empty(n), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        scale[i] = 1.0 / math.sqrt(max(alone[i, i], 1e-12))
    for i in range(n):
        for j in range(n):
            unit[i, j] = both[i, j] * scale[i] * scale[j]
    eigen(unit, axes)
    both[:] = 0.0
    for k in range(n):
        of_alone = 0.0
        for i in range(n):
            for j in range(n):
                of_alone += axes[i, k] * alone[i, j] * scale[i] * scale[j] * axes[j, k]
        kept = min(max(unit[k, k], LEAST_ATTENUATION * of_alone), of_alone)
        for i in range(n):
            for j in range(n):
                both[i, j] += kept * axes[i, k] * axes[j, k] / (scale[i] * scale[j])


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def tell_attenuation(both: FloatArray, alone: FloatArray, attenuation: FloatArray) -> None:
    """Write the share of one curvature's first two directions in another's, made symmetric."""
    xx, xy, yy = alone[0, 0] + 1e-12, alone[0, 1], alone[1, 1] + 1e-12
    one = 1.0 / (xx * yy - xy * xy)
    attenuation[0, 0] = one * (yy * both[0, 0] - xy * both[1, 0])
    attenuation[1, 1] = one * (xx * both[1, 1] - xy * both[0, 1])
    aside = 0.5 * one * ((yy * both[0, 1] - xy * both[1, 1]) + (xx * both[1, 0] - xy * both[0, 0]))
    attenuation[0, 1] = attenuation[1, 0] = aside


@compiled("void(f8[:, ::1], f8)")
def damp(curvature: FloatArray, stiffness: float) -> None:
    """Add a trace of damping to a curvature, and stiffness against the bend."""
    level = 0.25 * (curvature[0, 0] + curvature[1, 1] + curvature[2, 2] + curvature[3, 3])
    for i in range(len(curvature)):
        curvature[i, i] += (1e-6 if i < 4 else 1e-6 + stiffness) * level


@compiled("f8(f8[:, ::1], f8[:, ::1], f8, f8)")
def move_on(G: FloatArray, step: FloatArray, reach_px: float, longest_px: float) -> float:
    """Set ``G`` to itself after the field's homography of a step ``(4 or 8, 1)``, cut to a length; return its length.

    See ``field.field_matrix``; lengths are at ``reach_px`` from the middle. A step that is no number is not taken.
    """
    total = 0.0
    for i in range(len(step)):
        total += step[i, 0] * step[i, 0]
    length_px = reach_px * math.sqrt(total)
    if not math.isfinite(length_px):
        return length_px
    cut = min(1.0, longest_px / max(length_px, 1e-12))
    x, y, turn, growth = cut * step[0, 0], cut * step[1, 0], cut * step[2, 0], cut * step[3, 0]
    stretch, shear, tilt_x, tilt_y = 0.0, 0.0, 0.0, 0.0
    if len(step) > 4:
        stretch, shear, tilt_x, tilt_y = cut * step[4, 0], cut * step[5, 0], cut * step[6, 0], cut * step[7, 0]
    for i in range(3):
        p, q, r = G[i, 0], G[i, 1], G[i, 2]
        G[i, 0] = p * (1.0 + growth + stretch) + q * (turn + shear) - r * tilt_x
        G[i, 1] = p * (shear - turn) + q * (1.0 + growth - stretch) - r * tilt_y
        G[i, 2] = p * x + q * y + r
    return length_px


@compiled(
    "UniTuple(f8, 2)(f4[:, ::1], f4[:, ::1], i8, f4[:, ::1], f4[:, ::1], b1[::1], i8, i8, f8, f8, f8, b1,"
    " f8[:, ::1], f8[:, ::1], f4[::1], b1[::1])"
)
def descend(
    a_seen: Image32,
    a_values: Image32,
    factor: int,
    Q: Image32,
    A: Image32,
    usable: Flags,
    freedom: int,
    steps: int,
    reach_px: float,
    enough_px: float,
    stiffness: float,
    near: bool,
    G: FloatArray,
    attenuation: FloatArray,
    seen: Image32,
    valid: Flags,
) -> tuple[float, float]:
    """Refine ``G`` as ``align.align`` says; return the correlation and the support, 0 where the fit has failed.

    ``attenuation`` ``(2, 2)`` comes in as the unit matrix; ``seen`` and ``valid`` ``(N,)`` are of the last step.
    """
    value = A[0]
    xy, weight, J_a = np.empty((2, len(value)), np.float32), np.empty_like(value), np.empty((0, 0), np.float32)
    own, pull, both = np.empty((1 + freedom, 1 + freedom)), np.empty(1 + freedom), np.empty((freedom, freedom))
    curvature, step = np.empty((freedom, freedom)), np.empty((freedom, 1))
    correlation, support, gain, unit, before_px = 0.0, 0.0, 0.0, 1.0, np.inf
    for k in range(steps):
        place(G, factor, Q, xy)
        n = look_up(a_seen, xy, usable, seen, valid)
        if n < FEWEST_POINTS:
            return 0.0, 0.0
        if gain == 0.0:
            gain = max(_dot(value, seen, valid) / max(_dot(value, value, valid), 1e-9), 0.05)
        if k < SCALE_STEPS:
            for i in range(len(value)):
                weight[i] = seen[i] - np.float32(gain) * value[i]
            unit = 1.0 / (CAUCHY * typical(weight, valid))
        weigh(seen, value, valid, gain, unit, weight)
        products(A, A, weight, True, own)
        pulls(A, seen, weight, pull)
        power_a = 0.0
        for i in range(len(seen)):
            power_a += weight[i] * seen[i] * seen[i]
        before = correlation
        correlation, support = pull[0] / math.sqrt(max(power_a * own[0, 0], 1e-12)), n / len(value)
        gain = pull[0] / max(own[0, 0], 1e-9)
        if gain <= LEAST_GAIN:
            return correlation, 0.0
        for i in range(freedom):
            for j in range(freedom):
                curvature[i, j] = gain * own[1 + i, 1 + j]
        if near and correlation < CLEAN:
            # Slopes of noise, and of detail that the other frame has lost to blur, are in what b alone promises but do
            # not pull: by it alone every step falls short, and the fit ends before it is there.
            if len(J_a) == 0:
                J_a = np.empty((freedom, len(value)), np.float32)
                slopes_of_a(a_values, G, factor, Q, xy, J_a)
            products(A[1:], J_a, weight, False, both)
            keep_within(both, curvature)
            tell_attenuation(both, curvature, attenuation)
            for i in range(freedom):
                for j in range(freedom):
                    curvature[i, j] = both[i, j]
        damp(curvature, stiffness * YIELDING**k)
        for i in range(freedom):
            step[i, 0] = gain * own[1 + i, 0] - pull[1 + i]
        solve(curvature, step)
        length_px = move_on(G, step, reach_px, LONGEST_STEP_PX)
        if not math.isfinite(length_px):
            return correlation, 0.0
        # Steps shrink by a rate: what is left to go is the rest of the series.
        rate = min(length_px / before_px, 0.9)
        if length_px * max(rate / (1.0 - rate), 0.1) < enough_px or (k >= PATIENCE and correlation < before + RISE):
            break
        before_px = length_px
    unit = 1.0 / G[2, 2]
    for i in range(3):
        for j in range(3):
            G[i, j] *= unit
    return correlation, support


@compiled("f8(f4[:, ::1], i8, f4[::1], b1[::1], f8)")
def share_outlying(A: Image32, in_block: int, seen: Image32, valid: Flags, px: float) -> float:
    """Return the share of points that a fit does not explain, of blocks of so many (see ``align.outlying``).

    ``px`` is a pixel of the floor in field coordinates.
    """
    value, residual = A[0], np.empty(len(seen), np.float32)
    total, usual, cross = 0, _dot(value, value, valid), _dot(value, seen, valid)
    gain = np.float32(max(cross / max(usual, 1e-9), LEAST_GAIN))
    for n in range(len(seen)):
        residual[n] = abs(seen[n] - gain * value[n])
        total += valid[n]
    if total < FEWEST_POINTS:
        return 1.0
    slack, noise = np.float32(gain * SLACK_PX * px), np.float32(3.0 * typical(residual, valid))
    outlying = 0
    for start in range(0, len(seen), in_block):
        beyond, present = 0, 0
        for n in range(start, start + in_block):
            steepness = math.sqrt(A[1, n] * A[1, n] + A[2, n] * A[2, n])
            beyond += valid[n] and residual[n] > steepness * slack + noise
            present += valid[n]
        if beyond > COMPANY * present:
            outlying += beyond
    return outlying / total
