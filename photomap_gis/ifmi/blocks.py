"""The motion that is left, block by block, after a motion has been taken out: tilt, relief, or nothing but noise.

From it come the model sigma (what no similarity can express), the last correction of the motion towards the one that
fits the whole overlap evenly, its covariance, and one of the witnesses of whether the registration is right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.block_steps import settle
from photomap_gis.ifmi.spectrum import Floor
from photomap_gis.ifmi.template import BLOCKS

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
    t, K = b.template, len(blocks)
    d, told, solved, visible = np.empty((K, 2)), np.empty((K, 7)), np.empty(K, np.bool_), np.empty(K, np.bool_)
    settle(
        a.seen,
        np.asarray(G, np.float64, order="C"),
        a.factor,
        t.Q.reshape(3, -1),
        t.A.reshape(9, -1),
        t.usable,
        blocks,
        start,
        _root(attenuation),
        2.0 / max(b.shape),
        steps,
        d,
        told,
        solved,
        visible,
    )
    return BlockMotion(told[:, :2], d, np.ascontiguousarray(told[:, 2:5].T), told[:, 5], solved, visible)


def _root(matrix: FloatArray) -> FloatArray:
    """Return the square root of a symmetric ``(2, 2)`` matrix (Cayley and Hamilton)."""
    xx, xy, yy = float(matrix[0, 0]), float(matrix[0, 1]), float(matrix[1, 1])
    root = math.sqrt(max(xx * yy - xy * xy, 1e-12))
    unit = 1.0 / math.sqrt(max(xx + yy + 2.0 * root, 1e-6))
    return np.array([[unit * (xx + root), unit * xy], [unit * xy, unit * (yy + root)]])
