"""How sure the full solution is: of cameras in space, of lenses, and of what pixels show of the ground.

Cameras and the ground under them rise, slope and bow together where little tells how high they are: that moves no pixel
of the map. What a camera's covariance says of its pixels is therefore told over its ground: the share that lens and
surface have in where pixels lie is taken along, as the pose that would move them alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.model import LEAST_DOWN, of_undistorting
from photomap_gis.slam.bundle.normal import Normal
from photomap_gis.slam.bundle.problem import BundleState, IntArray, cross_matrix

MODEL_FOCAL_LOG, MODEL_K1 = 0.003, 0.001
"""How far a lens's numbers may be off besides: what it has of higher terms, and the ties make of it, is in no model."""
SHARED_MISFIT = 0.5
"""How much of what ties are left off a frame's pixels share: ground that no smooth surface follows, leaves, blocks."""
PIXELS = 4
"""Pixels that are looked at along either side of a frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The six ways in which the whole surface may rise, slope and bow about ``middle`` ``(2,)``, ``reach`` far."""

    middle: FloatArray
    reach: float

    @classmethod
    def over(cls, xy: FloatArray) -> Surface:
        """Return the surface under ``(P, 2)`` spots."""
        middle = np.median(xy, axis=0)
        return cls(middle, float(np.abs(xy - middle).mean()) + 1e-9)

    def bends(self, xy: FloatArray) -> FloatArray:
        """``(..., 6)`` by how much each moves the z of ``(..., 2)`` map points."""
        u, v = np.moveaxis((xy - self.middle) / self.reach, -1, 0)
        return np.stack([np.ones_like(u), u, v, u * u - v * v, u * v, u * u + v * v - 2.0], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """Covariances: ``poses`` ``(N, 6, 6)`` in space, ``over_ground`` ``(N, 6, 6)`` as the map's pixels have it, and the
    lenses' sigmas ``lens`` ``(L, 2)`` of log focal length and k1.

    ``joint`` and ``joint_over_ground`` ``(6 N, 6 N)`` are those of all poses together, where they were asked for.
    """

    poses: FloatArray
    over_ground: FloatArray
    lens: FloatArray
    joint: FloatArray | None = None
    joint_over_ground: FloatArray | None = None


def certainty(
    normal: Normal,
    state: BundleState,
    cameras: list[Camera],
    lens_of: IntArray,
    ground: HeightField,
    surface: Surface,
    free: np.ndarray,
    *,
    misfit: float,
    joint: bool = False,
) -> Certainty:
    """Return how sure a solution is; ``normal`` as far as it is believed, ``free`` ``(L, 2)`` lens numbers in it.

    ``misfit`` is what ties were left off per axis, in map units: what of it one frame's ties share is in no pose.
    """
    shared, with_shared = normal.shared_covariance()
    lenses = 2 * len(cameras)
    held = np.concatenate([~free.ravel(), np.zeros(len(shared) - lenses, bool)])
    shared[held], shared[:, held], with_shared[:, :, held] = 0.0, 0.0, 0.0
    loose = np.flatnonzero(free.ravel())
    besides = np.tile([MODEL_FOCAL_LOG**2, MODEL_K1**2], len(cameras))[loose]
    known = np.linalg.inv(shared[np.ix_(loose, loose)])
    of_shared, of_poses = shared[:, loose] @ known, with_shared[:, :, loose] @ known
    shared = shared + (of_shared * besides) @ of_shared.T
    with_shared = with_shared + (of_poses * besides) @ of_shared.T
    alike = np.empty_like(with_shared)
    for k, camera in enumerate(cameras):
        of = lens_of == k
        alike[of] = _alike(camera, state.centre[of], state.R[of], ground, surface, k, len(cameras))
    alike[:, :, held] = 0.0
    local = np.zeros(6)
    local[:2] = (SHARED_MISFIT * misfit) ** 2

    def over_ground(poses: FloatArray, by: FloatArray, alike: FloatArray) -> FloatArray:
        across = by @ alike.swapaxes(-1, -2)
        return np.asarray(poses + across + across.swapaxes(-1, -2) + alike @ shared @ alike.swapaxes(-1, -2))

    poses = normal.pose_covariances() + (of_poses * besides) @ of_poses.transpose(0, 2, 1)
    lens = np.sqrt(np.diag(shared)[:lenses]).reshape(-1, 2)
    sure = Certainty(poses, over_ground(poses, with_shared, alike) + np.diag(local), lens)
    if not joint:
        return sure
    flat_poses, flat_shared, flat_alike = (v.reshape(-1, v.shape[2]) for v in (of_poses, with_shared, alike))
    whole = normal.joint_covariance() + (flat_poses * besides) @ flat_poses.T
    told = over_ground(whole, flat_shared, flat_alike) + np.diag(np.tile(local, len(poses)))
    return replace(sure, joint=whole, joint_over_ground=told)


def _alike(
    camera: Camera, centre: FloatArray, R: FloatArray, ground: HeightField, surface: Surface, lens: int, lenses: int
) -> FloatArray:
    """``(N, 6, 2 L + 6)`` the steps of poses that move a frame's pixels as each lens number and each bend does."""
    n = len(centre)
    x, y = ((np.arange(PIXELS) + 0.5) / PIXELS * side - 0.5 for side in (camera.width_px, camera.height_px))
    m = (np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) - camera.principal_xy_px) / float(camera.focal_px or 1.0)
    ideal = camera.undistort(m)
    by_m, added = of_undistorting([camera], np.zeros(len(m), np.intp), ideal)
    ray = np.einsum("nij,pj->npi", R[:, :, :2], ideal) + R[:, None, :, 2]
    down = np.maximum(ray[..., 2], LEAST_DOWN)
    slope = ray[..., :2] / down[..., None]
    depth = np.broadcast_to(-centre[:, 2:], down.shape)
    for _ in range(2):
        seen = centre[:, None, :2] + slope * depth[..., None]
        depth = -ground.at(seen) - centre[:, 2:]
    level = np.zeros((*down.shape, 2, 3))
    level[..., 0, 0] = level[..., 1, 1] = 1.0
    level[..., 2] = -slope
    by_ray = level * (depth / down)[..., None, None]
    turn = -by_ray @ cross_matrix(ray.reshape(-1, 3)).reshape(*ray.shape, 3)
    by_pose = np.concatenate([level, turn], axis=-1).reshape(n, -1, 6)
    moved = np.zeros((*down.shape, 2, 2 * lenses + 6))
    by_ideal = by_ray @ R[:, None, :, :2]
    moved[..., 2 * lens] = -np.einsum("npij,pj->npi", by_ideal, np.einsum("pij,pj->pi", by_m, m))
    moved[..., 2 * lens + 1] = -np.einsum("npij,pj->npi", by_ideal, np.einsum("pij,pj->pi", by_m, added))
    moved[..., 2 * lenses :] = slope[..., None] * surface.bends(seen)[..., None, :]
    return np.asarray(np.linalg.pinv(by_pose) @ moved.reshape(n, by_pose.shape[1], -1), np.float64)
