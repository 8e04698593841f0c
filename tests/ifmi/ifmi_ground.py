"""Pictures with known truth: a procedural ground and the straight-down views of it."""

import math

import cv2
import numpy as np

from photomap_gis.core.similarity import Similarity2D


def ground(rng: np.random.Generator, side: int = 900) -> np.ndarray:
    """A procedural ground without repeats: noise of many sizes, with patches of hard edges."""
    g = sum(s**0.6 * cv2.GaussianBlur(rng.standard_normal((side, side)), (0, 0), s) for s in (1.0, 2.0, 4.0, 9.0, 20.0))
    for _ in range(side * side // 6000):
        x, y = rng.integers(0, side, 2)
        w, h = rng.integers(8, 60, 2)
        g[y : y + h, x : x + w] += rng.normal() * 0.5
    g = (g - g.mean()) / g.std()
    return np.clip(128 + 45 * g, 0, 255).astype(np.uint8)


def view(g: np.ndarray, T_ground_image: Similarity2D, shape: tuple[int, int]) -> np.ndarray:
    """The picture that a straight-down camera takes of the ground."""
    m = T_ground_image.matrix[:2]
    return cv2.warpAffine(g, m, shape[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)


def pose(x: float, y: float, angle_deg: float, scale: float, shape: tuple[int, int]) -> Similarity2D:
    """``T_ground_image`` with the image's centre at (x, y) of the ground."""
    c = Similarity2D.translation_of(-(shape[1] - 1) / 2, -(shape[0] - 1) / 2)
    return Similarity2D(x, y, math.radians(angle_deg), math.log(scale)) @ c


def noisy(rng: np.random.Generator, image: np.ndarray, sigma: float) -> np.ndarray:
    """The picture with the sensor's noise."""
    return np.clip(np.rint(image + sigma * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def rms_px(T: Similarity2D, U: Similarity2D, shape: tuple[int, int]) -> float:
    """Root mean square distance of two motions over an image's corners."""
    h, w = shape
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]], float)
    return float(np.sqrt(np.mean(np.sum((T.apply(corners) - U.apply(corners)) ** 2, axis=1))))
