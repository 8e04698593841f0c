"""Render what a camera sees of a ground: perspective, lens distortion, occlusion by heights, rolling shutter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.noise import FloatImage
from photomap_gis.simulate.pose import CameraPose
from photomap_gis.simulate.surface import Surface

SKY_BGR = (226, 214, 200)
HORIZON_DOWN = 0.03
"""Rays that fall less than this a unit of length see sky."""


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """The ground at one resolution."""

    colour: ImageArray
    surface: Surface | None
    pixel_size_m: float


class FrameRenderer:
    """Renders frames of one camera over one ground (a plan: rays and the ground's coarser levels, filled as needed)."""

    def __init__(self, ground: Ground, camera: Camera) -> None:
        if camera.focal_px is None:
            raise ValueError("camera must have a focal length")
        self._ground, self._camera = ground, camera
        self._levels: dict[int, _Level] = {}
        x = np.arange(camera.width_px, dtype=np.float64) - camera.principal_xy_px[0]
        y = np.arange(camera.height_px, dtype=np.float64) - camera.principal_xy_px[1]
        grid = np.stack(np.meshgrid(x / camera.focal_px, y / camera.focal_px), axis=-1)
        rays = camera.undistort(grid.reshape(-1, 2)).reshape(grid.shape) if camera.is_distorted else grid
        self._ray_x: FloatImage = np.ascontiguousarray(rays[..., 0], dtype=np.float32)
        self._ray_y: FloatImage = np.ascontiguousarray(rays[..., 1], dtype=np.float32)
        self._typical_z = 0.0 if ground.height_m is None else float(np.median(ground.height_m))

    def render(self, pose: CameraPose, pose_at_end: CameraPose | None = None) -> ImageArray:
        """``(H, W, 3)`` BGR uint8 frame; with ``pose_at_end`` the rows are exposed one by one between the two."""
        rows = np.linspace(0.0, 1.0, self._camera.height_px)[:, None]
        rotation, eye = _row_poses(pose, pose_at_end, rows)
        # ray = R @ (x, y, 1) in north, east, down; slopes are metres gone a metre of depth
        north, east, down = (
            rotation[i][0] * self._ray_x + rotation[i][1] * self._ray_y + rotation[i][2] for i in range(3)
        )
        sky = down < HORIZON_DOWN
        any_sky = bool(sky.any())
        if any_sky:
            down = np.where(sky, np.float32(1.0), down)
            north, east = np.where(sky, np.float32(0), north), np.where(sky, np.float32(0), east)
        level = self._level(max(pose.height_m - self._typical_z, 0.1))
        size = np.float32(level.pixel_size_m)
        inverse = np.float32(1.0) / (down * size)
        slope_x, slope_y = east * inverse, -north * inverse
        eye_x = ((eye[0] - self._ground.west) / level.pixel_size_m - 0.5).astype(np.float32)
        eye_y = ((self._ground.north - eye[1]) / level.pixel_size_m - 0.5).astype(np.float32)
        eye_z = eye[2].astype(np.float32)
        if level.surface is None:
            depth: FloatImage = eye_z
        else:
            depth = eye_z - level.surface.intersect((eye_x, eye_y), eye_z, (slope_x, slope_y))
        zoomed_in = pose.height_m - self._typical_z < 0.9 * level.pixel_size_m * float(self._camera.focal_px or 1.0)
        image: ImageArray = cv2.remap(
            level.colour,
            eye_x + depth * slope_x,
            eye_y + depth * slope_y,
            cv2.INTER_CUBIC if zoomed_in else cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        if any_sky:
            image[sky] = SKY_BGR
        return image

    def _level(self, distance_m: float) -> _Level:
        """Return the ground at about the frame's own resolution, so that nothing aliases."""
        gsd = distance_m / float(self._camera.focal_px or 1.0)
        # half-octave steps; up to 1.4 pixels of ground a pixel of frame alias little and keep the frame crisp
        step = max(0, round(2.0 * math.log2(max(gsd / self._ground.pixel_size_m / 1.2, 1e-6))))
        if step not in self._levels:
            self._levels[step] = self._made_level(2.0 ** (step / 2.0))
        return self._levels[step]

    def _made_level(self, factor: float) -> _Level:
        ground = self._ground
        h, w = ground.colour.shape[:2]
        colour, height = ground.colour, ground.height_m
        if factor > 1.0:
            size = (max(2, round(w / factor)), max(2, round(h / factor)))
            # a warp, not a resize: the level's pixel size must be exact to the last pixel of the ground
            blur = 0.5 * math.sqrt(factor * factor - 1.0)
            to_ground = np.array([[factor, 0.0, (factor - 1) / 2.0], [0.0, factor, (factor - 1) / 2.0]])
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP

            def shrunk(raster: npt.NDArray[Any]) -> npt.NDArray[Any]:
                soft = cv2.GaussianBlur(raster, (0, 0), blur)
                return np.asarray(cv2.warpAffine(soft, to_ground, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))

            colour, height = shrunk(colour), None if height is None else shrunk(height)
        return _Level(colour, None if height is None else Surface(height), ground.pixel_size_m * factor)


def _row_poses(
    start: CameraPose, end: CameraPose | None, rows: FloatArray
) -> tuple[list[list[np.float32 | FloatImage]], list[FloatArray]]:
    """Return the rotation's entries and the eye (easting, northing, height) for each image row, ``(H, 1)`` each."""
    eyes = [np.array([p.easting_m, p.northing_m, p.height_m]) for p in (start, end or start)]
    eye = [eyes[0][i] + rows * (eyes[1][i] - eyes[0][i]) for i in range(3)]
    r = start.R_grid_camera
    if end is None:
        return [[np.float32(r[i, j]) for j in range(3)] for i in range(3)], eye
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(r.T @ end.R_grid_camera))
    w = turn[:, 0]
    k = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    first, second = r @ k, r @ k @ k
    # the turn within one frame is a fraction of a degree: its exponential to the second order is exact to 1e-7
    return [
        [(r[i, j] + rows * first[i, j] + rows**2 / 2.0 * second[i, j]).astype(np.float32) for j in range(3)]
        for i in range(3)
    ], eye
