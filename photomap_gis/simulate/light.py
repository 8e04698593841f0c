"""The sun over a scene: slopes brighter or darker, walls plain, shadows cast."""

from __future__ import annotations

import math

import cv2
import numpy as np

from photomap_gis.simulate.canvas import Canvas
from photomap_gis.simulate.noise import FloatImage

WALL_SLOPE = 2.5
"""Rise over run from which a pixel of the height raster is a wall and no longer a roof or a crown."""


def shine(canvas: Canvas, *, azimuth_rad: float, elevation_rad: float, shadow: float = 0.45) -> None:
    """Shade the canvas in place for a sun at a heading (clockwise from north) and elevation."""
    east, north = math.sin(azimuth_rad), math.cos(azimuth_rad)
    g = canvas.gsd_m
    dx = cv2.Sobel(canvas.height_m, cv2.CV_32F, 1, 0, ksize=3, scale=0.125 / g)
    dy = cv2.Sobel(canvas.height_m, cv2.CV_32F, 0, 1, ksize=3, scale=0.125 / g)
    steep = cv2.magnitude(dx, dy)
    ce, se = math.cos(elevation_rad), math.sin(elevation_rad)
    # the normal is (-dx, -dy, 1): y points south, so the sun's direction is (east, -north)
    cosine = (-dx * np.float32(ce * east) + dy * np.float32(ce * north) + np.float32(se)) / np.sqrt(1.0 + steep**2)
    light = np.clip(0.42 + 0.58 * cosine / np.float32(se), 0.4, 1.4)
    wall = (steep > WALL_SLOPE) & ~canvas.leafy
    lit = np.clip(0.42 + 0.58 * cosine / np.float32(ce), 0.4, 1.1)
    canvas.colour[wall] = (canvas.colour[wall] * 0.35 + np.array([150, 164, 172]) * 0.65).astype(np.uint8)
    light = np.where(wall, lit, light) * (1.0 - shadow * _shadow(canvas.height_m, g, (east, -north), se / ce))
    for channel in range(3):
        canvas.colour[..., channel] = np.clip(canvas.colour[..., channel] * light, 0, 255).astype(np.uint8)


def _shadow(height_m: FloatImage, gsd_m: float, sun_xy: tuple[float, float], rise: float) -> FloatImage:
    """``(H, W)`` share of shadow, 0 to 1: what looks towards the sun and meets something higher than the ray."""
    factor = max(1.0, 0.4 / gsd_m)  # soft edges want no more than 0.4 m
    h, w = height_m.shape
    small = cv2.resize(height_m, (max(2, round(w / factor)), max(2, round(h / factor))), interpolation=cv2.INTER_AREA)
    step_m = gsd_m * factor
    relief = float(small.max() - small.min())
    dark = np.zeros(small.shape, np.float32)
    reach = min(int(relief / rise / step_m) + 1, 120)
    for k in range(1, reach + 1):
        # the value at p is the height k steps towards the sun
        towards = np.array([[1.0, 0.0, sun_xy[0] * k], [0.0, 1.0, sun_xy[1] * k]])
        ahead = cv2.warpAffine(
            small, towards, small.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        np.maximum(dark, np.clip((ahead - small - k * step_m * rise) / 0.3, 0, 1), out=dark)
    return np.asarray(cv2.resize(cv2.GaussianBlur(dark, (0, 0), 0.8), (w, h), interpolation=cv2.INTER_LINEAR))
