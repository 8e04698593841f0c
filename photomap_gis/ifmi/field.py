"""A smooth field of residual motion over a frame: a small homography beside the similarity, and its robust fit.

Eight parameters in field coordinates (origin b's centre, unit half its longer side): shift x, shift y, turn, growth
(the similarity), two stretches and two perspectives (the *bend*, which no similarity can express).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

BEND_PRIOR = 0.06
"""One sigma of stretch and perspective before looking."""
PRIOR_DIAGONAL = np.array([1e-6] * 4 + [1.0 / BEND_PRIOR**2] * 4)
PRIOR = np.diag(PRIOR_DIAGONAL)
GRID_POINTS = 16
"""Points of the grid along the longer side."""
LEAST_SCATTER = 1e-4
ROUNDS = 3
TAIL = 6.0
"""Observations of so many variances count half."""
SIGNIFICANT = 1.5
"""Scatter counts from so many standard deviations of what noise alone would show."""


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
    h = p @ H[:, :2].T + H[:, 2]
    return np.asarray(h[:, :2] / np.maximum(h[:, 2:], 0.05), np.float64)


def basis(q: FloatArray) -> FloatArray:
    """``(8, 2, N)`` derivative by theta at 0 of the displacement (x, y) at ``(N, 2)`` field coordinates."""
    x, y = q.T
    B = np.zeros((8, 2, len(q)))
    B[0, 0] = B[1, 1] = 1.0
    B[2, 0], B[2, 1] = -y, x
    B[3, 0], B[3, 1] = x, y
    B[4, 0], B[4, 1] = x, -y
    B[5, 0], B[5, 1] = y, x
    np.multiply(B[3], x, out=B[6])
    np.multiply(B[3], y, out=B[7])
    return B


def fit_field(q: FloatArray, shifts: FloatArray, noise: FloatArray, *, start: float | None = None) -> Field:
    """Return the robust fit to K ``(K, 2)`` shifts at ``(K, 2)`` field coordinates.

    ``noise`` ``(3, K)`` holds the elements xx, xy and yy of the shifts' covariances. With ``start`` the fit begins with
    so wide a robust scale and narrows it: for shifts of which many may be nonsense.
    """
    B = basis(q)
    nxx, nxy, nyy = noise
    noise2 = 0.5 * (nxx + nyy)
    freedom = max(0.3, 1.0 - 8.0 / (2.0 * len(q)))
    usual = float(noise2.mean())
    flat, W = B.reshape(8, -1), np.empty_like(B)
    BW = W.reshape(8, -1)
    theta = np.zeros(8)
    left = np.ascontiguousarray(shifts.T)
    left2 = _half_squared(left)
    scatter2, gate2 = LEAST_SCATTER * usual, None if start is None else start**2
    for _ in range(ROUNDS if start is None else ROUNDS + 3):
        if gate2 is not None:
            scale2 = np.maximum(noise2, gate2)
            ixx = 1.0 / (scale2 * np.square(1.0 + left2 / scale2))
            ixy, iyy = np.zeros(len(q)), ixx
            gate2 = gate2 / 3.0 if gate2 > usual else None
        else:
            scatter2 = _scatter2(left2 / freedom, noise2)
            ixx, ixy, iyy = _robust_information(nxx + scatter2, nxy, nyy + scatter2, left)
        W[:, 0] = ixx * B[:, 0] + ixy * B[:, 1]
        W[:, 1] = ixy * B[:, 0] + iyy * B[:, 1]
        curvature = BW @ flat.T + PRIOR
        theta = theta + np.linalg.solve(curvature, BW @ left.ravel() - PRIOR_DIAGONAL * theta)
        left = shifts.T - (project(field_matrix(theta), q) - q).T
        left2 = _half_squared(left)
    # Whatever else moves the blocks, the weights used are these: their sandwich carries both kinds of error.
    bread = np.linalg.inv(curvature)
    noisy = np.stack([nxx * W[:, 0] + nxy * W[:, 1], nxy * W[:, 0] + nyy * W[:, 1]], axis=1).reshape(8, -1)
    pull = np.asarray(np.linalg.solve(flat @ flat.T + PRIOR, flat @ left.ravel()), np.float64)
    return Field(theta, bread @ (noisy @ BW.T) @ bread, bread @ (BW @ BW.T) @ bread, scatter2, left2, pull)


def _robust_information(
    xx: FloatArray, xy: FloatArray, yy: FloatArray, left: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the inverses (elements xx, xy, yy) of covariances, less where what is ``left`` ``(2, K)`` is unlikely."""
    x, y = left
    one = 1.0 / (xx * yy - xy * xy)
    m2 = 0.5 * one * (yy * x * x - 2.0 * xy * x * y + xx * y * y)
    one /= 1.0 + m2 / TAIL
    return one * yy, -one * xy, one * xx


def _half_squared(left: FloatArray) -> FloatArray:
    """``(K,)`` half the squared length of ``(2, K)`` vectors: their square per axis."""
    return np.asarray(0.5 * (left[0] * left[0] + left[1] * left[1]), np.float64)


def _scatter2(left2: FloatArray, noise2: FloatArray) -> float:
    """Return how much more ``(K,)`` squared residuals (per axis) are than their variances, where it is significant."""
    chance = 1.0 + SIGNIFICANT / math.sqrt(len(left2))
    noise = float(noise2.mean())
    return max(float(left2.mean()) - chance * noise, LEAST_SCATTER * noise)


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
    q, w = frame.grid(), weight / weight.sum()
    moved = project(G, q)
    T_a_q = fit_similarity(moved, q, w)
    flat, r = _grid_basis(frame.width_px, frame.height_px), frame.reach_px
    N = (flat.reshape(8, 2, -1) * w).reshape(8, -1) @ flat.T
    share = np.linalg.solve(N[:4, :4], N[:4, 4:])
    off = T_a_q.apply(q) - moved
    bend2 = 0.5 * float(w @ (off * off).sum(axis=1)) / T_a_q.scale**2
    # The bend's own error is no bend.
    bend2 -= 0.5 * float((covariance[4:, 4:] * (N[4:, 4:] - N[4:, :4] @ share)).sum())
    M = np.zeros((4, 8))
    M[:, :4], M[:, 4:] = np.eye(4), share
    M[:2] *= r
    return Closest(T_a_q @ frame.T_q_b, M, max(bend2, 0.0) * r**2)


@lru_cache(maxsize=16)
def _grid_basis(width_px: int, height_px: int) -> FloatArray:
    """``(8, 2 N)`` basis at the points of a frame's grid."""
    flat = basis(_grid(width_px, height_px)).reshape(8, -1)
    flat.setflags(write=False)
    return flat
