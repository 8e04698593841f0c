"""The scene while it is being built: colours, heights, and what already stands where. One owner: ``scene``."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.noise import FloatImage

OCCUPANCY_M = 1.0


@dataclass(slots=True, eq=False)
class Canvas:
    """Rasters under construction: ``colour`` (H, W, 3) BGR uint8, ``height_m`` (H, W), coarse ``taken`` (one
    metre); ``leafy`` (H, W) marks what grows.

    Scene coordinates are metres, x east and y south from the upper-left corner.
    """

    colour: ImageArray
    height_m: FloatImage
    taken: npt.NDArray[np.uint8]
    leafy: npt.NDArray[np.bool_]
    gsd_m: float
    rng: np.random.Generator

    @classmethod
    def blank(cls, size_m: tuple[float, float], gsd_m: float, rng: np.random.Generator) -> Canvas:
        """Return an empty canvas of a width and height in metres."""
        w, h = (max(8, round(v / gsd_m)) for v in size_m)
        coarse = tuple(int(np.ceil(v / OCCUPANCY_M)) + 1 for v in (size_m[1], size_m[0]))
        return cls(
            np.zeros((h, w, 3), np.uint8),
            np.zeros((h, w), np.float32),
            np.zeros(coarse, np.uint8),
            np.zeros((h, w), np.bool_),
            gsd_m,
            rng,
        )

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height in metres."""
        h, w = self.height_m.shape
        return w * self.gsd_m, h * self.gsd_m

    def px(self, xy_m: npt.ArrayLike) -> npt.NDArray[np.int32]:
        """``(N, 2)`` nearest pixels of points in metres."""
        return np.round(np.asarray(xy_m) / self.gsd_m - 0.5).astype(np.int32)

    def random_point(self, border_m: float = 0.0) -> FloatArray:
        """``(2,)`` a point in metres, at least a border away from the edge."""
        return np.array([self.rng.uniform(border_m, max(s - border_m, border_m + 1e-6)) for s in self.size_m])

    def is_free(self, xy_m: FloatArray, radius_m: float) -> bool:
        """Whether nothing stands within a square of half-side ``radius_m``."""
        x0, y0 = np.maximum(((xy_m - radius_m) / OCCUPANCY_M).astype(int), 0)
        x1, y1 = np.ceil((xy_m + radius_m) / OCCUPANCY_M).astype(int)
        return not self.taken[y0:y1, x0:x1].any()

    def take_polygon(self, corners_m: FloatArray, margin_m: float = 1.0) -> None:
        """Mark a polygon and a margin about it as taken."""
        c = np.round(corners_m / OCCUPANCY_M).astype(np.int32)
        cv2.fillPoly(self.taken, [c], 1)
        cv2.polylines(self.taken, [c], True, 1, max(1, round(2 * margin_m / OCCUPANCY_M)))

    def patch(self, centre_m: FloatArray, radius_m: float) -> Patch | None:
        """Return the part of the canvas about a point, ``None`` where it lies outside."""
        h, w = self.height_m.shape
        (x0, y0), (x1, y1) = self.px(centre_m - radius_m), self.px(centre_m + radius_m) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, w), min(y1, h)
        if x1 - x0 < 2 or y1 - y0 < 2:
            return None
        x = ((np.arange(x0, x1) + 0.5) * self.gsd_m - centre_m[0]).astype(np.float32)
        y = ((np.arange(y0, y1) + 0.5) * self.gsd_m - centre_m[1]).astype(np.float32)
        part = np.s_[y0:y1, x0:x1]
        return Patch(self.colour[part], self.height_m[part], self.leafy[part], x[None, :], y[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A window of the canvas (views: writing changes the canvas), with metres from its centre: x (1, w), y (h, 1)."""

    colour: ImageArray
    height_m: FloatImage
    leafy: npt.NDArray[np.bool_]
    x_m: FloatImage
    y_m: FloatImage

    def turned(self, angle_rad: float) -> tuple[FloatImage, FloatImage]:
        """``(h, w)`` metres along and across an axis that is turned from x towards y."""
        c, s = np.float32(np.cos(angle_rad)), np.float32(np.sin(angle_rad))
        return c * self.x_m + s * self.y_m, -s * self.x_m + c * self.y_m

    def paint(self, mask: npt.NDArray[np.bool_], bgr: npt.ArrayLike, *, brightness: FloatImage | float = 1.0) -> None:
        """Fill a mask with a colour times a brightness."""
        b = np.broadcast_to(np.asarray(brightness, dtype=np.float32), mask.shape)[mask]
        self.colour[mask] = np.clip(b[:, None] * np.asarray(bgr, dtype=np.float32), 0, 255).astype(np.uint8)

    def raise_to(self, mask: npt.NDArray[np.bool_], height_m: npt.NDArray[np.floating] | float) -> None:
        """Lift a mask to absolute heights where it is lower."""
        h = np.broadcast_to(np.asarray(height_m, dtype=np.float32), mask.shape)
        np.maximum(self.height_m, h, out=self.height_m, where=mask)


def box_corners(centre_m: FloatArray, length_m: float, width_m: float, angle_rad: float) -> FloatArray:
    """``(4, 2)`` corners of a turned rectangle."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (length_m / 2.0, width_m / 2.0)
    corners: FloatArray = centre_m + half @ np.array([[c, s], [-s, c]])
    return corners
