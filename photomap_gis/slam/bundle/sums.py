"""The inner loops of the equations, compiled: what every tie adds, and what taking the spots out takes away.

Arrays as in ``equations``; a tie's 16 derivatives are by the poses of a and b, and by the lenses of a and b.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.problem import IntArray

POSE, TIE = 6, 16


@compiled(
    "void(i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1],"
    "f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])"
)
def add_ties(
    a: IntArray,
    b: IntArray,
    lens_a: IntArray,
    lens_b: IntArray,
    slot: IntArray,
    residual: FloatArray,
    J: FloatArray,
    W: FloatArray,
    by_z: FloatArray,
    blocks: FloatArray,
    g: FloatArray,
    cross: FloatArray,
    border: FloatArray,
    g_border: FloatArray,
    curvature: FloatArray,
    slope: FloatArray,
    with_z: FloatArray,
) -> None:
    """Add the ties: to ``blocks`` ``(S, 6, 6)``, ``g`` ``(N, 6)``, ``cross`` ``(N, 6, C)``, ``border`` ``(C, C)``,
    ``g_border`` ``(C,)``; their numbers of each tie go to ``curvature``, ``slope`` ``(M,)`` and ``with_z`` ``(M, 16)``.

    The first N slots are the views with themselves; ``slot`` ``(M,)`` is that of a and b, the lower number first.
    """
    local = np.zeros((TIE, TIE))
    pull = np.zeros(TIE)
    for m in range(len(a)):
        w00, w01, w11 = W[m, 0, 0], W[m, 0, 1], W[m, 1, 1]
        if w00 == 0.0 and w11 == 0.0:
            continue
        z0, z1 = w00 * by_z[m, 0] + w01 * by_z[m, 1], w01 * by_z[m, 0] + w11 * by_z[m, 1]
        curvature[m] = z0 * by_z[m, 0] + z1 * by_z[m, 1]
        slope[m] = z0 * residual[m, 0] + z1 * residual[m, 1]
        for i in range(TIE):
            x, y = J[m, 0, i], J[m, 1, i]
            with_z[m, i] = x * z0 + y * z1
            wx, wy = w00 * x + w01 * y, w01 * x + w11 * y
            pull[i] = wx * residual[m, 0] + wy * residual[m, 1]
            for j in range(TIE):
                local[i, j] = wx * J[m, 0, j] + wy * J[m, 1, j]
        p, q, s, lp, lq = a[m], b[m], slot[m], 2 * lens_a[m], 2 * lens_b[m]
        for i in range(POSE):
            g[p, i] += pull[i]
            g[q, i] += pull[POSE + i]
            for j in range(POSE):
                blocks[p, i, j] += local[i, j]
                blocks[q, i, j] += local[POSE + i, POSE + j]
                if p < q:
                    blocks[s, i, j] += local[i, POSE + j]
                else:
                    blocks[s, i, j] += local[POSE + i, j]
            for j in range(2):
                cross[p, i, lp + j] += local[i, 12 + j]
                cross[p, i, lq + j] += local[i, 14 + j]
                cross[q, i, lp + j] += local[POSE + i, 12 + j]
                cross[q, i, lq + j] += local[POSE + i, 14 + j]
        for i in range(2):
            g_border[lp + i] += pull[12 + i]
            g_border[lq + i] += pull[14 + i]
            for j in range(2):
                border[lp + i, lp + j] += local[12 + i, 12 + j]
                border[lq + i, lq + j] += local[14 + i, 14 + j]
                border[lp + i, lq + j] += local[12 + i, 14 + j]
                border[lq + i, lp + j] += local[14 + i, 12 + j]


@compiled(
    "void(i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[::1], f8[::1], f8[:,::1],"
    "f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1])"
)
def take_spots_out(
    order: IntArray,
    start: IntArray,
    a: IntArray,
    b: IntArray,
    lens_a: IntArray,
    lens_b: IntArray,
    own_slot: IntArray,
    met_slot: IntArray,
    curvature: FloatArray,
    slope: FloatArray,
    with_z: FloatArray,
    held: FloatArray,
    blocks: FloatArray,
    g: FloatArray,
    cross: FloatArray,
    border: FloatArray,
    g_border: FloatArray,
) -> None:
    """Take the spots' z out of what ``add_ties`` made; ``curvature``, ``slope`` ``(P,)`` are of the spots here.

    ``held`` ``(P, C)`` is what the surface says of each with the border's first C columns. ``order``, ``start``,
    ``own_slot`` and ``met_slot`` are those of ``Layout``.
    """
    columns = held.shape[1]
    of_border, of_b = np.zeros(columns), np.zeros(POSE)
    met = 0
    for p in range(len(start) - 1):
        begin, end = start[p], start[p + 1]
        weight, pull = 1.0 / curvature[p], slope[p] / curvature[p]
        of_b[:] = 0.0
        of_border[:] = held[p]
        for t in range(begin, end):
            m = order[t]
            for i in range(POSE):
                of_b[i] += with_z[m, POSE + i]
            for i in range(2):
                of_border[2 * lens_a[m] + i] += with_z[m, 12 + i]
                of_border[2 * lens_b[m] + i] += with_z[m, 14 + i]
        for t in range(begin, end):
            m = order[t]
            v, w, s = a[m], b[m], own_slot[m]
            for i in range(POSE):
                x = with_z[m, i] * weight
                g[v, i] -= with_z[m, i] * pull
                for j in range(POSE):
                    blocks[v, i, j] -= x * with_z[m, j]
                for j in range(columns):
                    cross[v, i, j] -= x * of_border[j]
                for j in range(POSE):
                    if v < w:
                        blocks[s, i, j] -= x * of_b[j]
                    else:
                        blocks[s, j, i] -= x * of_b[j]
            for later in range(t + 1, end):
                k = order[later]
                u, s = a[k], met_slot[met]
                met += 1
                for i in range(POSE):
                    x = with_z[m, i] * weight
                    for j in range(POSE):
                        y = x * with_z[k, j]
                        if v < u:
                            blocks[s, i, j] -= y
                        elif v > u:
                            blocks[s, j, i] -= y
                        else:
                            blocks[s, i, j] -= y
                            blocks[s, j, i] -= y
        if end > begin:
            w = b[order[begin]]
            for i in range(POSE):
                x = of_b[i] * weight
                g[w, i] -= of_b[i] * pull
                for j in range(POSE):
                    blocks[w, i, j] -= x * of_b[j]
                for j in range(columns):
                    cross[w, i, j] -= x * of_border[j]
        for i in range(columns):
            x = of_border[i] * weight
            g_border[i] -= of_border[i] * pull
            for j in range(columns):
                border[i, j] -= x * of_border[j]


@compiled("void(i8[::1], i8[::1], i8[::1], b1[::1], f8[:,:,::1], f8[:,::1])")
def put_blocks(
    slot: IntArray, row: IntArray, column: IntArray, turned: npt.NDArray[np.bool_], blocks: FloatArray, out: FloatArray
) -> None:
    """Write blocks ``(S, 6, 6)`` into ``out`` at rows and columns, ``turned`` ones transposed."""
    for e in range(len(slot)):
        s, r, c = slot[e], row[e], column[e]
        for i in range(POSE):
            for j in range(POSE):
                out[r + i, c + j] = blocks[s, j, i] if turned[e] else blocks[s, i, j]
