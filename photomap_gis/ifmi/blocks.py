"""The motion that is left, block by block, after a similarity has been taken out: tilt, relief, or nothing but noise.

From it come the model sigma (what no similarity can express), the last correction of the motion towards the one that
fits the whole overlap evenly, its covariance, and one of the witnesses of whether the registration is right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.kernels import Image32
from photomap_gis.ifmi.overlap import on_floor
from photomap_gis.ifmi.refine import CAUCHY, look_up_at, typical
from photomap_gis.ifmi.spectrum import Floor
from photomap_gis.ifmi.template import BLOCKS

LEAST_CORRELATION = 0.3
LEAST_SURE_PX = 0.5
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
    d = np.zeros((BLOCKS, 2))
    for a, b in zip(floors_a, floors_b, strict=True):
        extra, motion = _solve_floor(a, b, on_floor(T_a_b, b.factor), d / b.factor, bend, steps)
        d = np.where(motion.solved[:, None], extra * b.factor, d)
    return replace(motion, displacement=d + bend(motion.centre))


def _solve_floor(
    a: Floor, b: Floor, T: Similarity2D, d: FloatArray, bend: Bend, steps: int
) -> tuple[FloatArray, BlockMotion]:
    t, f, start = b.template, b.factor, d
    points = np.stack([t.x.ravel(), t.y.ravel()], axis=1).astype(np.float64)
    bent = T.apply(points + bend(points * f) / f).astype(np.float32)
    bent_x, bent_y = bent[:, 0].reshape(t.x.shape), bent[:, 1].reshape(t.x.shape)
    textured = (t.gx != 0) | (t.gy != 0)
    L = T.linear
    for _ in range(steps):
        moved = (d @ L.T).astype(np.float32)
        seen, valid = look_up_at(a, bent_x + moved[:, :1], bent_y + moved[:, 1:])
        valid &= textured
        weight = valid.astype(np.float32)
        gain = np.clip(_sums(weight * seen, t.value) / np.maximum(_sums(weight * t.value, t.value), 1e-9), 0.05, 3.0)
        residual = seen - gain[:, None].astype(np.float32) * t.value
        weight /= 1.0 + (residual / np.float32(CAUCHY * typical(residual, valid))) ** 2
        wx, wy = weight * t.gx, weight * t.gy
        hxx, hxy, hyy = _sums(wx, t.gx), _sums(wx, t.gy), _sums(wy, t.gy)
        bx, by = _sums(wx, residual), _sums(wy, residual)
        ridge = 1e-3 * (hxx + hyy) + 1e-6
        hxx, hyy = hxx + ridge, hyy + ridge
        determinant = hxx * hyy - hxy**2
        step = -np.stack([hyy * bx - hxy * by, hxx * by - hxy * bx], axis=1) / (determinant * gain)[:, None]
        step *= np.minimum(1.0, 2.0 / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9))[:, None]
        d = d + step
        lost = np.hypot(*(d - start).T) > FURTHEST_PX
        d = np.where(lost[:, None], start, d)
    count = valid.sum(axis=1)
    power = _sums(weight * seen, seen) * _sums(weight * t.value, t.value)
    correlation = _sums(weight * seen, t.value) / np.sqrt(np.maximum(power, 1e-12))
    sigma2 = _sums(weight * residual, residual) / np.maximum(weight.sum(axis=1), 1.0)
    s = (sigma2 / (gain**2 * np.maximum(determinant, 1e-12)))[:, None, None]
    covariance = s * np.stack([hyy, -hxy, -hxy, hxx], axis=1).reshape(-1, 2, 2) * f**2
    visible = count >= 0.5 * t.x.shape[1]
    sure = np.linalg.eigvalsh(covariance)[:, 1] < (LEAST_SURE_PX * f) ** 2
    # A block's motion is that of where its contrast is, not of its middle.
    say = weight * (t.gx * t.gx + t.gy * t.gy) + np.float32(1e-9)
    centre = np.stack([_sums(say, t.x), _sums(say, t.y)], axis=1) / say.sum(axis=1, dtype=np.float64)[:, None]
    solved = visible & ~lost & (correlation > LEAST_CORRELATION) & sure
    return d, BlockMotion(centre * f, d * f, covariance, correlation, solved, visible)


def _sums(x: Image32, y: Image32) -> FloatArray:
    """``(BLOCKS,)`` sums of products, block by block."""
    return np.einsum("kn,kn->k", x, y).astype(np.float64)
