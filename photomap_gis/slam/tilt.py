"""How each camera leaned, told by how its pairs bend: for flights that do not report it.

A camera that leans by small angles t = (x, y) sees a point of its level plane moved: a plane point u (pixels, focal
length f) lies at ``u + f t + u (u . t) / f`` in the level plane. The shift hides in the pair's motion; what is left,
the quadratic part, no similarity and no slope can make. Every pair measures it for two frames, every frame is in many
pairs: one linear least-squares system gives all tilts, the pairs' own motions and slopes taken out beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, fit_similarity, transform_jacobian
from photomap_gis.slam.robust import redescending, spread
from photomap_gis.slam.slope import fit_slope

LEANING = 5e-4
"""What slopes leave of a flight's bends (median RMS over focal length) from which its cameras leaned: some 0.25°."""
NOISE_PX = 0.3
"""How far a point of a measured homography may be off, in pixels of the images that were registered."""
TILT_SIGMA_RAD = 0.07
"""Prior: a camera that is meant to look down leans by a few degrees."""
SLOPE_SIGMA = 0.05
ROUNDS = 4
LIMIT = 2.5
INDEPENDENT = 8.0
"""Numbers in a pair's homography: as many measurements its points stand for."""
SAMPLE = 150
"""Pairs looked at to tell whether a flight's cameras leaned."""
MAX_FRAMES = 3000
"""The system is dense; beyond this it would no longer fit an ordinary laptop."""


@dataclass(frozen=True, slots=True)
class Leaning:
    """How a frame's plane must be levelled still: focal length, and ``tilt_rad`` along plane x and y."""

    focal_px: float
    tilt_rad: tuple[float, float] = (0.0, 0.0)

    def level(self, points: FloatArray) -> FloatArray:
        """Map ``(N, 2)`` points of the plane to the level plane."""
        return points if self.tilt_rad == (0.0, 0.0) else levelled(points, self.focal_px, self.tilt_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """``(N, 2)`` points of two planes that show the same ground, focal lengths, and how far the points may be off."""

    a: int
    b: int
    points_a: FloatArray
    points_b: FloatArray
    focal_a_px: float
    focal_b_px: float
    noise_px: float


def level_from_tilt(tilt_rad: tuple[float, float]) -> FloatArray:
    """``(3, 3)`` ``R_level_camera`` of a camera that leans by ``tilt_rad``: shortest rotation, along plane x and y."""
    angle = float(np.hypot(*tilt_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y = tilt_rad[0] / angle, tilt_rad[1] / angle
    k = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def levelled(points: FloatArray, focal_px: float, tilt_rad: tuple[float, float]) -> FloatArray:
    """Map ``(N, 2)`` points of an unlevelled plane to the level one."""
    rays = np.column_stack([points / focal_px, np.ones(len(points))]) @ level_from_tilt(tilt_rad).T
    return focal_px * rays[:, :2] / np.maximum(rays[:, 2:], 1e-3)


def leans(bends: Sequence[Bend]) -> bool:
    """Whether a flight's pairs bend as slopes alone cannot explain."""
    left = []
    for bend in bends[:: max(1, len(bends) // SAMPLE)]:
        motion = fit_slope(bend.points_a, bend.points_b, bend.focal_a_px, bend.focal_b_px, noise_px=bend.noise_px)
        left.append(np.inf if motion is None else motion.left_px / bend.focal_a_px)
    return bool(left) and float(np.median(left)) > LEANING


def estimate_tilts(bends: Sequence[Bend]) -> Mapping[int, tuple[float, float]]:
    """Return by frame how its camera leaned, in radians along plane x and y; empty where nothing can be told."""
    frames = sorted({f for bend in bends for f in (bend.a, bend.b)})
    if not bends or len(frames) > MAX_FRAMES:
        return {}
    node = {f: k for k, f in enumerate(frames)}
    tilt = np.zeros((len(frames), 2))
    weights = np.ones(len(bends))
    for _ in range(ROUNDS):
        normal = np.eye(2 * len(frames)) / TILT_SIGMA_RAD**2
        gradient = -tilt.ravel() / TILT_SIGMA_RAD**2
        squared, parts = np.zeros(len(bends)), []
        for k, bend in enumerate(bends):
            i, j = node[bend.a], node[bend.b]
            a = levelled(bend.points_a, bend.focal_a_px, (tilt[i, 0], tilt[i, 1]))
            b = levelled(bend.points_b, bend.focal_b_px, (tilt[j, 0], tilt[j, 1]))
            design, left = _reduced(a, b, bend)
            parts.append((i, j, design, left))
            squared[k] = left @ left / max(len(left), 1) / bend.noise_px**2
        beyond = spread(squared, 1)
        weights = redescending(squared / beyond**2, LIMIT)
        for (i, j, design, left), bend, w in zip(parts, bends, weights, strict=True):
            # a pair's points are not independent: together they count for a handful
            scale = w / (bend.noise_px * beyond) ** 2 * INDEPENDENT / max(len(left), 1)
            at = np.array([2 * i, 2 * i + 1, 2 * j, 2 * j + 1])
            normal[np.ix_(at, at)] += scale * design.T @ design
            gradient[at] -= scale * design.T @ left
        tilt = tilt + np.linalg.solve(normal, gradient).reshape(-1, 2)
        tilt = np.clip(tilt, -0.6, 0.6)
    tilt -= _common_lean(bends, node, tilt)
    return {f: (float(tilt[k, 0]), float(tilt[k, 1])) for f, k in node.items()}


def _common_lean(bends: Sequence[Bend], node: Mapping[int, int], tilt: FloatArray) -> FloatArray:
    """``(N, 2)`` what all frames of a connected piece lean alike along the map's axes, turned into each frame's.

    Cameras that lean alike to the north, whatever their heading, look just like ground that slopes to the north, and
    ground does that where cameras do not: it is left to the slope.
    """
    turns: dict[int, list[tuple[int, float]]] = {k: [] for k in node.values()}
    for bend in bends:
        angle = fit_similarity(bend.points_a, bend.points_b).angle_rad
        turns[node[bend.a]].append((node[bend.b], angle))
        turns[node[bend.b]].append((node[bend.a], -angle))
    out = np.zeros_like(tilt)
    heading: dict[int, float] = {}
    for first in turns:
        if first in heading:
            continue
        heading[first], piece = 0.0, [first]
        for k in piece:  # grows while it is walked
            for other, angle in turns[k]:
                if other not in heading:
                    heading[other] = heading[k] + angle
                    piece.append(other)
        turned = np.exp(1j * np.array([heading[k] for k in piece]))
        common = np.mean((tilt[piece] @ (1, 1j)) * turned)
        own = common * np.conj(turned)
        out[piece] = np.column_stack([own.real, own.imag])
    return out


def _reduced(a: FloatArray, b: FloatArray, bend: Bend) -> tuple[FloatArray, FloatArray]:
    """Return design ``(2 N, 4)`` (tilts of a and b) and residual ``(2 N,)``, the pair's motion and slope taken out."""
    T = fit_similarity(a, b)
    residual = (T.apply(b) - a).ravel()
    by_motion = transform_jacobian(T, b).reshape(-1, 4)
    # Slope s along a's axes moves a by -a (s.a) / f, and b by the same law along its own.
    turn = T.linear / T.scale
    by_slope = (
        _quadratic(a) / bend.focal_a_px - np.einsum("ij,njk,kl->nil", T.linear, _quadratic(b) / bend.focal_b_px, turn.T)
    ).reshape(-1, 2)
    nuisance = np.hstack([by_motion, by_slope])
    prior = np.diag([0.0] * 4 + [(bend.noise_px / SLOPE_SIGMA) ** 2 * len(a) / INDEPENDENT] * 2)
    by_a = -(bend.focal_a_px * np.eye(2) + _quadratic(a) / bend.focal_a_px)
    by_b = np.einsum("ij,njk->nik", T.linear, bend.focal_b_px * np.eye(2) + _quadratic(b) / bend.focal_b_px)
    design = np.concatenate([by_a, by_b], axis=-1).reshape(-1, 4)
    solve = np.linalg.solve(nuisance.T @ nuisance + prior, nuisance.T)
    return design - nuisance @ (solve @ design), residual - nuisance @ (solve @ residual)


def _quadratic(points: FloatArray) -> FloatArray:
    """``(N, 2, 2)`` outer product of each point with itself."""
    return points[:, :, None] * points[:, None, :]
