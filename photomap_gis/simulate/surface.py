"""Where rays from a camera first meet a height field: fixed points on gentle land, marching at walls and crowns."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.simulate.noise import FloatImage

BLOCK_PX = 16
TILE_PX = 64
MARCH_PX = 1.4
"""Longest horizontal step of a marching ray, in pixels of the height raster: nothing thinner can be jumped."""


class Surface:
    """A height raster ready for rays (a plan: block-wise extremes, no other memory).

    Coordinates are pixels of the raster, (0, 0) the centre of the first; heights and depths are metres.
    """

    def __init__(self, height_m: FloatImage) -> None:
        self._height = np.ascontiguousarray(height_m, dtype=np.float32)
        h, w = self._height.shape
        rows, cols = -(-h // BLOCK_PX), -(-w // BLOCK_PX)
        padded = cv2.copyMakeBorder(
            self._height, 0, rows * BLOCK_PX - h, 0, cols * BLOCK_PX - w, cv2.BORDER_REPLICATE
        ).reshape(rows, BLOCK_PX, cols, BLOCK_PX)
        self._top: FloatImage = padded.max(axis=(1, 3))
        self._bottom: FloatImage = padded.min(axis=(1, 3))

    def intersect(
        self, eye_xy: tuple[FloatImage, FloatImage], eye_height_m: FloatImage, slope_xy: tuple[FloatImage, FloatImage]
    ) -> FloatImage:
        """``(H, W)`` height in metres at which each ray first meets the surface, coming from above.

        ``eye_xy`` and ``eye_height_m`` are ``(H, 1)`` (each image row may have its own eye), ``slope_xy`` are
        ``(H, W)`` raster pixels gone sideways a metre of depth.
        """
        u, v = slope_xy
        out = np.empty(u.shape, np.float32)
        for y in range(0, u.shape[0], TILE_PX):
            rows = slice(y, y + TILE_PX)
            for x in range(0, u.shape[1], TILE_PX):
                part = (rows, slice(x, x + TILE_PX))
                out[part] = self._tile((eye_xy[0][rows], eye_xy[1][rows]), eye_height_m[rows], (u[part], v[part]))
        return out

    def _tile(
        self, eye_xy: tuple[FloatImage, FloatImage], eye_z: FloatImage, slope: tuple[FloatImage, FloatImage]
    ) -> FloatImage:
        """Intersect the rays of one tile."""
        ex, ey = eye_xy
        u, v = slope
        box = [(float(e.min()), float(e.max()), float(s.min()), float(s.max())) for e, s in ((ex, u), (ey, v))]
        z_low, z_high = float(eye_z.min()), float(eye_z.max())
        low, high = float(self._bottom.min()), float(self._top.max())
        for _ in range(3):  # the ground that the tile can see shrinks with the heights that it can meet
            inner, outer = z_low - high, z_high - low
            spans = [(e0 + min(inner * s0, outer * s0), e1 + max(inner * s1, outer * s1)) for e0, e1, s0, s1 in box]
            new_low, new_high = self._extremes(spans[0], spans[1])
            if new_high - new_low > 0.9 * (high - low):
                low, high = new_low, new_high
                break
            low, high = new_low, new_high
        steepest = max(max(abs(s0), abs(s1)) for _, _, s0, s1 in box)
        relief_px = (high - low) * steepest * 1.42
        if relief_px < 0.7:
            return self._settle((ex, ey), eye_z, (u, v), (low + high) / 2.0, rounds=2)
        return self._march((ex, ey), eye_z, (u, v), (low, high), steps=min(400, int(relief_px / MARCH_PX) + 1))

    def _extremes(self, x_span: tuple[float, float], y_span: tuple[float, float]) -> tuple[float, float]:
        """Lowest and highest point within a box of raster pixels."""
        rows, cols = self._top.shape
        c0, c1 = (min(max(int((x + d) // BLOCK_PX), 0), cols - 1) for x, d in zip(x_span, (-1, 1), strict=True))
        r0, r1 = (min(max(int((y + d) // BLOCK_PX), 0), rows - 1) for y, d in zip(y_span, (-1, 1), strict=True))
        part = (slice(r0, r1 + 1), slice(c0, c1 + 1))
        return float(self._bottom[part].min()), float(self._top[part].max())

    def _heights(
        self,
        eye_xy: tuple[FloatImage, FloatImage],
        depth: npt.NDArray[np.float32],
        slope: tuple[FloatImage, FloatImage],
    ) -> FloatImage:
        """``(H, W)`` the surface's height where the rays are at a depth below the eye."""
        x, y = (e + depth * s for e, s in zip(eye_xy, slope, strict=True))
        heights: FloatImage = cv2.remap(self._height, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return heights

    def _settle(
        self,
        eye_xy: tuple[FloatImage, FloatImage],
        eye_z: FloatImage,
        slope: tuple[FloatImage, FloatImage],
        start_m: float,
        *,
        rounds: int,
    ) -> FloatImage:
        """Iterate height -> place -> height: converges where less than a pixel of parallax lies in the relief."""
        z: FloatImage = np.full(slope[0].shape, start_m, np.float32)
        for _ in range(rounds):
            z = self._heights(eye_xy, eye_z - z, slope)
        return z

    def _march(
        self,
        eye_xy: tuple[FloatImage, FloatImage],
        eye_z: FloatImage,
        slope: tuple[FloatImage, FloatImage],
        low_high_m: tuple[float, float],
        *,
        steps: int,
    ) -> FloatImage:
        """Find, in equal steps of height, the highest that lies under the surface, then halve the step."""
        low, high = low_high_m
        step = np.float32((high - low) / steps)
        found: FloatImage = np.full(slope[0].shape, np.float32(low), np.float32)
        # from below: the last step that lies under the surface is then the first that a ray from above meets
        x, y = (e + (eye_z - np.float32(low)) * s for e, s in zip(eye_xy, slope, strict=True))
        dx, dy = (step * s for s in slope)
        for k in range(1, steps):
            z = np.float32(low + k * float(step))
            cv2.subtract(x, dx, dst=x)
            cv2.subtract(y, dy, dst=y)
            heights = cv2.remap(self._height, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            np.copyto(found, z, where=heights >= z)
        size = step
        for _ in range(3):  # found lies under the surface, found + size above it
            size = np.float32(size / 2)
            middle = found + size
            under = self._heights(eye_xy, eye_z - middle, slope) >= middle
            np.copyto(found, middle, where=under)
        return found
