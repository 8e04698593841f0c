"""A flight over a picture with known truth: frames are the picture seen through their placements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import Attitude, FrameStatus, level_rotation
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D

GSD_M = 0.25
MAP_FRAME = MapFrame("a CRS", 500_000.0, 4_000_000.0)


def procedural_ground(rng: np.random.Generator, width: int = 900, height: int = 700) -> np.ndarray:
    """An asymmetric coloured scene with detail at all scales, bounded away from black and white."""
    out = np.zeros((height, width, 3), dtype=np.float32)
    for cell, amplitude in ((2, 10.0), (6, 16.0), (20, 22.0), (70, 24.0)):
        noise = rng.normal(size=(height // cell + 3, width // cell + 3, 3)).astype(np.float32)
        out += amplitude * cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    image = np.clip(128.0 + out, 30, 225).astype(np.uint8)
    for _ in range(40):
        x, y = rng.integers(0, width), rng.integers(0, height)
        w, h = rng.integers(6, 40, 2)
        box = cv2.boxPoints(((float(x), float(y)), (float(w), float(h)), float(rng.uniform(0, 90))))
        cv2.fillConvexPoly(image, box.astype(np.int32), [int(v) for v in rng.integers(40, 215, 3)], cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), 0.7)


@dataclass
class Flight:
    """Frames over ``ground``, whose pixel (x, y) lies at map point (x, y) * GSD_M."""

    ground: np.ndarray
    placements: list[FramePlacement]
    images: dict[int, np.ndarray]

    @property
    def trajectory(self) -> Trajectory:
        return Trajectory(tuple(self.placements), 1)

    def read(self, frame: int) -> np.ndarray:
        return self.images[frame]

    def truth(self, grid: MapGrid) -> np.ndarray:
        """``(height, width, 3)`` RGB float: the ground on the grid."""
        x0, y0 = MAP_FRAME.from_crs(grid.to_crs(np.array([[0.0, 0.0]])))[0] / GSD_M
        step = grid.pixel_size / GSD_M
        x, y = np.meshgrid(x0 + step * np.arange(grid.width), y0 + step * np.arange(grid.height))
        bgr = cv2.remap(self.ground.astype(np.float32), x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC)
        return bgr[..., ::-1]

    def seen(self, grid: MapGrid) -> np.ndarray:
        """``(height, width)`` bool: whether a pixel's centre lies in some frame, asked of the exact placements."""
        px = np.stack(np.meshgrid(np.arange(grid.width), np.arange(grid.height)), axis=-1).reshape(-1, 2)
        xy = MAP_FRAME.from_crs(grid.to_crs(px))
        out = np.zeros(len(xy), dtype=bool)
        for p in self.placements:
            if p.status in (FrameStatus.REGISTERED, FrameStatus.GPS_ONLY):
                outline, margin = p.outline_xy_map_m(), 5 * GSD_M
                near = ((xy > outline.min(axis=0) - margin) & (xy < outline.max(axis=0) + margin)).all(axis=1)
                uv = p.camera_to_map.unproject(xy[near])
                with np.errstate(invalid="ignore"):
                    out[near] |= (np.abs(uv - p.centre_xy_px) <= np.array([p.width_px, p.height_px]) / 2).all(axis=1)
        return out.reshape(grid.height, grid.width)


def place(
    frame: int,
    x_m: float,
    y_m: float,
    *,
    heading_rad: float = 0.0,
    scale: float = 1.0,
    size: tuple[int, int] = (240, 180),
    camera: Camera | None = None,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    status: FrameStatus = FrameStatus.REGISTERED,
) -> FramePlacement:
    """A frame whose plumb point lies at (x_m, y_m); tilted by (pitch from nadir, roll) where a camera is given."""
    view, angle = PlaneView.flat(Camera(*size)), heading_rad
    if camera is not None:
        attitude = Attitude(heading_rad, -math.pi / 2 + tilt_rad[0], tilt_rad[1])
        view, angle = PlaneView(camera, level_rotation(attitude.R_ned_camera)), attitude.heading_rad
    T_map_plane = Similarity2D(x_m, y_m, angle, math.log(scale * GSD_M))
    return FramePlacement(frame, *size, PlanePlacement(view, T_map_plane), np.eye(4) * 1e-4, status)


def picture(ground: np.ndarray, placement: FramePlacement) -> np.ndarray:
    """What the placed frame sees of the ground, float BGR."""
    w, h = placement.width_px, placement.height_px
    px = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1).reshape(-1, 2)
    xy = placement.camera_to_map.project(px).reshape(h, w, 2) / GSD_M
    ratio = placement.gsd_m_per_px / GSD_M
    if ratio > 1.3:
        ground = cv2.GaussianBlur(ground, (0, 0), 0.5 * math.sqrt(ratio * ratio - 1.0))
    return cv2.remap(ground.astype(np.float32), *np.moveaxis(xy.astype(np.float32), -1, 0), cv2.INTER_CUBIC)


def lawnmower(
    ground: np.ndarray,
    rng: np.random.Generator,
    *,
    camera: Camera | None = None,
    tilt_sigma_rad: float = 0.0,
    gain_sigma: float = 0.0,
    vignette: float = 0.0,
    size: tuple[int, int] = (240, 180),
) -> Flight:
    """Three strips over the middle of the ground, with jitter in place, heading and height."""
    height, width = ground.shape[:2]
    placements, images = [], {}
    for strip, y in enumerate(np.linspace(200, height - 200, 3)):
        for k, x in enumerate(np.linspace(230, width - 230, 6)[:: 1 if strip % 2 == 0 else -1]):
            frame = 6 * strip + k
            p = place(
                frame,
                *(GSD_M * (np.array([x, y]) + rng.normal(0, 5, 2))),
                heading_rad=(0.0 if strip % 2 == 0 else math.pi) + rng.normal(0, 0.05),
                scale=rng.uniform(0.95, 1.05),
                size=size,
                camera=camera,
                tilt_rad=tuple(rng.normal(0, tilt_sigma_rad, 2)),
            )
            image = picture(ground, p) * np.exp(rng.normal(0, gain_sigma, 1) + rng.normal(0, gain_sigma / 5, 3))
            if vignette:
                grid_y, grid_x = np.mgrid[: size[1], : size[0]]
                r2 = ((grid_x - size[0] / 2) ** 2 + (grid_y - size[1] / 2) ** 2) / (size[0] ** 2 + size[1] ** 2) * 4
                image *= (1.0 - vignette * r2)[..., None]
            placements.append(p)
            images[frame] = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return Flight(ground, placements, images)
