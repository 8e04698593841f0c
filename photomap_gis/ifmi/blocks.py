"""The motion that is left, block by block, after a motion has been taken out: tilt, relief, or nothing but noise.

From it come the model sigma (what no similarity can express), the last correction of the motion towards the one that
fits the whole overlap evenly, its covariance, and one of the witnesses of whether the registration is right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.align import CAUCHY, WHOLE, look_up, typical
from photomap_gis.ifmi.kernels import Image32
from photomap_gis.ifmi.spectrum import Floor
from photomap_gis.ifmi.template import BLOCKS

LEAST_CORRELATION = 0.3
LEAST_SURE_PX = 1.5
"""Blocks whose sigma is beyond this even in their best direction have nothing to say."""
FURTHEST_PX = 6.0
"""Blocks that want to move further than this many pixels of the floor have lost their way."""
LONGEST_STEP_PX = 2.0
SETTLED_PX = 0.25
"""Blocks that moved no more than this need no second step, .."""
FEW_UNSETTLED = 0.05
""".. nor where no more than this share of them moved further."""
ODD = 3.0
"""A block is odd whose correlation lacks so many times more to 1 than that of the median block."""
FEWEST_ODD = 2
CONVINCING = 0.7
BETTER = 0.1
"""An odd block's new place must correlate so well, and so much better than where it should have been."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockMotion:
    """Residual displacements of K blocks of b, in field coordinates: true is ``G(q + d)``.

    ``centre`` and ``displacement`` are ``(K, 2)``; ``noise`` ``(3, K)`` holds the elements xx, xy and yy of their
    covariances, as if residuals were independent; ``correlation`` ``(K,)`` is that after the displacement; ``solved``
    ``(K,)`` where the block had enough to say; ``visible`` ``(K,)`` where it lies in a at all.
    """

    centre: FloatArray
    displacement: FloatArray
    noise: FloatArray
    correlation: FloatArray
    solved: np.ndarray
    visible: np.ndarray

    def replaced(self, blocks: np.ndarray, other: BlockMotion, which: np.ndarray) -> BlockMotion:
        """Return the motion with that of ``blocks`` taken from the blocks ``which`` of another."""
        fields = {}
        noise = self.noise.copy()
        noise[:, blocks] = other.noise[:, which]
        for name in ("centre", "displacement", "correlation", "solved"):
            fields[name] = getattr(self, name).copy()
            fields[name][blocks] = getattr(other, name)[which]
        return replace(self, noise=noise, **fields)


def block_motion(
    floors_a: tuple[Floor, ...],
    floors_b: tuple[Floor, ...],
    G: FloatArray,
    *,
    coarsest: int | None,
    attenuation: FloatArray,
) -> BlockMotion:
    """Return the residual motion of a grid of blocks of b on the finest floor.

    Blocks that do not look like the others there (something stands high, or has moved) are looked for again from the
    floor ``coarsest`` down (``None``: they are not), and keep what they find where it is convincing. ``attenuation``
    is that of ``Alignment``.
    """
    every = np.arange(BLOCKS)
    found = _on_floor(floors_a[0], floors_b[0], G, every, np.zeros((BLOCKS, 2)), attenuation, steps=2)
    seen = found.correlation[found.visible]
    if coarsest is None or len(seen) == 0:
        return found
    usual = 1.0 - ODD * (1.0 - float(np.median(seen)))
    odd = every[found.visible & ((found.correlation < usual) | ~found.solved)]
    if len(odd) < FEWEST_ODD:
        return found
    start = np.zeros((len(odd), 2))
    for k in range(coarsest, -1, -1):
        again = _on_floor(floors_a[k], floors_b[k], G, odd, start, attenuation, steps=3)
        start = np.where(again.solved[:, None], again.displacement, start)
    better = again.solved & (again.correlation > np.maximum(CONVINCING, found.correlation[odd] + BETTER))
    return found.replaced(odd[better], again, better)


def _on_floor(
    a: Floor, b: Floor, G: FloatArray, blocks: np.ndarray, start: FloatArray, attenuation: FloatArray, *, steps: int
) -> BlockMotion:
    """Return the motion of some blocks, searched from ``start`` ``(len(blocks), 2)``."""
    t = b.template.of_blocks(blocks)
    px = 2.0 / max(b.shape)  # a pixel of the floor in field coordinates
    d = start
    Q, T = t.Q.copy(), None if attenuation is WHOLE else _root(attenuation)
    value, gx, gy = t.value, t.gx, t.gy
    for _ in range(steps):
        moved = d.astype(np.float32)
        Q[0], Q[1] = t.Q[0] + moved[:, :1], t.Q[1] + moved[:, 1:]
        found, inside = look_up(a, G, Q)
        seen, valid = found.reshape(t.usable.shape), inside.reshape(t.usable.shape) & t.usable
        weight = valid.astype(np.float32)
        usual = weight * value
        gain = _sums(usual, seen) / np.maximum(_sums(usual, value), 1e-9)
        np.minimum(np.maximum(gain, 0.05, out=gain), 3.0, out=gain)
        residual = seen - gain[:, None].astype(np.float32) * value
        weight /= np.float32(1.0) + np.square(residual * np.float32(1.0 / (CAUCHY * typical(residual, valid))))
        wx, wy = weight * gx, weight * gy
        hxx, hxy, hyy = _sums(wx, gx), _sums(wx, gy), _sums(wy, gy)
        bx, by = _sums(wx, residual), _sums(wy, residual)
        ridge = 1e-3 * (hxx + hyy) + 1e-6
        hxx += ridge
        hyy += ridge
        # What pulls is attenuated: the curvature is seen through the share of the slopes that both frames have.
        attenuated = (hxx, hxy, hyy) if T is None else _through(T, hxx, hxy, hyy)
        cxx, cxy, cyy = (gain * c for c in attenuated)
        determinant = np.maximum(cxx * cyy - cxy * cxy, 1e-12)
        sx, sy = (cxy * by - cyy * bx) / determinant, (cxy * bx - cxx * by) / determinant
        shorter = np.minimum(1.0, LONGEST_STEP_PX * px / np.maximum(np.hypot(sx, sy), 1e-9))
        step = np.stack([sx * shorter, sy * shorter], axis=1)
        d = d + step
        gone = d - start
        lost = gone[:, 0] ** 2 + gone[:, 1] ** 2 > (FURTHEST_PX * px) ** 2
        d = np.where(lost[:, None], start, d)
        if np.count_nonzero(np.abs(step).max(axis=1) > SETTLED_PX * px) <= FEW_UNSETTLED * len(d):
            break
    # The residual was seen before the last step: what the step explains is taken out of it.
    total = np.maximum(weight.sum(axis=1, dtype=np.float64), 1.0)
    moved = (gain[:, None] * step).astype(np.float32)
    left = residual + gx * moved[:, :1] + gy * moved[:, 1:]
    sigma2 = _sums(weight * left, left) / total
    power_b = gain * gain * _sums(weight * value, value) / total
    correlation = np.sqrt(power_b / np.maximum(power_b + sigma2, 1e-12))
    vxx, vxy, vyy = _sandwich((cxx, cxy, cyy), (hxx, hxy, hyy), sigma2 / (determinant * determinant))
    least = 0.5 * (vxx + vyy) - np.sqrt((0.5 * (vxx - vyy)) ** 2 + vxy**2)
    visible = valid.sum(axis=1) >= 0.5 * t.usable.shape[1]
    # A block's motion is that of where its contrast is, not of its middle.
    say = weight * (gx * gx + gy * gy)
    say += np.float32(1e-9)
    centre = np.stack([_sums(say, t.Q[0]), _sums(say, t.Q[1])], axis=1) / say.sum(axis=1, dtype=np.float64)[:, None]
    sure = least < (LEAST_SURE_PX * px) ** 2
    solved = visible & ~lost & (gain > 0.05) & (correlation > LEAST_CORRELATION) & sure
    return BlockMotion(centre, d, np.stack([vxx, vxy, vyy]), correlation, solved, visible)


Symmetric = tuple[FloatArray, FloatArray, FloatArray]
"""``(K,)`` elements xx, xy and yy of K symmetric matrices."""


def _root(matrix: FloatArray) -> FloatArray:
    """Return the square root of a symmetric ``(2, 2)`` matrix."""
    values, axes = np.linalg.eigh(matrix)
    return np.asarray((axes * np.sqrt(np.maximum(values, 1e-6))) @ axes.T, np.float64)


def _through(T: FloatArray, xx: FloatArray, xy: FloatArray, yy: FloatArray) -> Symmetric:
    """``T M T`` of symmetric matrices, T symmetric ``(2, 2)``."""
    p, q, r = T[0, 0], T[0, 1], T[1, 1]
    return (
        p * p * xx + 2.0 * p * q * xy + q * q * yy,
        p * q * xx + (p * r + q * q) * xy + q * r * yy,
        q * q * xx + 2.0 * q * r * xy + r * r * yy,
    )


def _sandwich(bread: Symmetric, filling: Symmetric, factor: FloatArray) -> Symmetric:
    """``adj(bread) filling adj(bread)``, times a factor."""
    cxx, cxy, cyy = bread
    hxx, hxy, hyy = filling
    return (
        factor * (cyy * cyy * hxx - 2.0 * cyy * cxy * hxy + cxy * cxy * hyy),
        factor * (-cyy * cxy * hxx + (cxx * cyy + cxy * cxy) * hxy - cxx * cxy * hyy),
        factor * (cxy * cxy * hxx - 2.0 * cxx * cxy * hxy + cxx * cxx * hyy),
    )


def _sums(x: Image32, y: Image32) -> FloatArray:
    """``(BLOCKS,)`` sums of products, block by block."""
    return np.einsum("kn,kn->k", x, y).astype(np.float64)
