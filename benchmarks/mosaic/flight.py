"""A flight at the level of placements: frames that see a made ground exactly where they are said to, of any number."""

from __future__ import annotations

import math
from collections import OrderedDict
from threading import Lock

import cv2
import numpy as np

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D

GSD_M = 0.1
MAP_FRAME = MapFrame("a CRS", 500_000.0, 4_000_000.0)
_TEXTURE_PX = 1024  # small: what is measured is not the memory of the ground
_TILT_RAD = 0.03


def texture(seed: int = 0) -> ImageArray:
    """Return a ground with detail at all scales, whose opposite edges fit together."""
    rng = np.random.default_rng(seed)
    out = np.full((_TEXTURE_PX, _TEXTURE_PX, 3), 120.0, dtype=np.float32)
    for cell, amplitude in ((2, 8.0), (8, 14.0), (64, 18.0), (256, 14.0)):
        noise = rng.normal(size=(_TEXTURE_PX // cell, _TEXTURE_PX // cell, 3)).astype(np.float32)
        out += amplitude * cv2.resize(noise, (_TEXTURE_PX, _TEXTURE_PX), interpolation=cv2.INTER_LINEAR)
    return np.clip(out, 10, 245).astype(np.uint8)


def lawnmower(frames: int, *, width_px: int, height_px: int, per_strip: int) -> Trajectory:
    """Return the placements of a lawnmower flight: cameras that lean by some 2 degrees, strips there and back."""
    rng, front, side = np.random.default_rng(0), 0.75, 0.65
    camera = Camera(width_px, height_px, focal_px=0.7 * width_px, k1=-0.03)
    placements = []
    for n in range(frames):
        strip, k = divmod(n, per_strip)
        along = (k if strip % 2 == 0 else per_strip - 1 - k) * (1.0 - front) * height_px * GSD_M
        across = strip * (1.0 - side) * width_px * GSD_M
        lean = cv2.Rodrigues(np.array([*rng.normal(0.0, _TILT_RAD, 2), 0.0]))[0]
        heading = (0.0 if strip % 2 == 0 else math.pi) + rng.normal(0.0, 0.03)
        at = Similarity2D(across + rng.normal(0, 1), along + rng.normal(0, 1), heading, math.log(GSD_M))
        where = PlanePlacement(PlaneView(camera, lean), at)
        placements.append(FramePlacement(n, width_px, height_px, where, np.diag([1.0, 1.0, 1e-5, 1e-6])))
    return Trajectory(tuple(placements), 1)


class Pictures:
    """The frames' pixels, seen through their placements; as ``render_mosaic`` reads them, from several threads.

    ``kept`` of them stay in memory: nothing but the drawing is to be measured.
    """

    def __init__(self, trajectory: Trajectory, *, kept: int) -> None:
        self._placements = {p.frame: p for p in trajectory.placements}
        self._ground, self._kept = texture(), kept
        self._held: OrderedDict[int, ImageArray] = OrderedDict()
        self._lock = Lock()

    def __call__(self, frame: int) -> ImageArray:
        """Return a frame's ``(H, W, 3)`` BGR."""
        with self._lock:
            if frame in self._held:
                return self._held[frame]
        p = self._placements[frame]
        step = 16  # a leaning camera's picture is smooth: asked at every so many pixels
        cols, rows = (-(-side // step) + 1 for side in (p.width_px, p.height_px))
        px = np.stack(np.meshgrid(np.arange(cols) * step, np.arange(rows) * step), axis=-1).reshape(-1, 2)
        xy = (p.camera_to_map.project(px) / GSD_M).reshape(rows, cols, 2).astype(np.float32)
        i, j = np.meshgrid(np.arange(p.width_px) / step, np.arange(p.height_px) / step)
        dense = cv2.remap(xy, i.astype(np.float32), j.astype(np.float32), cv2.INTER_LINEAR) % _TEXTURE_PX
        image = cv2.remap(self._ground, dense[..., 0], dense[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        with self._lock:
            self._held[frame] = image
            while len(self._held) > self._kept:
                self._held.popitem(last=False)
        return image
