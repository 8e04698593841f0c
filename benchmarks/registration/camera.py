"""Pinhole views of a ground: flat by homography, or a height field by rays, both antialiased; and their truth.

The ground is a raster, (0, 0) the centre of its first pixel, y down; lengths and heights are its pixels, so that no
unit is needed. A camera at ``height`` over (x, y) looks down, turned by yaw and leaning by a tilt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.surface import Surface

from .pictures import Grey, Scene

Image32 = npt.NDArray[np.float32]

VISIBLE_PX = 1.5
"""A point of the ground is seen by both cameras where their rays meet it within so many pixels of the ground."""


@dataclass(frozen=True, slots=True)
class Lens:
    """A frame's size and its focal length in pixels."""

    width_px: int
    height_px: int
    focal_px: float

    @classmethod
    def of(cls, size: tuple[int, int], hfov_deg: float) -> Lens:
        """Return the lens of a frame of ``size`` (width, height) and a horizontal field of view."""
        return cls(size[0], size[1], size[0] / 2.0 / math.tan(math.radians(hfov_deg) / 2.0))

    @property
    def centre(self) -> FloatArray:
        """``(2,)`` the frame's centre."""
        return np.array([(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0])

    @property
    def K_inverse(self) -> FloatArray:
        """``(3, 3)`` pixel to ray."""
        (cx, cy), f = self.centre, self.focal_px
        return np.array([[1 / f, 0, -cx / f], [0, 1 / f, -cy / f], [0, 0, 1.0]])

    def rim(self, margin_px: float) -> FloatArray:
        """``(16, 2)`` points around the frame, ``margin_px`` outside of it."""
        w, h, m = self.width_px - 0.5 + margin_px, self.height_px - 0.5 + margin_px, -0.5 - margin_px
        t = np.arange(4) / 4.0
        x, y = m + (w - m) * t, m + (h - m) * t
        one = np.ones(4)
        return np.concatenate([np.stack(p, axis=1) for p in ((x, m * one), (w * one, y), (w + m - x, h * one),
                                                             (m * one, h + m - y))])  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A camera over the ground; ``R`` turns camera axes (x right, y down, z forward) into the ground's (z down)."""

    x: float
    y: float
    height: float
    R: FloatArray

    def moved(self, dx: float, dy: float) -> Pose:
        """Return the camera at another place."""
        return Pose(self.x + dx, self.y + dy, self.height, self.R)

    def to_ground(self, lens: Lens) -> FloatArray:
        """``(3, 3)`` homography of frame pixels onto the ground's plane of height 0."""
        place = np.array([[self.height, 0, self.x], [0, self.height, self.y], [0, 0, 1.0]])
        H: FloatArray = place @ self.R @ lens.K_inverse
        return H


def attitude(yaw_rad: float, tilt_rad: float, tilt_direction_rad: float) -> FloatArray:
    """``(3, 3)`` rotation of a camera turned by yaw, its axis leaning from the nadir towards a direction."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    axis = np.array([-math.sin(tilt_direction_rad), math.cos(tilt_direction_rad), 0.0])
    lean, _ = cv2.Rodrigues(axis * tilt_rad)
    R: FloatArray = lean @ turn
    return R


def transfer(H: FloatArray, points: FloatArray) -> FloatArray:
    """Map ``(N, 2)`` points by a homography."""
    q = np.c_[points, np.ones(len(points))] @ H.T
    mapped: FloatArray = q[:, :2] / q[:, 2:]
    return mapped


def _samples(px_per_px: float) -> int:
    """Return by how much to supersample a frame whose pixel covers so many of the ground's."""
    return 2 if px_per_px <= 2.7 else 3 if px_per_px <= 4.0 else 4


def render_flat(grey: Grey, pose: Pose, lens: Lens, margin_px: int) -> Image32:
    """Grey values of a flat ground, ``margin_px`` more than the frame on each side."""
    n = _samples(pose.height / lens.focal_px)
    w, h = lens.width_px + 2 * margin_px, lens.height_px + 2 * margin_px
    # Sample (u, v) lies at pixel ((u + 1/2) / n - 1/2 - margin): pixels are areas, so their sample means are theirs.
    offset = 0.5 / n - 0.5 - margin_px
    to_pixel = np.array([[1.0 / n, 0, offset], [0, 1.0 / n, offset], [0, 0, 1.0]])
    H = pose.to_ground(lens) @ to_pixel
    # Only the part in view, in float coordinates of its own: OpenCV's maps are single precision.
    samples = cv2.warpPerspective(
        grey, H, (w * n, h * n), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT_101
    )
    frame: Image32 = cv2.resize(samples.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    return frame


class Relief:
    """A height field under cameras (a plan: the surface's extremes, no other memory)."""

    def __init__(self, scene: Scene, box: tuple[int, int, int, int], growth: float) -> None:
        """Cut ``box`` (x0, y0, x1, y1) out of a scene and let heights over its typical ground grow by a factor."""
        x0, y0, x1, y1 = box
        self.origin = np.array([x0, y0], np.float64)
        self._grey = scene.grey[y0:y1, x0:x1]
        height = scene.height_px[y0:y1, x0:x1]
        self._surface = Surface((height - np.float32(np.median(height))) * np.float32(growth))

    def meet(self, pose: Pose, slopes: tuple[Image32, Image32]) -> tuple[Image32, Image32, Image32]:
        """``(H, W)`` x, y and height of where rays meet the surface, in pixels of the cut-out."""
        rows = slopes[0].shape[0]
        eye = [np.full((rows, 1), v, np.float32) for v in (pose.x - self.origin[0], pose.y - self.origin[1])]
        eye_z = np.full((rows, 1), pose.height, np.float32)
        z = self._surface.intersect((eye[0], eye[1]), eye_z, slopes)
        depth = eye_z - z
        return eye[0] + depth * slopes[0], eye[1] + depth * slopes[1], z

    def render(self, pose: Pose, lens: Lens, margin_px: int) -> Image32:
        """Grey values of the scene, ``margin_px`` more than the frame on each side."""
        n = _samples(pose.height / lens.focal_px)
        w, h = lens.width_px + 2 * margin_px, lens.height_px + 2 * margin_px
        u = (np.arange(w * n) + 0.5) / n - 0.5 - margin_px
        v = (np.arange(h * n) + 0.5) / n - 0.5 - margin_px
        x, y, _ = self.meet(pose, _slopes(pose, lens, u[None, :], v[:, None]))
        samples = cv2.remap(self._grey, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        frame: Image32 = cv2.resize(samples.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
        return frame

    def correspond(
        self, pose_a: Pose, pose_b: Pose, lens: Lens, pixels_b: FloatArray
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """``(H, W, 2)`` where a shows what b shows at ``(H, W, 2)`` pixels; ``(H, W)`` whether a sees it at all."""
        x, y, z = (
            v.astype(np.float64) for v in self.meet(pose_b, _slopes(pose_b, lens, *np.moveaxis(pixels_b, -1, 0)))
        )
        eye = np.array([pose_a.x - self.origin[0], pose_a.y - self.origin[1], -pose_a.height])
        ray = (np.stack([x, y, -z], axis=-1) - eye) @ pose_a.R  # in a's camera axes
        pixels_a = ray[..., :2] / ray[..., 2:] * lens.focal_px + lens.centre
        xa, ya, za = self.meet(pose_a, _slopes(pose_a, lens, *np.moveaxis(pixels_a, -1, 0)))
        off = np.sqrt((xa - x) ** 2 + (ya - y) ** 2 + (za - z) ** 2)
        return pixels_a, off < VISIBLE_PX


def _slopes(pose: Pose, lens: Lens, x: FloatArray, y: FloatArray) -> tuple[Image32, Image32]:
    """``(H, W)`` sideways travel a unit of depth, x and y, of the rays of pixels (x and y broadcast to ``(H, W)``)."""
    m = pose.R @ lens.K_inverse
    across, down, depth = (m[i, 0] * x + m[i, 1] * y + m[i, 2] for i in range(3))
    return np.asarray(across / depth, np.float32), np.asarray(down / depth, np.float32)
