"""The motion that is left, block by block, after a similarity has been taken out: tilt, relief, or nothing but noise.

From it come the model sigma (what no similarity can express), the last correction of the motion towards the one that
fits the whole overlap evenly, its covariance, and one of the witnesses of whether the registration is right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.overlap import on_floor
from photomap_gis.ifmi.refine import CAUCHY, look_up_at
from photomap_gis.ifmi.spectrum import Floor

GRID = 6
FURTHEST_PX = 6.0
"""Blocks that want to move further than this many pixels of the floor have lost their way."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockMotion:
    """Residual displacements of K blocks of b, in b's frame pixels and axes: true is ``T_a_b.apply(p + d)``.

    ``centre`` and ``displacement`` are ``(K, 2)``, ``covariance`` ``(K, 2, 2)`` as if residuals were independent,
    ``correlation`` ``(K,)`` after the displacement; ``solved`` ``(K,)`` where the block had enough to say;
    ``visible`` ``(K,)`` where it lies in a at all.
    """

    centre: FloatArray
    displacement: FloatArray
    covariance: FloatArray
    correlation: FloatArray
    solved: np.ndarray
    visible: np.ndarray


Bend = Callable[[FloatArray], FloatArray]


def _straight(p: FloatArray) -> FloatArray:
    return np.zeros_like(p)


def block_motion(
    floors_a: tuple[Floor, ...],
    floors_b: tuple[Floor, ...],
    T_a_b: Similarity2D,
    bend: Bend = _straight,
    *,
    steps: int = 4,
) -> BlockMotion:
    """Return the residual motion of a grid of blocks of b, over floors passed coarsest first.

    ``bend`` maps ``(N, 2)`` points of b (frame pixels) to the displacements that are known already: blocks are
    compared along it, search from there, and their displacements contain it.
    """
    d = np.zeros((GRID * GRID, 2))
    for a, b in zip(floors_a, floors_b, strict=True):
        extra, motion = _solve_floor(a, b, on_floor(T_a_b, b.factor), d / b.factor, bend, steps)
        d = np.where(motion.solved[:, None], extra * b.factor, d)
    return replace(motion, displacement=d + bend(motion.centre))


def _solve_floor(
    a: Floor, b: Floor, T: Similarity2D, d: FloatArray, bend: Bend, steps: int
) -> tuple[FloatArray, BlockMotion]:
    K = GRID * GRID
    t = b.template
    rows, columns = t.x.shape
    block = ((np.arange(rows) * GRID // rows)[:, None] * GRID + (np.arange(columns) * GRID // columns)[None, :]).ravel()
    value, gx, gy = t.value.ravel(), t.gx.ravel(), t.gy.ravel()
    textured = (gx != 0) | (gy != 0)
    total = np.bincount(block, minlength=K)
    L = T.linear.astype(np.float32)

    def by_block(x: np.ndarray) -> FloatArray:
        sums: FloatArray = np.bincount(block, weights=x, minlength=K).astype(np.float64)
        return sums

    start = d
    points = np.stack([t.x.ravel(), t.y.ravel()], axis=1).astype(np.float64)
    bent = (points + bend(points * b.factor) / b.factor).astype(np.float32)
    bent_x, bent_y = bent[:, 0].reshape(rows, columns), bent[:, 1].reshape(rows, columns)
    moved_off = np.zeros(K, bool)
    for _ in range(steps):
        x = bent_x + d[block, 0].reshape(rows, columns).astype(np.float32)
        y = bent_y + d[block, 1].reshape(rows, columns).astype(np.float32)
        seen, valid = look_up_at(
            a, L[0, 0] * x + L[0, 1] * y + np.float32(T.tx), L[1, 0] * x + L[1, 1] * y + np.float32(T.ty)
        )
        valid &= textured
        weight = valid.astype(np.float32)
        gain = np.clip(by_block(weight * seen * value) / np.maximum(by_block(weight * value * value), 1e-9), 0.05, 3.0)
        residual = seen - gain[block].astype(np.float32) * value
        scale = 1.4826 * float(np.median(np.abs(residual[valid]))) + 1e-6 if valid.any() else 1.0
        weight = weight / (1.0 + (residual / np.float32(CAUCHY * scale)) ** 2)
        wx, wy = weight * gx, weight * gy
        hxx, hxy, hyy = by_block(wx * gx), by_block(wx * gy), by_block(wy * gy)
        bx, by = by_block(wx * residual), by_block(wy * residual)
        ridge = 1e-3 * (hxx + hyy) + 1e-6
        determinant = (hxx + ridge) * (hyy + ridge) - hxy**2
        step = (
            -np.stack([(hyy + ridge) * bx - hxy * by, (hxx + ridge) * by - hxy * bx], 1) / (determinant * gain)[:, None]
        )
        step *= np.minimum(1.0, 2.0 / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9))[:, None]
        d = d + step
        moved_off = np.hypot(*(d - start).T) > FURTHEST_PX
        d[moved_off] = start[moved_off]
    count = by_block(valid)
    power = by_block(weight * seen**2) * by_block(weight * value**2)
    correlation = by_block(weight * seen * value) / np.sqrt(np.maximum(power, 1e-12))
    sigma2 = by_block(weight * residual**2) / np.maximum(by_block(weight), 1.0)
    s = (sigma2 / (gain**2 * np.maximum(determinant, 1e-12)))[:, None, None]
    f = b.factor
    covariance = s * np.stack([hyy + ridge, -hxy, -hxy, hxx + ridge], 1).reshape(K, 2, 2) * f**2
    visible = count >= 0.5 * np.maximum(total, 1)
    solved = visible & ~moved_off & (correlation > 0.3) & (np.linalg.eigvalsh(covariance)[:, 1] < (0.5 * f) ** 2)
    # A block's motion is that of where its contrast is, not of its middle.
    say = weight * (gx * gx + gy * gy) + np.float32(1e-9)
    centre = np.stack([by_block(say * t.x.ravel()), by_block(say * t.y.ravel())], 1) / by_block(say)[:, None]
    return d, BlockMotion(centre * f, d * f, covariance, correlation, solved, visible)
