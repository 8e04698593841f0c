"""The robust fit of a field and the similarity closest to it, compiled: see ``field``."""

from __future__ import annotations

import math

import numpy as np

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.small import solve

BEND_PRIOR = 0.06
"""One sigma of stretch and perspective before looking."""
LOOSE = 1e-6
"""Information on the similarity's four parameters before looking."""
LEAST_SCATTER = 1e-4
ROUNDS = 3
TAIL = 6.0
"""Observations of so many variances count half."""
SIGNIFICANT = 1.5
"""Scatter counts from so many standard deviations of what noise alone would show."""
FURTHEST = 0.05
"""Points on a homography's horizon and beyond come back as far away as if they lay this little before it."""


SEALED = "Array(f8, 2, 'C', True)"
"""The signature of points that may be read only."""


@compiled("void(f8, f8, f8[:, ::1])")
def basis_at(x: float, y: float, B: FloatArray) -> None:
    """Write the ``(8, 2)`` derivative of the displacement at (x, y) by the field's parameters at 0."""
    B[:, :] = 0.0
    B[0, 0] = B[1, 1] = 1.0
    B[2, 0], B[2, 1] = -y, x
    B[3, 0], B[3, 1] = x, y
    B[4, 0], B[4, 1] = x, -y
    B[5, 0], B[5, 1] = y, x
    B[6, 0], B[6, 1] = x * x, x * y
    B[7, 0], B[7, 1] = x * y, y * y


@compiled("void(f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def leave(theta: FloatArray, q: FloatArray, shifts: FloatArray, left: FloatArray) -> None:
    """Write what a field leaves ``(K, 3)`` of shifts ``(K, 2)`` at q: x, y and half the squared length."""
    t = theta
    for k in range(len(q)):
        x, y = q[k, 0], q[k, 1]
        depth = max(1.0 - t[6] * x - t[7] * y, FURTHEST)
        left[k, 0] = shifts[k, 0] - (((1.0 + t[3] + t[4]) * x + (t[5] - t[2]) * y + t[0]) / depth - x)
        left[k, 1] = shifts[k, 1] - (((t[2] + t[5]) * x + (1.0 + t[3] - t[4]) * y + t[1]) / depth - y)
        left[k, 2] = 0.5 * (left[k, 0] * left[k, 0] + left[k, 1] * left[k, 1])


@compiled("void(f8[:, ::1], f8[:, ::1], f8, f8, f8[:, ::1])")
def weigh(noise: FloatArray, left: FloatArray, scatter2: float, gate2: float, information: FloatArray) -> None:
    """Write the information ``(K, 3)``, elements xx, xy, yy, of every observation: less where its rest is unlikely.

    A ``gate2`` over 0 is the square of a wide robust scale, which then stands for the noise.
    """
    for k in range(len(left)):
        xx, xy, yy = noise[0, k], noise[1, k], noise[2, k]
        if gate2 > 0.0:
            scale2 = max(0.5 * (xx + yy), gate2)
            lost = 1.0 + left[k, 2] / scale2
            information[k, 0] = information[k, 2] = 1.0 / (scale2 * lost * lost)
            information[k, 1] = 0.0
            continue
        x, y = left[k, 0], left[k, 1]
        xx, yy = xx + scatter2, yy + scatter2
        one = 1.0 / (xx * yy - xy * xy)
        one /= 1.0 + 0.5 * one * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / TAIL
        information[k, 0], information[k, 1], information[k, 2] = one * yy, -one * xy, one * xx


@compiled(f"void({SEALED}, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def normal(q: FloatArray, information: FloatArray, left: FloatArray, curvature: FloatArray, pull: FloatArray) -> None:
    """Write the normal equations ``(8, 8)`` and ``(8, 1)``, without a prior."""
    B, W = np.empty((8, 2)), np.empty((8, 2))
    curvature[:, :] = 0.0
    pull[:, :] = 0.0
    for k in range(len(q)):
        basis_at(q[k, 0], q[k, 1], B)
        for i in range(8):
            W[i, 0] = information[k, 0] * B[i, 0] + information[k, 1] * B[i, 1]
            W[i, 1] = information[k, 1] * B[i, 0] + information[k, 2] * B[i, 1]
            pull[i, 0] += W[i, 0] * left[k, 0] + W[i, 1] * left[k, 1]
            for j in range(i + 1):
                curvature[i, j] += W[i, 0] * B[j, 0] + W[i, 1] * B[j, 1]
    for i in range(8):
        for j in range(i):
            curvature[j, i] = curvature[i, j]


@compiled("void(f8[:, ::1])")
def add_prior(curvature: FloatArray) -> None:
    """Add what is known before looking."""
    for i in range(8):
        curvature[i, i] += LOOSE if i < 4 else 1.0 / BEND_PRIOR**2


@compiled("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def fillings(q: FloatArray, information: FloatArray, noise: FloatArray, noisy: FloatArray, even: FloatArray) -> None:
    """Write the ``(8, 8)`` covariances of the pull: by the observations' noise, and by unit scatter of each."""
    B, W = np.empty((8, 2)), np.empty((8, 2))
    noisy[:, :] = 0.0
    even[:, :] = 0.0
    for k in range(len(q)):
        basis_at(q[k, 0], q[k, 1], B)
        xx, xy, yy = noise[0, k], noise[1, k], noise[2, k]
        for i in range(8):
            W[i, 0] = information[k, 0] * B[i, 0] + information[k, 1] * B[i, 1]
            W[i, 1] = information[k, 1] * B[i, 0] + information[k, 2] * B[i, 1]
            nx, ny = xx * W[i, 0] + xy * W[i, 1], xy * W[i, 0] + yy * W[i, 1]
            for j in range(i + 1):
                noisy[i, j] += nx * W[j, 0] + ny * W[j, 1]
                even[i, j] += W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1]
    for i in range(8):
        for j in range(i):
            noisy[j, i], even[j, i] = noisy[i, j], even[i, j]


@compiled("void(f8[:, ::1], f8[:, ::1])")
def between(bread: FloatArray, filling: FloatArray) -> None:
    """Turn a filling into ``bread filling bread``, both symmetric ``(8, 8)``."""
    half = np.zeros((8, 8))
    for i in range(8):
        for m in range(8):
            for j in range(8):
                half[i, j] += bread[i, m] * filling[m, j]
    filling[:, :] = 0.0
    for i in range(8):
        for m in range(8):
            for j in range(8):
                filling[i, j] += half[i, m] * bread[m, j]


@compiled("f8(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def fit(
    q: FloatArray,
    shifts: FloatArray,
    noise: FloatArray,
    gate2: float,
    theta: FloatArray,
    covariance: FloatArray,
    shape: FloatArray,
    left: FloatArray,
    pull: FloatArray,
) -> float:
    """Fit a field to shifts as ``field.fit_field`` says, write what ``field.Field`` holds, return its scatter.

    ``gate2`` is the square of the robust scale to begin with, or 0; ``left`` ``(K, 3)`` is what ``leave`` writes.
    """
    many = len(q)
    freedom = max(0.3, 1.0 - 8.0 / (2.0 * many))
    usual = 0.0
    for k in range(many):
        usual += 0.5 * (noise[0, k] + noise[2, k]) / many
    information, curvature, step = np.empty((many, 3)), np.empty((8, 8)), np.empty((8, 1))
    bread = np.empty((8, 8))
    leave(theta, q, shifts, left)
    scatter2 = LEAST_SCATTER * usual
    for _ in range(ROUNDS if gate2 == 0.0 else ROUNDS + 3):
        if gate2 == 0.0:
            mean = 0.0
            for k in range(many):
                mean += left[k, 2] / freedom / many
            scatter2 = max(mean - (1.0 + SIGNIFICANT / math.sqrt(many)) * usual, LEAST_SCATTER * usual)
        weigh(noise, left, scatter2, gate2, information)
        if gate2 > 0.0:
            gate2 = gate2 / 3.0 if gate2 > usual else 0.0
        normal(q, information, left, curvature, step)
        add_prior(curvature)
        for i in range(8):
            step[i, 0] -= theta[i] * (LOOSE if i < 4 else 1.0 / BEND_PRIOR**2)
            for j in range(8):
                bread[i, j] = curvature[i, j]
        solve(bread, step)
        for i in range(8):
            theta[i] += step[i, 0]
        leave(theta, q, shifts, left)
    # Whatever else moves the blocks, the weights used are these: their sandwich carries both kinds of error.
    fillings(q, information, noise, covariance, shape)
    bread[:, :] = 0.0
    for i in range(8):
        bread[i, i] = 1.0
    solve(curvature, bread)
    between(bread, covariance)
    between(bread, shape)
    for k in range(many):
        information[k, 0] = information[k, 2] = 1.0
        information[k, 1] = 0.0
    normal(q, information, left, curvature, pull)
    add_prior(curvature)
    solve(curvature, pull)
    return scatter2


@compiled(f"void(f8[:, ::1], {SEALED}, f8[:, ::1])")
def send(G: FloatArray, q: FloatArray, to: FloatArray) -> None:
    """Write where a homography takes points ``(N, 2)``; see ``field.project``."""
    for k in range(len(q)):
        x, y = q[k, 0], q[k, 1]
        depth = max(G[2, 0] * x + G[2, 1] * y + G[2, 2], FURTHEST)
        to[k, 0] = (G[0, 0] * x + G[0, 1] * y + G[0, 2]) / depth
        to[k, 1] = (G[1, 0] * x + G[1, 1] * y + G[1, 2]) / depth


@compiled(f"f8({SEALED}, f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1])")
def fit_similarity(
    q: FloatArray, moved: FloatArray, weight: FloatArray, zt: FloatArray, N: FloatArray, share: FloatArray
) -> float:
    """Fit a similarity to where points q ``(N, 2)`` are moved; return the mean square an axis of what it leaves.

    Weights sum up to 1. Written are the similarity (linear part z, shift t, as complex numbers: ``zt`` ``(4,)``), the
    normal matrix of the field ``N`` ``(8, 8)``, and ``share`` ``(4, 4)``, what of a bend the similarity takes over.
    """
    ax, ay, bx, by = 0.0, 0.0, 0.0, 0.0
    for k in range(len(q)):
        ax += weight[k] * moved[k, 0]
        ay += weight[k] * moved[k, 1]
        bx += weight[k] * q[k, 0]
        by += weight[k] * q[k, 1]
    along, across, spread = 0.0, 0.0, 0.0
    for k in range(len(q)):
        x, y, u, v = q[k, 0] - bx, q[k, 1] - by, moved[k, 0] - ax, moved[k, 1] - ay
        along += weight[k] * (x * u + y * v)
        across += weight[k] * (x * v - y * u)
        spread += weight[k] * (x * x + y * y)
    zx, zy = along / spread, across / spread
    tx, ty = ax - (zx * bx - zy * by), ay - (zy * bx + zx * by)
    zt[0], zt[1], zt[2], zt[3] = zx, zy, tx, ty
    left2 = 0.0
    information, left, pull = np.zeros((len(q), 3)), np.zeros((len(q), 3)), np.empty((8, 1))
    for k in range(len(q)):
        x, y = q[k, 0], q[k, 1]
        dx, dy = zx * x - zy * y + tx - moved[k, 0], zy * x + zx * y + ty - moved[k, 1]
        left2 += 0.5 * weight[k] * (dx * dx + dy * dy)
        information[k, 0] = information[k, 2] = weight[k]
    normal(q, information, left, N, pull)
    own = np.empty((4, 4))
    for i in range(4):
        for j in range(4):
            own[i, j], share[i, j] = N[i, j], N[i, 4 + j]
    solve(own, share)
    return left2


@compiled("f8[:, ::1](f8[:, ::1])")
def inverse(H: FloatArray) -> FloatArray:
    """Return the inverse of a ``(3, 3)`` homography."""
    G = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            G[i, j] = H[p, r] * H[q, s] - H[p, s] * H[q, r]
    one = 1.0 / (H[0, 0] * G[0, 0] + H[0, 1] * G[1, 0] + H[0, 2] * G[2, 0])
    for i in range(3):
        for j in range(3):
            G[i, j] *= one
    return G
