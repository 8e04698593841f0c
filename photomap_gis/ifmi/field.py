"""A smooth field of residual motion over a frame: a small homography beside the similarity, and its robust fit.

Eight parameters in field coordinates (origin b's centre, unit half its longer side): shift x, shift y, turn, growth
(the similarity), two stretches and two perspectives (the *bend*, which no similarity can express).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.field_sums import fit, fit_similarity, send

GRID_POINTS = 16
"""Points of the grid along the longer side."""


@dataclass(frozen=True, slots=True)
class Frame:
    """The frame b that a field lives on."""

    width_px: int
    height_px: int

    @property
    def reach_px(self) -> float:
        """The unit of field coordinates: half the longer side."""
        return max(self.width_px, self.height_px) / 2.0

    @property
    def T_q_b(self) -> Similarity2D:
        """From b's pixels to field coordinates."""
        return _T_q_b(self.width_px, self.height_px)

    @property
    def T_b_q(self) -> Similarity2D:
        """From field coordinates to b's pixels."""
        return _T_b_q(self.width_px, self.height_px)

    def grid(self) -> FloatArray:
        """``(N, 2)`` field coordinates evenly over the frame."""
        return _grid(self.width_px, self.height_px)

    def similarity_of(self, G: FloatArray) -> Similarity2D:
        """Return the similarity closest to a motion over the whole frame."""
        nine = _nine(self.width_px, self.height_px)
        p = project(G, nine).view(np.complex128).ravel()
        q = nine.view(np.complex128).ravel()  # their mean is 0
        t, z = complex(p.mean()), complex(np.vdot(q, p)) / float(np.vdot(q, q).real)
        return Similarity2D(t.real, t.imag, math.atan2(z.imag, z.real), math.log(max(abs(z), 1e-12)))


@lru_cache(maxsize=16)
def _T_q_b(width_px: int, height_px: int) -> Similarity2D:
    r = max(width_px, height_px) / 2.0
    return Similarity2D((1.0 - width_px) / (2.0 * r), (1.0 - height_px) / (2.0 * r), 0.0, -math.log(r))


@lru_cache(maxsize=16)
def _T_b_q(width_px: int, height_px: int) -> Similarity2D:
    return Similarity2D((width_px - 1) / 2.0, (height_px - 1) / 2.0, 0.0, math.log(max(width_px, height_px) / 2.0))


@lru_cache(maxsize=16)
def _grid(width_px: int, height_px: int) -> FloatArray:
    longer = max(width_px, height_px)
    sides = []
    for side in (width_px, height_px):
        n = max(4, round(GRID_POINTS * side / longer))  # cells are as good as square
        sides.append(((np.arange(n) + 0.5) / n - 0.5) * side / (longer / 2.0))
    x, y = np.meshgrid(*sides)
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    grid.setflags(write=False)
    return grid


@lru_cache(maxsize=16)
def _nine(width_px: int, height_px: int) -> FloatArray:
    """``(9, 2)`` field coordinates of Chebyshev's points of a frame: their mean is the frame's, up to third powers."""
    at = math.sqrt(0.5) / max(width_px, height_px)
    x, y = np.meshgrid(np.array([-1.0, 0.0, 1.0]) * at * width_px, np.array([-1.0, 0.0, 1.0]) * at * height_px)
    nine = np.stack([x.ravel(), y.ravel()], axis=1)
    nine.setflags(write=False)
    return nine


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """``theta`` ``(8,)`` and its covariance by noise alone; ``scatter2`` what else it leaves, a variance an axis.

    ``shape`` ``(8, 8)`` is the covariance by displacements of unit variance. ``residual2`` ``(K,)`` is half the squared
    distance of every observation from the field. ``pull`` ``(8,)`` is how theta would change if all counted the same.
    """

    theta: FloatArray
    covariance: FloatArray
    shape: FloatArray
    scatter2: float
    residual2: FloatArray
    pull: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Closest:
    """The similarity ``T_a_b`` closest to a motion with a field.

    ``M`` ``(4, 8)`` takes the field's parameters to xi about b's centre in b's pixels; ``bend2_px2`` is the mean square
    an axis, in b's pixels, of what the similarity leaves of the motion.
    """

    T_a_b: Similarity2D
    M: FloatArray
    bend2_px2: float


def field_matrix(theta: FloatArray) -> FloatArray:
    """``(3, 3)`` homography of field coordinates by the first 4 or all 8 parameters."""
    t = theta
    if len(t) == 4:
        return np.array([[1.0 + t[3], -t[2], t[0]], [t[2], 1.0 + t[3], t[1]], [0.0, 0.0, 1.0]])
    return np.array(
        [[1.0 + t[3] + t[4], t[5] - t[2], t[0]], [t[2] + t[5], 1.0 + t[3] - t[4], t[1]], [-t[6], -t[7], 1.0]]
    )


def project(H: FloatArray, p: FloatArray) -> FloatArray:
    """``(N, 2)`` points through a ``(3, 3)`` homography; points on its horizon and beyond come back far away."""
    moved = np.empty((len(p), 2))
    send(np.ascontiguousarray(H), np.ascontiguousarray(p), moved)
    return moved


def fit_field(q: FloatArray, shifts: FloatArray, noise: FloatArray, *, start: float | None = None) -> Field:
    """Return the robust fit to K ``(K, 2)`` shifts at ``(K, 2)`` field coordinates.

    ``noise`` ``(3, K)`` holds the elements xx, xy and yy of the shifts' covariances. With ``start`` the fit begins with
    so wide a robust scale and narrows it: for shifts of which many may be nonsense.
    """
    theta, covariance, shape = np.zeros(8), np.empty((8, 8)), np.empty((8, 8))
    left, pull = np.empty((len(q), 3)), np.empty((8, 1))
    gate2 = 0.0 if start is None else start**2
    q, shifts, noise = np.ascontiguousarray(q), np.ascontiguousarray(shifts), np.ascontiguousarray(noise)
    scatter2 = fit(q, shifts, noise, gate2, theta, covariance, shape, left, pull)
    return Field(theta, covariance, shape, scatter2, left[:, 2], pull[:, 0])


def visible(frame: Frame, G: FloatArray, size_a_px: tuple[int, int]) -> FloatArray:
    """``(N,)`` how much of the cell around every point of ``frame.grid()`` lies in a under the motion ``G``, 0..1."""
    p = project(G, frame.grid())
    extent = np.array(size_a_px, np.float64)
    cell = math.sqrt(abs(float(np.linalg.det(G[:2, :2])))) / frame.reach_px * max(frame.width_px, frame.height_px)
    inner = np.minimum(p + 0.5, extent - 0.5 - p) * (GRID_POINTS / cell)
    share: FloatArray = np.clip(inner + 0.5, 0.0, 1.0).prod(axis=1)
    return share


def closest_similarity(frame: Frame, G: FloatArray, covariance: FloatArray, weight: FloatArray) -> Closest:
    """Return the similarity closest to the motion ``G`` (field coordinates to a) over ``frame.grid()`` by weights.

    ``covariance`` ``(8, 8)`` is of the field's parameters; ``weight`` ``(N,)``.
    """
    q, w, r = frame.grid(), weight / weight.sum(), frame.reach_px
    zt, N, share = np.empty(4), np.empty((8, 8)), np.empty((4, 4))
    left2 = fit_similarity(q, project(G, q), w, zt, N, share)
    scale2 = float(zt[0] ** 2 + zt[1] ** 2)
    T_a_q = Similarity2D(float(zt[2]), float(zt[3]), math.atan2(zt[1], zt[0]), 0.5 * math.log(scale2))
    # The bend's own error is no bend.
    own = 0.5 * float((covariance[4:, 4:] * (N[4:, 4:] - N[4:, :4] @ share)).sum())
    M = np.zeros((4, 8))
    M[:, :4], M[:, 4:] = np.eye(4), share
    M[:2] *= r
    return Closest(T_a_q @ frame.T_q_b, M, max(left2 / scale2 - own, 0.0) * r**2)
