"""Sloping ground under levelled cameras: what a pair of frames tells of it.

Two cameras at one height see a spot of sloping ground from the same depth, so what they share has the same scale in
both, although the ground below the one is nearer than below the other: a chain of similarities bends the map like a
keystone. With both cameras level, a point u of a plane (pixels, focal length f) lies at ``u / (1 + s.u / f)`` in
the scale of the ground below the camera, where s is the ground's rise. What is left between two frames then is a
similarity, and six numbers explain the homography that was measured: the similarity's four and the slope's two.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.posegraph import Edge
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity, transform_jacobian

PRIOR_SLOPE = 0.15
"""One sigma of the slope along either axis before looking."""
MAX_SLOPE = 0.6
ITERATIONS = 6
STEP = 1e-6
SETTLED_PX, SETTLED_SLOPE = 1e-3, 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class SlopedMotion:
    """A motion between planes that know the slope, and how it was found.

    ``slope`` ``(2,)`` is along plane a's axes; ``inflation`` ``(4,)`` is by what the sigmas grow since two more numbers
    are drawn from the same pixels; ``left_px`` is what this model leaves of the homography (RMS per axis), ``flat_px``
    what a similarity alone leaves.
    """

    T_a_b: Similarity2D
    slope: FloatArray
    inflation: FloatArray
    left_px: float
    flat_px: float


def fit_slope(
    points_a: FloatArray, points_b: FloatArray, focal_a_px: float, focal_b_px: float, *, noise_px: float = 1.0
) -> SlopedMotion | None:
    """Return the motion and the slope that explain ``(N, 2)`` pairs of plane points; ``None`` where they do not settle.

    ``noise_px`` is how far a pair may be off, against which the slope's prior is held.
    """
    T = fit_similarity(points_a, points_b)
    flat = float(np.sqrt(0.5 * np.mean(np.sum((T.apply(points_b) - points_a) ** 2, axis=1))))
    slope = np.zeros(2)
    prior = np.diag([0.0] * 4 + [(noise_px / PRIOR_SLOPE) ** 2] * 2)

    def seen(T: Similarity2D, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points on the ground in the scale below a, and those of b in the scale below b."""
        c, s = np.cos(T.angle_rad), np.sin(T.angle_rad)
        along_b = np.array([c * slope[0] + s * slope[1], -s * slope[0] + c * slope[1]])
        ground_a = points_a / (1.0 + points_a @ slope / focal_a_px)[:, None]
        return ground_a, points_b / (1.0 + points_b @ along_b / focal_b_px)[:, None]

    def residual(T: Similarity2D, slope: FloatArray) -> FloatArray:
        ground_a, ground_b = seen(T, slope)
        return T.apply(ground_b) - ground_a

    for _ in range(ITERATIONS):
        r = residual(T, slope)
        by_slope = [(residual(T, slope + h) - residual(T, slope - h)) / (2 * STEP) for h in np.eye(2) * STEP]
        J = np.concatenate([transform_jacobian(T, seen(T, slope)[1]), np.stack(by_slope, axis=-1)], axis=-1)
        flat_J = J.reshape(-1, 6)
        normal = flat_J.T @ flat_J + prior
        step = np.linalg.solve(normal, -flat_J.T @ r.ravel() - prior @ np.concatenate([np.zeros(4), slope]))
        T, slope = T @ Similarity2D.exp(step[:4]), slope + step[4:]
        if not np.isfinite(step).all() or np.hypot(*slope) > MAX_SLOPE:
            return None
        if np.abs(step[:2]).max() < SETTLED_PX and np.abs(step[4:]).max() < SETTLED_SLOPE:
            break
    left = float(np.sqrt(0.5 * np.mean(np.sum(residual(T, slope) ** 2, axis=1))))
    alone = np.diag(np.linalg.inv(flat_J[:, :4].T @ flat_J[:, :4]))
    inflation = np.sqrt(np.diag(np.linalg.inv(normal))[:4] / alone)
    return SlopedMotion(T, slope, inflation, left, flat)


def slopes_of_frames(edges: Iterable[Edge]) -> Mapping[int, tuple[float, float]]:
    """Return the ground's slope under each frame along its plane's axes: the median of what its edges tell."""
    told: dict[int, list[FloatArray]] = {}
    for e in edges:
        if e.ground_slope is None:
            continue
        slope, angle = np.array(e.ground_slope), e.T_a_b.angle_rad
        c, s = np.cos(angle), np.sin(angle)
        told.setdefault(e.a, []).append(slope)
        told.setdefault(e.b, []).append(np.array([c * slope[0] + s * slope[1], -s * slope[0] + c * slope[1]]))
    medians = {frame: np.median(np.array(slopes), axis=0) for frame, slopes in told.items()}
    return {frame: (float(m[0]), float(m[1])) for frame, m in medians.items()}
