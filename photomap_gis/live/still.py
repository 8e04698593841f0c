"""The stabilised view: the newest frame warped into the still map, as the paper's operator saw it.

Made only while somebody watches, in a thread of its own; the loop only leaves its newest frame here. The window stays
where it is until the frame nears its border, so that the ground stands still under the eye. Around the frame lies the
map as it is by now, dimmed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.live import Picture
from photomap_gis.core.placement import FramePlacement
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.lattice import LiveLattice
from photomap_gis.mosaic.lattice import Lattice
from photomap_gis.server.live_view import LivePicture

SIDE_PX = 640
STEP_PX = 16
RATE_HZ = 12.0
JPEG_QUALITY = 75
BACKGROUND_EVERY_S = 1.0
BRIGHTNESS = 0.45
"""Of the map around the frame."""
WIDEST = 6
"""So many of the map's pixels a pixel of the view at most; beyond, the frame is shown alone."""
DARK = 24
EDGE = 0.18
"""The window is laid anew when the frame's middle comes so near to its border, as a share of its side."""


class StillView:
    """Holds the newest frame and those who watch."""

    def __init__(self) -> None:
        self._lock = threading.Condition()
        self._watchers: dict[int, Callable[[LivePicture], None]] = {}
        self._number = self._sequence = 0
        self._newest: tuple[int, float, Picture, FramePlacement, LiveCanvas] | None = None
        self._background: _Background | None = None
        self._canvas: LiveCanvas | None = None
        self._grid: MapGrid | None = None
        self._thread: threading.Thread | None = None

    def put_canvas(self, canvas: LiveCanvas) -> None:
        """The map is drawn there from now on."""
        with self._lock:
            self._canvas, self._grid, self._newest, self._background = canvas, None, None, None

    def put(self, frame: int, time_s: float, picture: Picture, placement: FramePlacement) -> None:
        """Leave the newest frame; costs nothing where nobody watches."""
        if not self._watchers:
            return
        with self._lock:
            if self._canvas is not None:
                self._newest = (frame, time_s, picture, placement, self._canvas)
                self._lock.notify_all()

    def watch(self, on_picture: Callable[[LivePicture], None]) -> Callable[[], None]:
        """Hand pictures over until the function returned is called."""
        with self._lock:
            self._number += 1
            number = self._number
            self._watchers = {**self._watchers, number: on_picture}
            if self._thread is None:
                self._thread = threading.Thread(target=self._make, name="still-view", daemon=True)
                self._thread.start()

        def end() -> None:
            with self._lock:
                self._watchers = {n: w for n, w in self._watchers.items() if n != number}
                self._lock.notify_all()

        return end

    def _make(self) -> None:
        while True:
            began = time.monotonic()
            with self._lock:
                while self._newest is None and self._watchers:
                    self._lock.wait(0.5)
                if not self._watchers:
                    self._thread = None
                    return
                newest, self._newest = self._newest, None
            if newest is None:
                continue
            picture = self.picture(*newest)
            if picture is not None:
                for watcher in list(self._watchers.values()):
                    watcher(picture)
            time.sleep(max(0.0, 1.0 / RATE_HZ - (time.monotonic() - began)))

    def picture(
        self, frame: int, time_s: float, picture: Picture, placement: FramePlacement, canvas: LiveCanvas
    ) -> LivePicture | None:
        """Return a frame in the still map; ``None`` where its placement makes no sense."""
        lattice = canvas.lattice
        middle = lattice.frame.to_crs(placement.centre_xy_map_m[None])[0]
        outline = lattice.grid.to_px(lattice.frame.to_crs(placement.outline_xy_map_m()))
        if not np.isfinite(middle).all() or len(outline) < 3 or not np.isfinite(outline).all():
            return None
        self._grid = grid = _window_around(self._grid, middle, float(np.ptp(outline, axis=0).max()), lattice.grid)
        nodes = Lattice.over(Window(0, 0, grid.width, grid.height), grid, lattice.frame, step_px=STEP_PX)
        xy = placement.camera_to_map.unproject(nodes.nodes_xy_map_m).reshape(*nodes.shape, 2)
        dense = nodes.dense(np.where(np.isfinite(xy), xy, -1e5).astype(np.float32))
        part = np.ascontiguousarray(dense[STEP_PX : STEP_PX + grid.height, STEP_PX : STEP_PX + grid.width])
        image = picture.bgr
        factor = min(8, _shrinks(placement, grid, lattice))
        if factor > 1:  # pictures much finer than the view would flicker
            h, w = image.shape[0] // factor, image.shape[1] // factor
            image = cv2.resize(image[: h * factor, : w * factor], (w, h), interpolation=cv2.INTER_AREA)
            part = ((part + 0.5) / factor - 0.5).astype(np.float32)
        still = cv2.remap(image, part, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        outside = cv2.bitwise_not(cv2.inRange(part, (0.0, 0.0), (image.shape[1] - 1.0, image.shape[0] - 1.0)))
        cv2.copyTo(self._around(canvas, grid), outside, still)
        ok, jpeg = cv2.imencode(".jpg", still, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if not ok:
            return None
        self._sequence += 1
        return LivePicture(self._sequence, frame, time_s, grid, jpeg.tobytes())

    def _around(self, canvas: LiveCanvas, grid: MapGrid) -> ImageArray:
        """Return the map in the view's window, BGR and dimmed; renewed once a second."""
        known, now = self._background, time.monotonic()
        if known is not None and known.grid == grid and now - known.made_s < BACKGROUND_EVERY_S:
            return known.image
        self._background = _Background(grid, now, _map_in(canvas, grid))
        return self._background.image


@dataclass(frozen=True, slots=True, eq=False)
class _Background:
    grid: MapGrid
    made_s: float
    image: ImageArray


def _map_in(canvas: LiveCanvas, grid: MapGrid) -> ImageArray:
    """``(h, w, 3)`` BGR of a canvas on a coarser grid of its CRS, dimmed; dark where it shows nothing."""
    image = np.full((grid.height, grid.width, 3), DARK, np.uint8)
    base = canvas.lattice.grid
    ratio = grid.pixel_size / base.pixel_size
    if ratio > WIDEST:
        return image
    corner = base.to_px(grid.to_crs(np.array([[-0.5, -0.5]])))[0]
    x, y = np.floor(corner).astype(int)
    window = Window(int(x), int(y), math.ceil(grid.width * ratio) + 2, math.ceil(grid.height * ratio) + 2)
    rgba = canvas.read(window, lambda planes: planes.rgba(), 0)
    fine = cv2.resize(rgba, None, fx=1.0 / ratio, fy=1.0 / ratio, interpolation=cv2.INTER_AREA)
    move = np.array([[1.0, 0.0, -(corner[0] + 0.5 - x) / ratio], [0.0, 1.0, -(corner[1] + 0.5 - y) / ratio]])
    there = cv2.warpAffine(fine, move, (grid.width, grid.height), flags=cv2.INTER_LINEAR)
    seen = cv2.compare(there[..., 3].copy(), 127, cv2.CMP_GT)
    bgr = cv2.convertScaleAbs(cv2.cvtColor(there, cv2.COLOR_RGBA2BGR), alpha=BRIGHTNESS)
    cv2.copyTo(bgr, seen, image)
    return image


def _shrinks(placement: FramePlacement, grid: MapGrid, lattice: LiveLattice) -> int:
    corners = placement.camera_to_map.project(np.array([[0.0, 0.0], [placement.width_px - 1.0, 0.0]]))
    side = float(np.hypot(*np.diff(lattice.frame.to_crs(corners), axis=0)[0])) / grid.pixel_size
    return max(1, int(placement.width_px / max(side, 1.0)))


def _window_around(grid: MapGrid | None, middle: np.ndarray, outline_px: float, base: MapGrid) -> MapGrid:
    """Return the window of before, or one laid anew about the frame's middle; its pixels are whole ones of a scale."""
    size = base.pixel_size * max(1.0, 1.35 * outline_px / SIDE_PX)
    if grid is not None and 0.75 < grid.pixel_size / size < 1.35:
        x, y = grid.to_px(middle[None])[0] / SIDE_PX
        if EDGE * 1.6 < x < 1.0 - EDGE * 1.6 and EDGE * 1.6 < y < 1.0 - EDGE * 1.6:
            return grid
        size = grid.pixel_size
    west = np.round((middle[0] - size * SIDE_PX / 2.0) / size) * size
    north = np.round((middle[1] + size * SIDE_PX / 2.0) / size) * size
    return replace(base, west=float(west), north=float(north), pixel_size=size, width=SIDE_PX, height=SIDE_PX)
