"""How mosaic, live, export and report know a frame: by its placement on the map, whatever model lies behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.similarity import FloatArray, Similarity2D, transform_jacobian


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
class FramePlacement:
    """Where one frame lies on the map, and how sure that is.

    ``pose_covariance`` is ``(4, 4)`` in the solver's tangent space; ``camera_to_map`` knows how to carry it to a pixel.
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
