"""A flight as the server sees it (``server.live_view.LiveSession``): values handed out, nobody waited for."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import PhotomapError
from photomap_gis.core.grid import MapFrame, MapGrid, Window
from photomap_gis.core.similarity import FloatArray
from photomap_gis.live.canvas import NOBODY, LiveCanvas, TilePlanes
from photomap_gis.live.chart import Chart
from photomap_gis.live.hand import KeptPixels
from photomap_gis.live.lattice import TILE_PX
from photomap_gis.live.still import StillView
from photomap_gis.server.live_view import (
    Anchor,
    LiveEvent,
    LivePhase,
    LivePicture,
    LiveRaster,
    LiveState,
    LiveTrack,
    RasterKind,
)

logger = logging.getLogger(__name__)

MOST_TRACK = 3000
SNAPSHOT_SIDE_PX = 480


@dataclass(slots=True, eq=False)
class _Tables:
    """By key frame: when it was taken and how sure its place is (replaced whole by the loop, read by anybody)."""

    time_s: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    sigma_m: npt.NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))


class CanvasRaster:
    """One of the rasters of a canvas; before the first key frame there is none, and nothing is seen."""

    def __init__(self, kind: RasterKind, canvas: LiveCanvas | None, tables: _Tables) -> None:
        self._kind, self._canvas, self._tables = kind, canvas, tables

    @property
    def kind(self) -> RasterKind:
        """What it holds."""
        return self._kind

    @property
    def lattice(self) -> MapGrid:
        """Where its pixels lie."""
        if self._canvas is None:
            return MapGrid(None, 0.0, 0.0, 1.0, TILE_PX, TILE_PX, TILE_PX)
        return self._canvas.lattice.grid

    def extent(self) -> Window | None:
        """The pixels that may show something."""
        return None if self._canvas is None else self._canvas.extent()

    def version_in(self, window: Window) -> int:
        """The newest version of any pixel in a window."""
        seen = self._kind in (RasterKind.AGE, RasterKind.SEARCHED)
        return 0 if self._canvas is None else self._canvas.version_in(window, seen=seen)

    def read(self, window: Window) -> npt.NDArray[Any]:
        """The pixels of a window."""
        if self._kind is RasterKind.MAP:
            if self._canvas is None:
                return np.zeros((window.height, window.width, 4), np.uint8)
            return self._canvas.read(window, lambda p: p.rgba(), 0)
        if self._canvas is None:
            return np.full((window.height, window.width), np.nan, np.float32)
        return self._canvas.read(window, self._values, np.nan)

    def _values(self, planes: TilePlanes) -> npt.NDArray[np.float32]:
        if self._kind is RasterKind.SEARCHED:
            return np.where(planes.seen, planes.gsd, np.float32(np.nan)).astype(np.float32)
        if self._kind is RasterKind.AGE:
            return np.where(planes.seen, planes.seen_s, np.float32(np.nan)).astype(np.float32)
        table = self._tables.sigma_m
        values = np.append(table, np.float32(np.nan))  # nobody is -1: the last
        return values[np.minimum(planes.shown, len(table))]


class LiveView:
    """The session's window to the world; the loop and the hand put in, servers take out, in any thread."""

    def __init__(self, folder: Path, state: LiveState) -> None:
        self._folder = folder
        self._state = state
        self._lock = threading.Lock()
        self._listeners: dict[int, Callable[[LiveEvent], None]] = {}
        self._number = 0
        self._chart = Chart()
        self._tables = _Tables()
        self._canvas: LiveCanvas | None = None
        self._pixels: KeptPixels | None = None
        self.still = StillView()
        self.on_finalise: Callable[[], None] = lambda: None
        self._rasters = self._made()

    # what the session puts in

    def put(self, **changes: Any) -> None:
        """Change the state."""
        with self._lock:
            self._state = replace(self._state, **changes)

    def tell(self, event: LiveEvent) -> None:
        """Hand an event to all listeners."""
        for listener in list(self._listeners.values()):
            listener(event)

    def put_canvas(self, canvas: LiveCanvas, epoch: str) -> None:
        """Show another canvas from now on."""
        with self._lock:
            self._canvas = canvas
            self._rasters = self._made()
            self._state = replace(self._state, epoch=epoch, map_frame=canvas.lattice.map_frame)
        self.still.put_canvas(canvas)

    def put_chart(self, chart: Chart, times_s: list[float], pixels: KeptPixels) -> None:
        """Know where key frames lie; a snapshot that the loop does not change any more."""
        self._tables.time_s = np.array(times_s[: len(chart)], np.float32)
        self._tables.sigma_m = chart.sigmas().astype(np.float32)
        self._chart, self._pixels = chart, pixels

    # what servers take out

    @property
    def state(self) -> LiveState:
        """The session at this moment."""
        return self._state

    @property
    def rasters(self) -> tuple[LiveRaster, ...]:
        """The map and what else is known of its pixels."""
        return self._rasters

    def track(self) -> LiveTrack:
        """Where key frames lie, thinned."""
        chart, times = self._chart, self._tables.time_s
        step = max(1, -(-len(chart) // MOST_TRACK))
        keys = list(range(0, len(chart), step))
        if not keys:
            return LiveTrack(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.intp))
        xy = np.array([chart.belief(k).T_map_plane.translation for k in keys])
        return LiveTrack(
            xy, np.array([float(times[k]) for k in keys]), np.array([chart.segments[k] for k in keys], np.intp)
        )

    def covariance_at(self, xy_map_m: tuple[float, float]) -> FloatArray | None:
        """``(2, 2)`` predicted covariance at a place; ``None`` where nothing was seen."""
        key = self._shown_at(xy_map_m)
        if key is None:
            return None
        placement = self._chart.placement(key)
        px = placement.camera_to_map.unproject(np.array([xy_map_m]))
        return placement.position_covariance_m2(px)[0] if np.isfinite(px).all() else None

    def anchor_at(self, xy_map_m: tuple[float, float]) -> Anchor | None:
        """The key frame that is shown at a place, and where in it."""
        key = self._shown_at(xy_map_m)
        if key is None:
            return None
        x, y = self._chart.placement(key).camera_to_map.unproject(np.array([xy_map_m]))[0]
        return Anchor(key, float(x), float(y)) if np.isfinite([x, y]).all() else None

    def place_of(self, anchor: Anchor) -> tuple[float, float] | None:
        """Where an anchor lies by the newest solution."""
        if not 0 <= anchor.frame < len(self._chart):
            return None
        x, y = self._chart.placement(anchor.frame).camera_to_map.project(np.array([[anchor.x_px, anchor.y_px]]))[0]
        return (float(x), float(y)) if np.isfinite([x, y]).all() else None

    def picture_at(self, anchor: Anchor) -> npt.NDArray[np.uint8] | None:
        """``(h, w, 3)`` RGB of the frame about an anchor."""
        pixels = self._pixels
        if pixels is None or not 0 <= anchor.frame < len(self._chart):
            return None
        try:
            image = pixels(anchor.frame)
        except PhotomapError as error:
            logger.info("%s", error)
            return None
        if image.ndim == 2:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
        half, (h, w) = SNAPSHOT_SIDE_PX // 2, image.shape[:2]
        x0 = int(np.clip(round(anchor.x_px) - half, 0, max(0, w - 2 * half)))
        y0 = int(np.clip(round(anchor.y_px) - half, 0, max(0, h - 2 * half)))
        return np.asarray(cv2.cvtColor(image[y0 : y0 + 2 * half, x0 : x0 + 2 * half], cv2.COLOR_BGR2RGB), np.uint8)

    def subscribe(self, on_event: Callable[[LiveEvent], None]) -> Callable[[], None]:
        """Call ``on_event`` with everything from now on; return what ends it."""
        with self._lock:
            self._number += 1
            number = self._number
            self._listeners = {**self._listeners, number: on_event}

        def end() -> None:
            with self._lock:
                self._listeners = {n: one for n, one in self._listeners.items() if n != number}

        return end

    def watch(self, on_picture: Callable[[LivePicture], None]) -> Callable[[], None]:
        """Make the stabilised view as long as anybody watches."""
        return self.still.watch(on_picture)

    def finalise(self) -> None:
        """End the flight."""
        self.on_finalise()

    def _made(self) -> tuple[LiveRaster, ...]:
        return tuple(CanvasRaster(kind, self._canvas, self._tables) for kind in RasterKind)

    def _shown_at(self, xy_map_m: tuple[float, float]) -> int | None:
        canvas = self._canvas
        if canvas is None or canvas.lattice.map_frame != self._chart.map_frame:
            return None
        x, y = canvas.lattice.grid.to_px(canvas.lattice.frame.to_crs(np.array([xy_map_m])))[0]
        if not (abs(x) < 2**30 and abs(y) < 2**30):
            return None
        key = int(canvas.read(Window(round(float(x)), round(float(y)), 1, 1), lambda p: p.shown, NOBODY)[0, 0])
        return key if 0 <= key < len(self._chart) else None


def starting_state(name: str, folder: Path, **more: Any) -> LiveState:
    """Return the state of a session that has not seen a frame yet."""
    return LiveState(name, folder, "0", LivePhase.STARTING, MapFrame(None), 0, 0.0, **more)
