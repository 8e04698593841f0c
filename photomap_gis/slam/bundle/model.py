"""Where a frame must see a spot that another frame saw, and how that hangs on both poses, the lens and the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.problem import BundleProblem, BundleState, cross_matrix

LEAST_DOWN = 0.1
"""Rays that look down by less than this share of their length are no use: they meet the ground far away."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Residuals (predicted minus seen) of M ties, ``(M, 2)`` pixels, and their derivatives.

    ``by_a``, ``by_b`` ``(M, 2, 6)`` by the steps of the views, ``by_lens_a``, ``by_lens_b`` ``(M, 2, 2)`` by those of
    the lenses (logarithm of the focal length, k1), ``by_z`` ``(M, 2)`` by the spots' z. ``valid`` ``(M,)``. ``xy_map``
    ``(M, 2)`` is where the spots lie.
    """

    residual: FloatArray
    by_a: FloatArray
    by_b: FloatArray
    by_lens_a: FloatArray
    by_lens_b: FloatArray
    by_z: FloatArray
    valid: np.ndarray
    xy_map: FloatArray


def cameras_of(problem: BundleProblem, state: BundleState) -> list[Camera]:
    """Return the lenses' cameras as the state has them."""
    return [
        replace(lens.camera, focal_px=float(np.exp(f)), k1=float(k))
        for lens, f, k in zip(problem.lenses, state.log_focal, state.k1, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Where the spots lie and how they are seen: ``ray`` ``(M, 3)`` from b, ``down`` how steeply, ``reach`` how far.

    ``spot`` ``(M, 3)`` lies in the world, ``from_a`` from a's centre; ``n_a`` ``(M, 2)`` is where a sees it (focal
    length 1), ``depth`` ``(M,)`` how far off; ``n_b`` where b does.
    """

    n_b: FloatArray
    ray: FloatArray
    down: FloatArray
    reach: FloatArray
    spot: FloatArray
    from_a: FloatArray
    depth: FloatArray
    n_a: FloatArray
    valid: np.ndarray


def sight(problem: BundleProblem, state: BundleState, cameras: list[Camera]) -> Sighting:
    """Return what the ties' spots are at a state."""
    t, lens_of = problem.ties, problem.lens_of
    n_b = np.empty_like(t.xy_b_px)
    for k, camera in enumerate(cameras):
        of = lens_of[t.b] == k
        n_b[of] = camera.undistort((t.xy_b_px[of] - camera.principal_xy_px) / camera.focal_px)
    R_b = state.R[t.b]
    ray = np.einsum("mij,mj->mi", R_b[:, :, :2], n_b) + R_b[:, :, 2]
    down = np.maximum(ray[:, 2], LEAST_DOWN)
    reach = (state.z[t.spot] - state.centre[t.b, 2]) / down
    spot = state.centre[t.b] + reach[:, None] * ray
    from_a = spot - state.centre[t.a]
    seen = np.einsum("mji,mj->mi", state.R[t.a], from_a)
    depth = np.maximum(seen[:, 2], 1e-6)
    valid = (ray[:, 2] > LEAST_DOWN) & (seen[:, 2] > 1e-6) & (reach > 0.0)
    return Sighting(n_b, ray, down, reach, spot, from_a, depth, seen[:, :2] / depth[:, None], valid)


def residuals(problem: BundleProblem, state: BundleState) -> tuple[FloatArray, np.ndarray]:
    """Return residuals ``(M, 2)`` and which of them are valid, without derivatives."""
    t, cameras = problem.ties, cameras_of(problem, state)
    s = sight(problem, state, cameras)
    predicted = np.empty_like(s.n_a)
    for k, camera in enumerate(cameras):
        of = problem.lens_of[t.a] == k
        predicted[of] = camera.distort(s.n_a[of]) * float(camera.focal_px or 1.0) + camera.principal_xy_px
    return predicted - t.xy_a_px, s.valid


def along_spots(problem: BundleProblem, state: BundleState) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Return residuals ``(M, 2)``, their derivatives by the spots' z ``(M, 2)``, and which of them are valid."""
    t, cameras = problem.ties, cameras_of(problem, state)
    s = sight(problem, state, cameras)
    predicted, by_n_a, _ = _distorted(cameras, problem.lens_of[t.a], s.n_a)
    step = np.einsum("mji,mj->mi", state.R[t.a], s.ray / s.down[:, None])
    by_seen = (step[:, :2] - s.n_a * step[:, 2:]) / s.depth[:, None]
    return predicted - t.xy_a_px, np.einsum("mij,mj->mi", by_n_a, by_seen), s.valid


def linearise(problem: BundleProblem, state: BundleState) -> Linearised:
    """Return residuals and derivatives of all ties at a state."""
    t = problem.ties
    cameras, lens_of = cameras_of(problem, state), problem.lens_of
    lens_a, lens_b = lens_of[t.a], lens_of[t.b]
    s = sight(problem, state, cameras)
    R_a, R_b = state.R[t.a], state.R[t.b]
    ray, down, reach, spot, from_a, depth, n_a = s.ray, s.down, s.reach, s.spot, s.from_a, s.depth, s.n_a
    by_m_b, k1_b = of_undistorting(cameras, lens_b, s.n_b)
    predicted, by_n_a, by_k1_a = _distorted(cameras, lens_a, n_a)
    residual = predicted - t.xy_a_px
    # from a's ideal coordinates back to the spot in space
    by_seen = np.zeros((len(t), 2, 3))
    by_seen[:, 0, 0] = by_seen[:, 1, 1] = 1.0 / depth
    by_seen[:, :, 2] = -n_a / depth[:, None]
    by_spot = by_n_a @ by_seen @ R_a.transpose(0, 2, 1)
    # what moves along the ray's level: a step of the ray is carried to the level of the spot
    level = np.broadcast_to(np.eye(3), (len(t), 3, 3)).copy()
    level[:, :, 2] -= ray / down[:, None]
    by_level = by_spot @ level
    by_ray = by_level * reach[:, None, None]
    by_a = np.concatenate([-by_spot, by_spot @ cross_matrix(from_a)], axis=2)
    by_b = np.concatenate([by_level, -by_ray @ cross_matrix(ray)], axis=2)
    by_n_b = by_ray @ R_b[:, :, :2]
    focal = np.exp(state.log_focal)
    m_b = (t.xy_b_px - _principal(cameras, lens_b)) / focal[lens_b][:, None]
    by_lens_a = np.stack([predicted - _principal(cameras, lens_a), by_k1_a], axis=2)
    by_lens_b = np.stack(
        [-np.einsum("mij,mj->mi", by_n_b @ by_m_b, m_b), -np.einsum("mij,mj->mi", by_n_b @ by_m_b, k1_b)], axis=2
    )
    by_z = np.einsum("mij,mj->mi", by_spot, ray / down[:, None])
    return Linearised(residual, by_a, by_b, by_lens_a, by_lens_b, by_z, s.valid, spot[:, :2])


def _principal(cameras: list[Camera], lens: np.ndarray) -> FloatArray:
    return np.array([c.principal_xy_px for c in cameras])[lens]


def _polynomial(camera: Camera, r2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distortion's factor and its derivative by the squared radius."""
    factor = 1.0 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3))
    return factor, camera.k1 + r2 * (2.0 * camera.k2 + 3.0 * r2 * camera.k3)


def of_undistorting(cameras: list[Camera], lens: np.ndarray, n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives ``(M, 2, 2)`` of ideal coordinates ``n`` by distorted ones, and what k1 adds to those."""
    by_m, added = np.empty((len(n), 2, 2)), np.empty_like(n)
    for k, camera in enumerate(cameras):
        of = lens == k
        factor, slope = _polynomial(camera, r2 := np.sum(n[of] ** 2, axis=1))
        # (f I + 2 s n n^T)^-1, by Sherman and Morrison
        outer = n[of][:, :, None] * n[of][:, None, :]
        share = 2.0 * slope / (factor * (factor + 2.0 * slope * r2))
        by_m[of] = np.eye(2) / factor[:, None, None] - share[:, None, None] * outer
        added[of] = n[of] * r2[:, None]
    return by_m, added


def _distorted(cameras: list[Camera], lens: np.ndarray, n: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels ``(M, 2)`` of ideal coordinates, their derivative ``(M, 2, 2)``, and that by k1 ``(M, 2)``."""
    xy, by_n, by_k1 = np.empty_like(n), np.empty((len(n), 2, 2)), np.empty_like(n)
    for k, camera in enumerate(cameras):
        of, f = lens == k, float(camera.focal_px or 1.0)
        factor, slope = _polynomial(camera, r2 := np.sum(n[of] ** 2, axis=1))
        bend = 2.0 * slope[:, None, None] * n[of][:, :, None] * n[of][:, None, :]
        xy[of] = f * n[of] * factor[:, None] + camera.principal_xy_px
        by_n[of] = f * (factor[:, None, None] * np.eye(2) + bend)
        by_k1[of] = f * n[of] * r2[:, None]
    return xy, by_n, by_k1
