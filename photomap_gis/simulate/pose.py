"""A true camera pose in the grid of the ground's CRS."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import Attitude
from photomap_gis.core.similarity import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where the camera's eye is and how it stands.

    ``height_m`` is in the heights of the ground raster (not above ground). ``R_grid_camera`` is ``(3, 3)``: camera axes
    (x image right, y image down, z optical axis) into **grid** north, east, down, as ``Attitude.R_ned_camera`` does.
    """

    easting_m: float
    northing_m: float
    height_m: float
    R_grid_camera: FloatArray

    @classmethod
    def of_body(
        cls, en_m: tuple[float, float], height_m: float, *, roll_rad: float, pitch_rad: float, yaw_rad: float
    ) -> CameraPose:
        """Return the pose of a camera under the belly, image top to the nose; yaw from **grid** north."""
        attitude = Attitude.of_body_camera(roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad)
        return cls(en_m[0], en_m[1], height_m, attitude.R_ned_camera)

    def project(self, camera: Camera, enh_m: npt.ArrayLike) -> FloatArray:
        """``(N, 2)`` pixels of ``(N, 3)`` points (easting, northing, height); NaN behind the camera."""
        p = np.atleast_2d(np.asarray(enh_m, dtype=np.float64)) - (self.easting_m, self.northing_m, self.height_m)
        ned = np.stack([p[:, 1], p[:, 0], -p[:, 2]], axis=1)
        rays = ned @ self.R_grid_camera
        depth = np.where(rays[:, 2:] > 1e-9, rays[:, 2:], np.nan)
        return _focal(camera) * camera.distort(rays[:, :2] / depth) + camera.principal_xy_px

    def ground_points(self, camera: Camera, xy_px: npt.ArrayLike, plane_height_m: float) -> FloatArray:
        """``(N, 2)`` easting, northing where ``(N, 2)`` pixels see a level plane; NaN at or above the horizon."""
        n = camera.undistort((np.atleast_2d(np.asarray(xy_px, float)) - camera.principal_xy_px) / _focal(camera))
        ned = np.concatenate([n, np.ones((len(n), 1))], axis=1) @ self.R_grid_camera.T
        down = np.where(ned[:, 2:] > 1e-3, ned[:, 2:], np.nan)
        reach = (self.height_m - plane_height_m) * ned[:, :2] / down
        return np.stack([self.easting_m + reach[:, 1], self.northing_m + reach[:, 0]], axis=1)

    def footprint_en_m(self, camera: Camera, plane_height_m: float) -> FloatArray:
        """``(16, 2)`` outer border of the image on a level plane, clockwise from the first pixel's corner."""
        w, h = camera.width_px, camera.height_px
        t = np.arange(4)[:, None] / 4.0
        top, right = t * (w, 0.0), t * (0.0, h) + (w, 0.0)
        ring = np.concatenate([top, right, (w, h) - top, (0.0, h) - t * (0.0, h)]) - 0.5
        points = self.ground_points(camera, ring, plane_height_m)
        return points[np.isfinite(points).all(axis=1)]

    def attitude(self, convergence_rad: float = 0.0) -> Attitude:
        """Return the gimbal angles (yaw from **true** north: grid heading plus the grid's convergence).

        Of the two triples that describe one rotation this is the one with pitch within ±90 degrees.
        """
        gimbal_from_camera = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        r = self.R_grid_camera @ gimbal_from_camera.T
        pitch = -math.asin(max(-1.0, min(1.0, float(r[2, 0]))))
        if math.hypot(float(r[0, 0]), float(r[1, 0])) < 1e-6:  # straight down: all the turn is yaw
            return Attitude(_wrapped(math.atan2(-float(r[0, 1]), float(r[1, 1])) + convergence_rad), pitch, 0.0)
        yaw = math.atan2(float(r[1, 0]), float(r[0, 0]))
        return Attitude(_wrapped(yaw + convergence_rad), pitch, math.atan2(float(r[2, 1]), float(r[2, 2])))


def _focal(camera: Camera) -> float:
    if camera.focal_px is None:
        raise ValueError("camera must have a focal length")
    return camera.focal_px


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)
