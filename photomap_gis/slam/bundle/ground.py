"""The ground's surface through the spots: as smooth as the spots that were left out like it best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray

CELLS = 40
"""Cells along the longer side of the map, at most."""
ROUNDS = 5
BEND_SIGMAS = (0.003, 0.02, 0.1)
"""How much the ground's slope may change from cell to cell: three kinds of ground, of which one is chosen."""
GAIN = 0.97
"""A livelier ground must miss the spots that were left out by so much less."""
LEAST_SPOTS = 40


@dataclass(frozen=True, slots=True, eq=False)
class _Lattice:
    origin: FloatArray
    cell: float
    columns: int
    rows: int

    @classmethod
    def over(cls, xy: FloatArray, cell: float) -> _Lattice:
        low, high = xy.min(axis=0), xy.max(axis=0)
        cell = max(cell, float((high - low).max()) / CELLS, 1e-9)
        columns, rows = (max(2, int(np.ceil(s / cell)) + 1) for s in high - low)
        return cls(low, cell, columns, rows)

    def weights(self, xy: FloatArray) -> sparse.csr_array:
        """``(P, cells)`` bilinear weights."""
        u = np.clip((xy - self.origin) / self.cell, 0.0, [self.columns - 1, self.rows - 1])
        i = np.minimum(u.astype(np.intp), [self.columns - 2, self.rows - 2])
        p, q = (u - i).T
        at = i[:, 1] * self.columns + i[:, 0]
        entries = [(0, (1 - p) * (1 - q)), (1, p * (1 - q)), (self.columns, (1 - p) * q), (self.columns + 1, p * q)]
        row = np.arange(len(xy))
        return sparse.coo_array(
            (
                np.concatenate([w for _, w in entries]),
                (np.tile(row, 4), np.concatenate([at + k for k, _ in entries])),
            ),
            shape=(len(xy), self.columns * self.rows),
        ).tocsr()

    def bends(self) -> sparse.csr_array:
        """``(B, cells)`` change of slope from cell to cell, along both axes and across."""
        number = np.arange(self.columns * self.rows).reshape(self.rows, self.columns)
        parts = []
        for grid in (number, number.T):
            if grid.shape[1] >= 3:
                parts.append((grid[:, :-2].ravel(), grid[:, 1:-1].ravel(), grid[:, 2:].ravel()))
        rows, columns, values, n = [], [], [], 0
        for left, middle, right in parts:
            row = n + np.arange(len(left))
            rows += [row, row, row]
            columns += [left, middle, right]
            values += [np.ones(len(left)), np.full(len(left), -2.0), np.ones(len(left))]
            n += len(left)
        twist = [number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]]
        row = n + np.arange(twist[0].size)
        for corner, sign in zip(twist, (1.0, -1.0, -1.0, 1.0), strict=True):
            rows.append(row)
            columns.append(corner.ravel())
            values.append(np.full(corner.size, sign))
        n += twist[0].size
        stacked = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sparse.coo_array(stacked, shape=(n, number.size)).tocsr() * (1.0 / self.cell)


def fit_ground(xy: FloatArray, up: FloatArray, sigma: FloatArray, cell: float) -> HeightField:
    """Return the surface through ``(P,)`` heights at ``(P, 2)`` map points, each known to its ``sigma``.

    What stands on the ground is held down robustly. ``cell`` is the finest worth trying; the middle level becomes 0
    only if the spots' is.
    """
    if len(up) < LEAST_SPOTS:
        middle = float(np.median(up)) if len(up) else 0.0
        return HeightField((0.0, 0.0), 1.0, np.full((1, 1), middle), _scatter(up - middle, sigma))
    lattice = _Lattice.over(xy, cell)
    B, D = lattice.weights(xy), lattice.bends()
    kept = np.arange(len(up)) % 5 != 0
    best: tuple[float, float] | None = None
    for bend in BEND_SIGMAS:
        heights = _fit(B[kept], D, up[kept], sigma[kept], bend)
        miss = _robust_mean(up[~kept] - B[~kept] @ heights, sigma[~kept])
        if best is None or miss < GAIN * best[0]:
            best = miss, bend
    assert best is not None
    heights = _fit(B, D, up, sigma, best[1])
    left = up - B @ heights
    return HeightField(
        (float(lattice.origin[0]), float(lattice.origin[1])),
        lattice.cell,
        heights.reshape(lattice.rows, lattice.columns),
        _scatter(left, sigma),
    )


def _fit(B: sparse.csr_array, D: sparse.csr_array, up: FloatArray, sigma: FloatArray, bend: float) -> FloatArray:
    weight = 1.0 / np.maximum(sigma, 1e-9) ** 2
    heights = np.full(B.shape[1], float(np.median(up)))
    smooth = (D.T @ D) * bend**-2.0 + sparse.eye_array(B.shape[1]) * 1e-9 * weight.max()
    for k in range(ROUNDS):
        left = up - B @ heights
        scale2 = sigma**2 + (_scatter(left, sigma) if k else 1.4826 * float(np.median(np.abs(left)))) ** 2
        robust = 1.0 / (scale2 * (1.0 + left**2 / (4.0 * scale2)) ** 2)
        heights = splu((B.T @ (B * robust[:, None]) + smooth).tocsc()).solve(B.T @ (robust * up))
    return heights


def _scatter(left: FloatArray, sigma: FloatArray) -> float:
    """Return how far spots lie off the ground beyond their own sigmas, robustly."""
    if not len(left):
        return 0.0
    whole = 1.4826 * float(np.median(np.abs(left)))
    return float(np.sqrt(max(whole**2 - float(np.median(sigma)) ** 2, 0.0)))


def _robust_mean(left: FloatArray, sigma: FloatArray) -> float:
    reach = 3.0 * 1.4826 * float(np.median(np.abs(left))) + 1e-12
    return float(np.mean(np.minimum(np.abs(left), reach)))
