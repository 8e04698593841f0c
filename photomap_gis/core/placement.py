"""How mosaic, live, export and report know a frame: by its placement on the map, whatever model lies behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray, Similarity2D, transform_jacobian

MIN_DOWN = 1e-3
"""Rays that look down less than this share of their length do not meet the ground near."""
GROUND_STEPS = 6
"""A ray meets the ground by repeated looks at its height: each makes the error smaller by slope times ray's lean."""


class CameraToMap(Protocol):
    """The two-way road between a frame's pixels and the internal map frame (metres, x east, y south)."""

    def project(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixels to the map; NaN where a pixel does not see the ground."""
        ...

    def unproject(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` map points to pixels; NaN behind the camera."""
        ...

    def jacobian(self, xy_px: npt.ArrayLike) -> FloatArray:
        """``(N, 2, 2)`` derivative of ``project`` by the pixel, metres a pixel."""
        ...

    def position_covariance(self, xy_px: npt.ArrayLike, pose_covariance: FloatArray) -> FloatArray:
        """``(N, 2, 2)`` covariance in square metres of the map positions of ``(N, 2)`` pixels."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PlanePlacement:
    """A similarity of the frame's plane: levelled and undistorted by ``view``, placed by ``T_map_plane``."""

    view: PlaneView
    T_map_plane: Similarity2D

    def project(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixels to the map."""
        return self.T_map_plane.apply(self.view.to_plane(xy_px))

    def unproject(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` map points to pixels."""
        return self.view.to_pixel(self.T_map_plane.inverse().apply(xy_map_m))

    def jacobian(self, xy_px: npt.ArrayLike) -> FloatArray:
        """``(N, 2, 2)`` derivative of ``project`` by the pixel, by central differences over one pixel."""
        p = np.atleast_2d(np.asarray(xy_px, dtype=np.float64))
        columns = [self.project(p + h) - self.project(p - h) for h in ((0.5, 0.0), (0.0, 0.5))]
        return np.stack(columns, axis=-1)

    def position_covariance(self, xy_px: npt.ArrayLike, pose_covariance: FloatArray) -> FloatArray:
        """``(N, 2, 2)`` covariance in square metres of the map positions of ``(N, 2)`` pixels."""
        j = transform_jacobian(self.T_map_plane, self.view.to_plane(np.atleast_2d(np.asarray(xy_px, dtype=np.float64))))
        return np.einsum("nij,jk,nlk->nil", j, pose_covariance, j)


@dataclass(frozen=True, slots=True, eq=False)
class PosedPlacement:
    """A camera in space over the ground: where it was, how it was turned, and what it stood over.

    ``centre_map`` ``(3,)`` is x, y and the height **up** over the ground's middle level, in map units. ``R_map_camera``
    ``(3, 3)`` takes camera axes (x image right, y image down, z optical axis) into x east, y south, z **down**. A pose
    covariance is ``(6, 6)``: of ``(dx, dy, dz)`` of the centre (z down) and of a turn vector (radians) about the same
    axes: ``R_true = Exp(turn) R``; of it that which moves pixels over this ground, what camera and ground err alike
    left out.
    """

    camera: Camera
    centre_map: FloatArray
    R_map_camera: FloatArray
    ground: HeightField

    def project(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixels to the map; NaN where a pixel does not see the ground."""
        rays = self._rays(xy_px)
        x, y, up = self.centre_map
        slope = rays[..., :2] / np.where(rays[..., 2:] > MIN_DOWN, rays[..., 2:], np.nan)
        height = np.zeros(slope.shape[:-1])
        if self.ground.is_level:
            return np.asarray([x, y] + slope * (up - float(self.ground.up[0, 0])), np.float64)
        for _ in range(GROUND_STEPS):
            height = self.ground.at([x, y] + slope * (up - height)[..., None])
        return np.asarray([x, y] + slope * (up - height)[..., None], np.float64)

    def unproject(self, xy_map_m: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` map points to pixels; NaN behind the camera or beyond the lens's fold."""
        xy = np.asarray(xy_map_m, dtype=np.float64)
        x, y, up = self.centre_map
        dx, dy, dz = xy[..., 0] - x, xy[..., 1] - y, up - self.ground.at(xy)
        r = self.R_map_camera
        depth = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
        behind = depth <= 1e-9
        if behind.any():
            depth = np.where(behind, np.nan, depth)
        n_x = (r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz) / depth
        n_y = (r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz) / depth
        return self.camera.picture_of(n_x, n_y)

    def jacobian(self, xy_px: npt.ArrayLike) -> FloatArray:
        """``(N, 2, 2)`` derivative of ``project`` by the pixel, by central differences over one pixel."""
        p = np.atleast_2d(np.asarray(xy_px, dtype=np.float64))
        columns = [self.project(p + h) - self.project(p - h) for h in ((0.5, 0.0), (0.0, 0.5))]
        return np.stack(columns, axis=-1)

    def position_covariance(self, xy_px: npt.ArrayLike, pose_covariance: FloatArray) -> FloatArray:
        """``(N, 2, 2)`` covariance in square metres of the map positions of ``(N, 2)`` pixels, the ground's in it."""
        p = np.atleast_2d(np.asarray(xy_px, dtype=np.float64))
        ray = self._rays(p)
        ray = ray / np.where(ray[..., 2:] > MIN_DOWN, ray[..., 2:], np.nan)
        depth = self.centre_map[2] - self.ground.at(self.project(p))
        j = np.zeros((len(p), 2, 6))
        j[:, 0, 0] = j[:, 1, 1] = 1.0
        j[:, :, 2] = -ray[:, :2]
        for k in range(3):  # a turn moves the ray, and where it then meets the level below
            turned = np.cross(np.eye(3)[k], ray)
            j[:, :, 3 + k] = depth[:, None] * (turned[:, :2] - ray[:, :2] * turned[:, 2:])
        leaning = ray[:, :2, None] * ray[:, None, :2]
        return np.einsum("nij,jk,nlk->nil", j, pose_covariance, j) + leaning * self.ground.sigma**2

    @property
    def _focal(self) -> float:
        if self.camera.focal_px is None:
            raise ValueError("a camera without a focal length has no pose in space")
        return self.camera.focal_px

    def _rays(self, xy_px: npt.ArrayLike) -> FloatArray:
        """``(N, 3)`` where pixels look to, x east, y south, z down."""
        p = np.asarray(xy_px, dtype=np.float64) - self.camera.principal_xy_px
        n = self.camera.undistort(p / self._focal)
        return np.asarray(np.concatenate([n, np.ones((*n.shape[:-1], 1))], axis=-1) @ self.R_map_camera.T, np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FramePlacement:
    """Where one frame lies on the map, and how sure that is.

    ``pose_covariance`` is in the tangent space of its model; ``camera_to_map`` knows how to carry it to a pixel.
    """

    frame: int
    width_px: int
    height_px: int
    camera_to_map: CameraToMap
    pose_covariance: FloatArray
    status: FrameStatus = FrameStatus.REGISTERED
    segment: int = 0
    method: str = "ifmi"

    @property
    def centre_xy_px(self) -> FloatArray:
        """``(1, 2)`` the raster's centre."""
        return np.array([[(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0]])

    @property
    def centre_xy_map_m(self) -> FloatArray:
        """``(2,)`` where the raster's centre lies on the map."""
        return self.camera_to_map.project(self.centre_xy_px)[0]

    @property
    def plumb_xy_map_m(self) -> FloatArray | None:
        """``(2,)`` the point straight below the camera as far as its lean is known; ``None`` for other models."""
        where = self.camera_to_map
        if isinstance(where, PosedPlacement):
            return np.asarray(where.centre_map[:2], dtype=np.float64)
        return where.T_map_plane.apply(np.zeros((1, 2)))[0] if isinstance(where, PlanePlacement) else None

    @property
    def gsd_m_per_px(self) -> float:
        """Ground sampling distance at the raster's centre (root of the area of a pixel)."""
        return float(np.sqrt(abs(np.linalg.det(self.camera_to_map.jacobian(self.centre_xy_px)[0]))))

    @property
    def heading_rad(self) -> float:
        """Heading of the image's upper edge at the raster's centre, clockwise from grid north."""
        up = -self.camera_to_map.jacobian(self.centre_xy_px)[0][:, 1]
        return float(np.arctan2(up[0], -up[1]))

    def outline_xy_map_m(self, points_per_side: int = 4) -> FloatArray:
        """``(4 n, 2)`` the frame's border on the map, clockwise from the first pixel's outer corner, without NaN."""
        w, h, n = self.width_px, self.height_px, points_per_side
        t = np.arange(n) / n
        top = np.stack([t * w, np.zeros(n)], axis=1)
        right = np.stack([np.full(n, w), t * h], axis=1)
        ring = np.concatenate([top, right, [w, h] - top, [0, h] - (right - [w, 0])]) - 0.5
        xy = self.camera_to_map.project(ring)
        return xy[np.isfinite(xy).all(axis=1)]

    def position_covariance_m2(self, xy_px: npt.ArrayLike | None = None) -> FloatArray:
        """``(N, 2, 2)`` covariance (x east, y south) of the map positions of pixels; of the centre by default."""
        return self.camera_to_map.position_covariance(
            self.centre_xy_px if xy_px is None else xy_px, self.pose_covariance
        )
