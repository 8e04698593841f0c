"""A smooth field of residual motion over a frame: a small homography beside the similarity, and its robust fit.

Eight degrees of freedom in pixels at ``reach_px`` from b's centre: shift x, shift y, turn, growth (the similarity),
two stretches and two perspectives (the *bend*, which no similarity can express).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

BEND_PRIOR = 0.06
"""One sigma of stretch and perspective before looking: displacement at ``reach_px`` over that length."""
GRID_POINTS = 15


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The frame b that a field lives on: its size, the field's origin (its centre), the field's unit of length."""

    width_px: int
    height_px: int

    @property
    def centre(self) -> FloatArray:
        """``(2,)`` centre in pixels."""
        return np.array([(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0])

    @property
    def reach_px(self) -> float:
        """Half the longer side."""
        return max(self.width_px, self.height_px) / 2.0

    def grid(self) -> FloatArray:
        """``(N, 2)`` points evenly over the frame."""
        cell = (np.arange(GRID_POINTS) + 0.5) / GRID_POINTS
        x, y = np.meshgrid(cell * self.width_px - 0.5, cell * self.height_px - 0.5)
        return np.stack([x.ravel(), y.ravel()], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """``theta`` ``(8,)`` and its covariance; ``scatter2`` the variance per axis that the field leaves, noise apart.

    ``residual2`` ``(K,)`` is half the squared distance of every observation from the field.
    """

    frame: Frame
    theta: FloatArray
    covariance: FloatArray
    scatter2: float
    residual2: FloatArray

    def displacement(self, p: FloatArray) -> FloatArray:
        """``(N, 2)`` displacements at ``(N, 2)`` points of b; the field's exact homography, not its derivative."""
        return displacement(self.frame, p, self.theta)

    def matrix(self, T_a_b: Similarity2D) -> FloatArray:
        """``(3, 3)`` homography from b to a: the field, then ``T_a_b``."""
        t, r = self.theta, self.frame.reach_px
        H = np.array(
            [
                [1.0 + (t[3] + t[4]) / r, (t[5] - t[2]) / r, t[0]],
                [(t[2] + t[5]) / r, 1.0 + (t[3] - t[4]) / r, t[1]],
                [-t[6] / r**2, -t[7] / r**2, 1.0],
            ]
        )
        shift = Similarity2D.translation_of(*self.frame.centre)
        return T_a_b.matrix @ shift.matrix @ H @ shift.inverse().matrix

    def closest_similarity(self, p: FloatArray) -> tuple[Similarity2D, FloatArray, float]:
        """Return the similarity about b's centre closest to the field at ``(N, 2)`` points.

        Also its ``(4, 4)`` covariance (order ``DOF``) and the mean square per axis of what it leaves of the field.
        """
        centre, r = self.frame.centre, self.frame.reach_px
        q = p - centre
        moved = q + self.displacement(p)
        closest = fit_similarity(moved, q)
        flat = basis(self.frame, p).reshape(-1, 8)
        share = np.linalg.lstsq(flat[:, :4], flat[:, 4:], rcond=None)[0]
        bend = flat[:, 4:] - flat[:, :4] @ share
        left2 = 0.5 * float(np.mean(np.sum((closest.apply(q) - moved) ** 2, axis=1)))
        left2 -= float(np.mean(np.einsum("ni,ij,nj->n", bend, self.covariance[4:, 4:], bend)))
        M = np.diag([1.0, 1.0, 1.0 / r, 1.0 / r]) @ np.hstack([np.eye(4), share])
        return closest, M @ self.covariance @ M.T, max(left2, 0.0)


def fit_field(
    frame: Frame,
    points: FloatArray,
    shifts: FloatArray,
    noise2: FloatArray,
    *,
    scatter_share: float,
    start_px: float | None = None,
) -> Field:
    """Return the robust fit to K ``(K, 2)`` shifts at ``(K, 2)`` points with variances ``(K,)`` per axis.

    ``scatter_share`` is how much of the scatter counts as noise of the field. With ``start_px`` the fit begins with so
    wide a robust scale and narrows it: for shifts of which many may be nonsense.
    """
    B = basis(frame, points)
    r = frame.reach_px
    prior = np.diag([1e-6] * 4 + [1.0 / (BEND_PRIOR * r) ** 2] * 4)
    freedom = max(0.3, 1.0 - 8.0 / (2.0 * len(points)))
    noise = float(np.median(noise2))
    theta, left = np.zeros(8), shifts
    left2 = 0.5 * np.sum(left * left, axis=1)
    scatter2, gate2 = 0.01, None if start_px is None else start_px**2
    for _ in range(8):
        if gate2 is not None:
            scale2 = np.maximum(noise2, gate2)
            weight = 1.0 / (scale2 * (1.0 + left2 / scale2) ** 2)
            gate2 = gate2 / 3.0 if gate2 > noise else None
        else:
            # The median of squares of a 2-D Gaussian is log 2 times its mean.
            scatter2 = max(float(np.median(left2)) / math.log(2.0) / freedom - noise, 1e-4)
            weight = 1.0 / ((noise2 + scatter2) * (1.0 + left2 / (6.0 * (scatter2 + noise2))))
        BW = B.reshape(-1, 8).T * np.repeat(weight, 2)
        theta = theta + np.linalg.solve(BW @ B.reshape(-1, 8) + prior, BW @ left.ravel() - prior @ theta)
        left = shifts - displacement(frame, points, theta)
        left2 = 0.5 * np.sum(left * left, axis=1)
    robust = 1.0 / (1.0 + left2 / (6.0 * (scatter2 + noise2)))
    w = robust / (noise2 + scatter_share * scatter2)
    covariance = np.linalg.inv(np.einsum("nki,n,nkj->ij", B, w, B) + prior)
    return Field(frame, theta, covariance, scatter2, left2)


def basis(frame: Frame, points: FloatArray) -> FloatArray:
    """``(N, 2, 8)`` derivative of the displacement by theta at 0."""
    x, y = ((points - frame.centre) / frame.reach_px).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = [[one, zero, -y, x, x, y, x * x, x * y], [zero, one, x, y, -y, x, x * y, y * y]]
    return np.array(rows).transpose(2, 0, 1)


def displacement(frame: Frame, points: FloatArray, theta: FloatArray) -> FloatArray:
    """``(N, 2)`` displacement by the homography whose derivative at zero is ``basis``."""
    p = points - frame.centre
    t, r = theta, frame.reach_px
    linear = np.array([[1.0 + (t[3] + t[4]) / r, (t[5] - t[2]) / r], [(t[2] + t[5]) / r, 1.0 + (t[3] - t[4]) / r]])
    depth = np.clip(1.0 - p @ t[6:] / r**2, 0.2, 5.0)
    return np.asarray((p @ linear.T + t[:2]) / depth[:, None] - p, np.float64)
