"""From light to pixels: motion smear, vignetting, exposure drift, noise, and the look of a thermal camera."""

from __future__ import annotations

import math

import cv2
import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.flight import Shot, Stream
from photomap_gis.simulate.noise import FloatImage, gauss_markov
from photomap_gis.simulate.spec import FlightSpec

NOISE_POOL_PX = 97
"""The pool of noise is this much larger than the frame, so that each frame can be given its own cut."""


class Sensor:
    """Turns rendered light into what the camera stores (a plan: vignette, gains and a pool of noise, made once)."""

    def __init__(self, spec: FlightSpec, shots: tuple[Shot, ...]) -> None:
        self._spec, self._camera = spec, spec.camera
        rng = Stream.IMAGING.rng(spec.seed)
        times = np.array([s.time_s for s in shots])
        im = spec.imaging
        gain = np.exp(gauss_markov(times, sigma=im.exposure_drift, tau_s=20.0, rng=rng))
        tint = np.exp(np.stack([gauss_markov(times, sigma=0.2 * im.exposure_drift, tau_s=40.0, rng=rng)] * 3, axis=1)
                      * (1.0, 0.0, -1.0))  # fmt: skip
        self._gains: FloatArray = gain[:, None] * tint
        self._vignette = _vignette(self._camera, im.vignetting)
        shape = (self._camera.height_px + NOISE_POOL_PX, self._camera.width_px + NOISE_POOL_PX)
        self._channels = 1 if im.thermal else 3
        self._pool: FloatImage = (
            im.noise * rng.standard_normal((*shape, self._channels), dtype=np.float32)
            if im.noise > 0
            else np.zeros((*shape, self._channels), np.float32)
        )
        self._fixed_pattern: FloatImage = rng.standard_normal(shape[1], dtype=np.float32)
        self._cuts = rng.integers(0, NOISE_POOL_PX, (len(shots), 2))

    def expose(self, light: ImageArray, shot: Shot) -> ImageArray:
        """Return the stored image of ``(H, W, 3)`` light: BGR, or ``(H, W)`` grey where the look is thermal."""
        im = self._spec.imaging
        image = self._smeared(light, shot)
        if im.thermal:
            return self._thermal(image, shot)
        gain = self._gains[shot.index].astype(np.float32)
        out = image.astype(np.float32)
        out *= self._vignette[..., None] * gain
        y, x = self._cuts[shot.index]
        h, w = image.shape[:2]
        out += self._pool[y : y + h, x : x + w]
        return np.asarray(cv2.convertScaleAbs(cv2.max(out, 0.0)))

    def _smeared(self, light: ImageArray, shot: Shot) -> ImageArray:
        """Smear along the image's motion during the exposure; shorter than a third of a pixel is left out."""
        exposure_s = self._spec.imaging.exposure_ms / 1000.0
        focal = self._camera.focal_px or 1.0
        r = shot.pose.R_grid_camera
        east, north = shot.speed_en_m_s
        distance = max(shot.pose.height_m, 1.0)
        moved = (r.T @ np.array([north, east, 0.0]))[:2] * exposure_s * focal / distance
        length = float(np.hypot(*moved))
        if length < 0.34:
            return light
        n = math.ceil(length) | 1
        kernel = np.zeros((n + 2, n + 2), np.float32)
        middle = (n + 1) / 2.0
        for f in np.linspace(-0.5, 0.5, 4 * n + 1):  # deposit a straight line, shared among the four nearest cells
            x, y = middle + f * moved
            i, j = int(x), int(y)
            for di, dj in ((0, 0), (1, 0), (0, 1), (1, 1)):
                kernel[j + dj, i + di] += (1 - abs(x - i - di)) * (1 - abs(y - j - dj))
        return np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))

    def _thermal(self, image: ImageArray, shot: Shot) -> ImageArray:
        """Grey, low contrast, soft, with column noise; what is dark in the sun is warm."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
        blur = max(0.8, self._camera.width_px / 640.0)
        warm = cv2.GaussianBlur(255.0 - grey, (0, 0), blur)
        h, w = grey.shape
        y, x = self._cuts[shot.index]
        out = 118.0 + 0.35 * (warm - 128.0) * float(self._gains[shot.index, 1])
        out += self._pool[y : y + h, x : x + w, 0] + 0.7 * self._fixed_pattern[:w]
        return np.clip(out, 0, 255).astype(np.uint8)


def _vignette(camera: Camera, loss: float) -> FloatImage:
    """``(H, W)`` brightness: 1 in the middle, ``1 - loss`` in the corners."""
    cx, cy = camera.principal_xy_px
    x = (np.arange(camera.width_px, dtype=np.float32) - np.float32(cx))[None, :]
    y = (np.arange(camera.height_px, dtype=np.float32) - np.float32(cy))[:, None]
    r2 = (x * x + y * y) / np.float32(cx * cx + cy * cy)
    return np.asarray(1.0 - np.float32(loss) * r2 * (0.6 + 0.4 * r2), dtype=np.float32)
