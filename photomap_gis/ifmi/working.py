"""The working image: a frame levelled, undistorted and shrunk, as registration compares it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray, Similarity2D

SPARSE_STEP_PX = 8
FEWEST_SIDE_PX = 16


@dataclass(frozen=True, slots=True, eq=False)
class WorkingImage:
    """A grey ``(h, w)`` uint8 picture of the frame's plane, and its way into it.

    ``mask`` is ``(h, w)`` bool, True where the frame was seen, ``None`` where it was everywhere. ``T_plane_work`` maps
    working pixels to the frame's plane: its scale is in plane units a working pixel.
    """

    grey: ImageArray
    mask: npt.NDArray[np.bool_] | None
    T_plane_work: Similarity2D


def make_working(image: ImageArray, view: PlaneView, *, size_px: int = 512) -> WorkingImage:
    """Return the working image of a BGR or grey uint8 frame, its longer side at most ``size_px``.

    Small frames are not enlarged. A rigid view is shrunk only. Otherwise the picture is the plane's window around the
    projection of the raster's centre, at the resolution that the shrunk raster has there: however oblique the view,
    the window does not grow, and what the raster does not show is masked.
    """
    if size_px < FEWEST_SIDE_PX:
        raise ValueError(f"size_px must be at least {FEWEST_SIDE_PX}, got {size_px}")
    grey = to_grey(image)
    if view.is_rigid:
        small, T_image_small = shrink(grey, size_px)
        cx, cy = view.camera.principal_xy_px
        sx, sy = _raster_scale(grey, view)
        if sx == 1.0 and sy == 1.0:
            return WorkingImage(small, None, Similarity2D.translation_of(-cx, -cy) @ T_image_small)
        # The camera speaks of another raster size than the image has (a preview, a decoder's crop): scale into it.
        T_camera_image = Similarity2D(sx / 2.0 - 0.5, sx / 2.0 - 0.5, 0.0, math.log(sx))
        return WorkingImage(small, None, Similarity2D.translation_of(-cx, -cy) @ T_camera_image @ T_image_small)
    return _window(grey, view, size_px)


def shrink(grey: ImageArray, size_px: int) -> tuple[ImageArray, Similarity2D]:
    """Return a picture whose longer side is at most ``size_px``, and ``T_picture_small``.

    Both axes shrink by one factor, or a similarity between pictures would be none between their small copies. Of the
    last few sizes of the shorter side that one is taken whose source rows come out whole; the rest is cut off.
    """
    h, w = grey.shape
    factor = max(h, w) / size_px
    if factor <= 1.0:
        return np.ascontiguousarray(grey), Similarity2D.identity()
    whole = int(min(h, w) / factor)
    sides = [s for s in range(whole, max(whole - 8, FEWEST_SIDE_PX - 1), -1)] or [max(1, whole)]
    short = min(sides, key=lambda s: round(abs(s * factor - round(s * factor)) / 0.02))
    used = min(min(h, w), max(1, round(short * factor)))
    wide = w >= h
    part = grey[:used] if wide else grey[:, :used]
    out = (size_px, short) if wide else (short, size_px)
    small = cv2.resize(part, out, interpolation=cv2.INTER_AREA)
    offset = (factor - 1.0) / 2.0  # pixel centres: small pixel 0 covers the first ``factor`` pixels
    return small, Similarity2D(offset, offset, 0.0, math.log(factor))


def to_grey(image: ImageArray) -> ImageArray:
    """Return a BGR, BGRA or grey uint8 picture as grey ``(h, w)``."""
    if image.dtype != np.uint8:
        raise ValueError(f"image must be uint8, got {image.dtype}")
    if image.ndim == 2:
        return image
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        raise ValueError(f"image must be (h, w), (h, w, 3) or (h, w, 4), got {image.shape}")
    if image.shape[2] == 1:
        return image[:, :, 0]
    grey: ImageArray = cv2.cvtColor(image, cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY)
    return grey


def _window(grey: ImageArray, view: PlaneView, size_px: int) -> WorkingImage:
    h, w = grey.shape
    camera_w, camera_h = view.camera.width_px, view.camera.height_px
    sx, sy = _raster_scale(grey, view)
    factor = max(1.0, max(h, w) / size_px)
    out_w, out_h = max(1, round(w / factor)), max(1, round(h / factor))
    middle = np.array([(camera_w - 1) / 2.0, (camera_h - 1) / 2.0])
    cross = middle + np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    p = view.to_plane(cross)
    right, down = p[1] - p[2], p[3] - p[4]
    area = abs(float(right[0] * down[1] - right[1] * down[0]))
    if not (np.isfinite(p).all() and 1e-6 < area < 1e6):
        # The middle of the picture looks at the horizon or above: nothing of the plane can be shown.
        nothing = np.zeros((out_h, out_w), np.uint8)
        T = Similarity2D(-out_w / 2.0, -out_h / 2.0, 0.0, math.log(factor))
        return WorkingImage(nothing, nothing > 0, T)
    scale = factor * sx * math.sqrt(area)
    T_plane_work = Similarity2D(
        float(p[0, 0]) - scale * (out_w - 1) / 2.0, float(p[0, 1]) - scale * (out_h - 1) / 2.0, 0.0, math.log(scale)
    )
    # Coarse averaging first, or the single remap would read every n-th pixel and alias.
    k = max(1, int(factor))
    part = grey[: h // k * k, : w // k * k]
    small = part if k == 1 else cv2.resize(part, (w // k, h // k), interpolation=cv2.INTER_AREA)

    def to_small(xy_work: FloatArray) -> FloatArray:
        pixel = (view.to_pixel(T_plane_work.apply(xy_work)) + 0.5) / (sx, sy) - 0.5
        return (pixel + 0.5) / k - 0.5

    x, y = _dense(to_small, out_w, out_h)
    inside = (x >= 0) & (x <= small.shape[1] - 1) & (y >= 0) & (y <= small.shape[0] - 1)
    picture = cv2.remap(small, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return WorkingImage(picture, None if inside.all() else inside, T_plane_work)


def _dense(
    to_small: Callable[[FloatArray], FloatArray], out_w: int, out_h: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Evaluate a smooth map on a sparse grid and interpolate it to every pixel."""
    gx = np.arange(0, out_w + SPARSE_STEP_PX, SPARSE_STEP_PX, dtype=np.float64)
    gy = np.arange(0, out_h + SPARSE_STEP_PX, SPARSE_STEP_PX, dtype=np.float64)
    grid = np.stack(np.meshgrid(gx, gy), axis=-1)
    values = to_small(grid.reshape(-1, 2)).reshape(len(gy), len(gx), 2)
    values = np.where(np.isfinite(values), values, -1e6).astype(np.float32)
    wx, wy = _interpolation(out_w, len(gx)), _interpolation(out_h, len(gy))
    x, y = (np.asarray(wy @ values[..., k] @ wx.T, np.float32) for k in (0, 1))
    return x, y


def _interpolation(n: int, nodes: int) -> npt.NDArray[np.float32]:
    """``(n, nodes)`` matrix of linear interpolation between nodes ``SPARSE_STEP_PX`` apart."""
    at = np.arange(n) / SPARSE_STEP_PX
    left = np.minimum(at.astype(int), nodes - 2)
    m = np.zeros((n, nodes), np.float32)
    m[np.arange(n), left] = 1.0 - (at - left)
    m[np.arange(n), left + 1] = at - left
    return m


def _raster_scale(grey: ImageArray, view: PlaneView) -> tuple[float, float]:
    """Return camera pixels per image pixel, x and y; 1, 1 where the image is the camera's raster."""
    h, w = grey.shape
    if view.camera.width_px <= 0 or view.camera.height_px <= 0:
        return 1.0, 1.0
    return view.camera.width_px / w, view.camera.height_px / h
