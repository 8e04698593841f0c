"""A live session without a flight: a simulated drone over a made ground, driven step by step, so that tests know all.

``python -m tests.server.live_fake --port 8766`` flies it in real time behind a server, for clients to be tried on.
"""

from __future__ import annotations

import argparse
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.grid import MapFrame, MapGrid, Window
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.export.crs import WGS84, point_map
from photomap_gis.server.live_view import (
    Anchor,
    GpsState,
    LinkState,
    LiveEnd,
    LiveEvent,
    LiveHealth,
    LivePhase,
    LivePicture,
    LivePose,
    LiveSegment,
    LiveSnapped,
    LiveSolution,
    LiveState,
    LiveTiles,
    LiveTrack,
    RasterKind,
    Vehicle,
)
from photomap_gis.simulate import procedural_scene
from photomap_gis.simulate.ground import Ground

TILE = 512
FPS = 30.0
KEY_EVERY = 12
WIDTH, HEIGHT = 640, 360
STARTED_UTC_S = 1_790_000_000.0


@lru_cache(maxsize=2)
def ground_of(side_m: float, gsd_m: float) -> Ground:
    """The ground that is flown over; made once."""
    return procedural_scene((side_m, side_m), gsd_m, 5)


class FakeRaster:
    """Pixels in tiles at any row and column."""

    def __init__(self, kind: RasterKind, lattice: MapGrid) -> None:
        self.kind, self.lattice = kind, lattice
        self.tiles: dict[tuple[int, int], np.ndarray] = {}
        self.versions: dict[tuple[int, int], int] = {}
        self.lock = threading.Lock()
        self.blank = np.zeros((TILE, TILE, 4), np.uint8) if kind is RasterKind.MAP else np.full(
            (TILE, TILE), np.nan, np.float32
        )  # fmt: skip

    def extent(self) -> Window | None:
        with self.lock:
            keys = list(self.tiles)
        if not keys:
            return None
        rows, cols = zip(*keys, strict=True)
        top, left = min(rows), min(cols)
        return Window(left * TILE, top * TILE, (max(cols) - left + 1) * TILE, (max(rows) - top + 1) * TILE)

    def read(self, window: Window) -> np.ndarray:
        out = np.empty((window.height, window.width, *self.blank.shape[2:]), self.blank.dtype)
        out[...] = self.blank[0, 0]
        with self.lock:
            for r, c in self._under(window):
                if (r, c) in self.tiles:
                    here, there = _common(window, Window(c * TILE, r * TILE, TILE, TILE))
                    out[here] = self.tiles[r, c][there]
        return out

    def version_in(self, window: Window) -> int:
        with self.lock:
            return max((self.versions.get(k, 0) for k in self._under(window)), default=0)

    def paste(self, window: Window, pixels: np.ndarray, seen: np.ndarray, version: int) -> None:
        with self.lock:
            for key in self._under(window):
                here, there = _common(window, Window(key[1] * TILE, key[0] * TILE, TILE, TILE))
                if not seen[here].any():
                    continue
                tile = self.tiles[key].copy() if key in self.tiles else self.blank.copy()
                tile[there][seen[here]] = pixels[here][seen[here]]
                self.tiles[key], self.versions[key] = tile, version

    def _under(self, w: Window) -> list[tuple[int, int]]:
        rows = range(w.row_off // TILE, (w.row_off + w.height - 1) // TILE + 1)
        cols = range(w.col_off // TILE, (w.col_off + w.width - 1) // TILE + 1)
        return [(r, c) for r in rows for c in cols]


def _common(a: Window, b: Window) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    left, top = max(a.col_off, b.col_off), max(a.row_off, b.row_off)
    right, bottom = min(a.col_off + a.width, b.col_off + b.width), min(a.row_off + a.height, b.row_off + b.height)

    def part(w: Window) -> tuple[slice, slice]:
        return slice(top - w.row_off, bottom - w.row_off), slice(left - w.col_off, right - w.col_off)

    return part(a), part(b)


class FakeSession:
    """``step`` flies on; ``solve``, ``snap``, ``lose`` and ``finalise`` are what else can happen."""

    def __init__(self, folder: Path, *, georeferenced: bool = True, area: bool = True, side_m: float = 120.0) -> None:
        self.gsd = 0.08
        self.ground = ground_of(side_m, self.gsd)
        east, north = self.ground.centre_en_m
        self.true_frame = MapFrame(self.ground.crs_wkt, round(east), round(north))
        # without a place the map's unit is a pixel of the first frame, and its axes are turned
        self.T_local_true = Similarity2D(30.0, -20.0, 0.4, -math.log(self.gsd))
        self.folder, self.georeferenced = folder, georeferenced
        self.area = self._lon_lat([(-38, -30), (38, -30), (38, 30), (-38, 30)]) if area else None
        self.camera = PlaneView.flat(Camera(WIDTH, HEIGHT, 700.0))
        self.listeners: list[Callable[[LiveEvent], None]] = []
        self.watchers: list[Callable[[LivePicture], None]] = []
        self.frame = -1
        self.drift = Similarity2D()
        self.keys: list[tuple[int, Similarity2D]] = []
        self.revision, self.version, self.epochs, self.sequence = 0, 0, 0, 0
        self.phase, self.end, self.link = LivePhase.STARTING, None, LinkState.OK
        self.pose: LivePose | None = None
        self.segments, self.dropped = 1, 0
        self.finalised = 0
        self._new_epoch()

    # What the server asks

    @property
    def state(self) -> LiveState:
        return LiveState(
            "flight 7", self.folder, f"e{self.epochs}", self.phase, self.map_frame, self.revision,
            max(0, self.frame) / FPS, STARTED_UTC_S, self.pose, self.health, self.end, self.area,
        )  # fmt: skip

    def track(self) -> LiveTrack:
        keys = list(self.keys)
        xy = np.array([self._place(T).centre_xy_map_m for _, T in keys]).reshape(-1, 2)
        return LiveTrack(xy, np.array([f / FPS for f, _ in keys]), np.zeros(len(keys), np.intp))

    def covariance_at(self, xy_map_m: tuple[float, float]) -> np.ndarray | None:
        if self.anchor_at(xy_map_m) is None:
            return None
        s = 1.0 if self.georeferenced else 1.0 / self.gsd
        return np.array([[0.9, 0.3], [0.3, 0.4]]) * s * s

    def anchor_at(self, xy_map_m: tuple[float, float]) -> Anchor | None:
        best = None
        for frame, T in list(self.keys):
            x, y = self._place(T).camera_to_map.unproject([xy_map_m])[0]
            if 0 <= x < WIDTH and 0 <= y < HEIGHT:
                away = math.hypot(x - WIDTH / 2, y - HEIGHT / 2)
                if best is None or away < best[0]:
                    best = (away, Anchor(frame, float(x), float(y)))
        return best[1] if best else None

    def place_of(self, anchor: Anchor) -> tuple[float, float] | None:
        T = dict(self.keys).get(anchor.frame)
        if T is None:
            return None
        x, y = self._place(T).camera_to_map.project([[anchor.x_px, anchor.y_px]])[0]
        return float(x), float(y)

    def picture_at(self, anchor: Anchor) -> np.ndarray | None:
        picture = self.picture(anchor.frame)
        x, y = round(anchor.x_px), round(anchor.y_px)
        return picture[max(0, y - 120) : y + 120, max(0, x - 160) : x + 160, ::-1].copy()

    def subscribe(self, on_event: Callable[[LiveEvent], None]) -> Callable[[], None]:
        self.listeners.append(on_event)
        return lambda: self.listeners.remove(on_event)

    def watch(self, on_picture: Callable[[LivePicture], None]) -> Callable[[], None]:
        self.watchers.append(on_picture)
        return lambda: self.watchers.remove(on_picture)

    def finalise(self) -> None:
        self.finalised += 1
        if self.finalised == 1:
            self._end(LivePhase.FINALISING, 0.0)

    # What a test drives

    def step(self, frames: int = 1) -> None:
        for _ in range(frames):
            self.frame += 1
            self.phase = LivePhase.FLYING
            self.drift = self.drift @ Similarity2D(0.05, 0.03, 0.0)
            T = self.drift @ self.truth(self.frame)
            placed = self.link is LinkState.OK
            lon, lat = self._lon_lat([self.truth(self.frame).translation])[0]
            vehicle = Vehicle(
                float(lon), float(lat), 70.0, math.degrees(self.truth(self.frame).angle_rad) % 360, 9.0, 71.0, "AUTO"
            )
            self.pose = LivePose(
                self.frame, self.frame / FPS, self._place(T) if placed else None, self.map_frame,
                STARTED_UTC_S + self.frame / FPS, vehicle if self.georeferenced else None,
            )  # fmt: skip
            self.tell(self.pose)
            if placed and self.frame % KEY_EVERY == 0:
                self.keys.append((self.frame, T))
                self.version += 1
                self.tell(LiveTiles(self.version, (self._paste(self.frame, T),)))
            if self.watchers and self.frame % 3 == 0 and placed:
                picture = self._stabilised(T)
                for watcher in list(self.watchers):
                    watcher(picture)
            if self.frame % round(FPS) == 0:
                self.tell(self.health)

    def solve(self) -> None:
        """A loop closes: drift is gone, all has moved."""
        moved = math.hypot(self.drift.tx, self.drift.ty) / self.gsd
        self.drift = Similarity2D()
        self.keys = [(f, self.truth(f)) for f, _ in self.keys]
        self.revision += 1
        self.tell(LiveSolution(self.revision, self.frame, moved))
        self._redraw()

    def snap(self) -> None:
        """The map finds its place on Earth."""
        self.georeferenced = True
        self.revision += 1
        self._new_epoch()
        self._redraw(tell=False)
        if self.pose is not None and self.pose.placement is not None:
            T = self.drift @ self.truth(self.frame)
            self.pose = replace(self.pose, placement=self._place(T), map_frame=self.map_frame)
        self.tell(LiveSnapped(f"e{self.epochs}", "the map has found its place on Earth"))

    def lose(self, link: LinkState = LinkState.LOST) -> None:
        self.link = link
        self.tell(self.health)

    def find_again(self) -> None:
        self.link = LinkState.OK
        self.segments += 1
        self.tell(LiveSegment(self.segments - 1, self.frame, None, "the map goes on in a new piece"))
        self.segments -= 1
        self.tell(LiveSegment(1, self.frame, 0, "the pieces are one map again"))

    def progress(self, share: float) -> None:
        self._end(LivePhase.ENDED if share >= 1.0 else LivePhase.FINALISING, share)

    def tell(self, event: LiveEvent) -> None:
        for listener in list(self.listeners):
            listener(event)

    @property
    def health(self) -> LiveHealth:
        words = {LinkState.LOST: ("no picture for 3 s: is the drone in range?",)}.get(self.link, ())
        return LiveHealth(
            self.frame + 1, 0.0 if words else FPS, 41.0, self.dropped, 0, len(self.keys), self.segments, self.link,
            GpsState.OK if self.georeferenced else GpsState.NONE, words,
        )  # fmt: skip

    def truth(self, frame: int) -> Similarity2D:
        """Where frame's plane lies in the true map frame: lanes of 60 m, 12 m apart."""
        along, lane_m, spacing_m = frame * 9.0 / FPS, 60.0, 12.0
        lane = int(along // (lane_m + spacing_m))
        rest = along - lane * (lane_m + spacing_m)
        side = 1.0 if lane % 2 == 0 else -1.0
        y = 24.0 - lane * spacing_m
        x, heading = side * (min(rest, lane_m) - lane_m / 2), side * math.pi / 2
        if rest > lane_m:
            share = (rest - lane_m) / spacing_m
            y, heading = y - (rest - lane_m), heading * (1 - 2 * share) if share < 1 else -heading
        wobble = 0.03 * math.sin(frame * 0.7)  # the hand that flies it
        return Similarity2D(x, y + 0.5 * math.sin(frame * 0.06), heading + wobble, math.log(self.gsd))

    def picture(self, frame: int) -> np.ndarray:
        """``(H, W, 3)`` BGR that the camera sees."""
        px = self._ground_px(self.true_frame) @ self.truth(frame) @ Similarity2D(-(WIDTH - 1) / 2, -(HEIGHT - 1) / 2)
        return cv2.warpAffine(
            self.ground.colour, px.matrix[:2], (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip

    def _ground_px(self, frame: MapFrame) -> Similarity2D:
        """From the true map frame to pixels of the ground."""
        g = self.ground
        x0, y0 = frame.from_crs([(g.west, g.north)])[0]
        return Similarity2D(-x0 / g.pixel_size_m - 0.5, -y0 / g.pixel_size_m - 0.5, 0.0, -math.log(g.pixel_size_m))

    def _new_epoch(self) -> None:
        self.epochs += 1
        self.map_frame = self.true_frame if self.georeferenced else MapFrame(None)
        size = self.gsd if self.georeferenced else 1.0
        west, north = self.map_frame.to_crs([(0.0, 0.0)])[0]
        lattice = MapGrid(self.map_frame.crs_wkt, float(west), float(north), size, TILE, TILE, TILE)
        kinds = (RasterKind.MAP, RasterKind.AGE, RasterKind.SIGMA)
        self.rasters = tuple(FakeRaster(k, lattice) for k in kinds)

    def _place(self, T_true_plane: Similarity2D) -> FramePlacement:
        T = T_true_plane if self.georeferenced else self.T_local_true @ T_true_plane
        return FramePlacement(
            0, WIDTH, HEIGHT, PlanePlacement(self.camera, T), np.diag([90.0, 40.0, 1e-5, 1e-5]).astype(float)
        )

    def _paste(self, frame: int, T_true_plane: Similarity2D) -> Window:
        place = self._place(T_true_plane)
        lattice = self.rasters[0].lattice
        ring = lattice.to_px(self.map_frame.to_crs(place.outline_xy_map_m()))
        left, top = (int(v) for v in np.floor(ring.min(axis=0)))
        right, bottom = (int(v) + 1 for v in np.ceil(ring.max(axis=0)))
        window = Window(left, top, right - left, bottom - top)
        rows, cols = np.mgrid[top:bottom, left:right]
        xy = self.map_frame.from_crs(lattice.to_crs(np.stack([cols.ravel(), rows.ravel()], axis=-1)))
        px = place.camera_to_map.unproject(xy).reshape(*rows.shape, 2).astype(np.float32)
        colour = cv2.remap(self.picture(frame), px[..., 0], px[..., 1], cv2.INTER_LINEAR)
        inside = ((px >= 0) & (px <= (WIDTH - 1, HEIGHT - 1))).all(axis=-1)
        rgba = np.dstack([colour[..., ::-1], np.full(rows.shape, 255, np.uint8)])
        self.rasters[0].paste(window, rgba, inside, self.version)
        shape = rows.shape
        self.rasters[1].paste(window, np.full(shape, frame / FPS, np.float32), inside, self.version)
        sigma = 0.5 + 0.002 * np.hypot(px[..., 0] - WIDTH / 2, px[..., 1] - HEIGHT / 2).astype(np.float32)
        self.rasters[2].paste(window, sigma, inside, self.version)
        return window

    def _redraw(self, *, tell: bool = True) -> None:
        self.version += 1
        windows = tuple(self._paste(f, T) for f, T in self.keys)
        if tell:
            self.tell(LiveTiles(self.version, windows))

    def _stabilised(self, T_true_plane: Similarity2D) -> LivePicture:
        """The frame on a north-up grid around the drone that moves in whole steps."""
        self.sequence += 1
        place = self._place(T_true_plane)
        lattice = self.rasters[0].lattice
        en = self.map_frame.to_crs([place.centre_xy_map_m])[0]
        step = 64 * lattice.pixel_size
        west, north = (math.floor(v / step) * step for v in en)
        w, h = 480, 360
        grid = MapGrid(lattice.crs_wkt, west - w * 0.8 * lattice.pixel_size, north + h * 0.8 * lattice.pixel_size,
                       lattice.pixel_size * 1.6, w, h)  # fmt: skip
        rows, cols = np.mgrid[0:h, 0:w]
        xy = self.map_frame.from_crs(grid.to_crs(np.stack([cols.ravel(), rows.ravel()], axis=-1)))
        px = place.camera_to_map.unproject(xy).reshape(h, w, 2).astype(np.float32)
        image = cv2.remap(self.picture(self.frame), px[..., 0], px[..., 1], cv2.INTER_LINEAR)
        done, data = cv2.imencode(".jpg", image)
        assert done
        return LivePicture(self.sequence, self.frame, self.frame / FPS, grid, data.tobytes())

    def _end(self, phase: LivePhase, share: float) -> None:
        self.phase, self.link = phase, LinkState.ENDED
        self.end = LiveEnd(phase, share, "the final map is being drawn" if phase is LivePhase.FINALISING else "done")
        self.tell(self.end)

    def _lon_lat(self, xy_true: object) -> np.ndarray:
        en = self.true_frame.to_crs(np.asarray(xy_true, dtype=float))
        return point_map(self.ground.crs_wkt, WGS84)(en)


def main() -> None:
    """Fly behind a server until ^C."""
    from photomap_gis.cli.serve_view import open_view
    from photomap_gis.server import Access, BoundServer, Host, create_app

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--relative", action="store_true", help="begin without a place; snap after 20 s")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    session = FakeSession(options.folder, georeferenced=not options.relative)
    host = Host(open_view)
    host.open_live(session)
    server = BoundServer("127.0.0.1", options.port)
    app = create_app(host, Access(None, loopback_only=True))
    stop = threading.Event()

    def fly() -> None:
        began = time.monotonic()
        while not stop.is_set() and session.phase in (LivePhase.STARTING, LivePhase.FLYING):
            session.step()
            if session.frame == 600:
                session.snap() if options.relative else session.solve()
            stop.wait(max(0.0, began + session.frame / FPS - time.monotonic()))

    flight = threading.Thread(target=fly, daemon=True)
    server.serve(app, lambda: (flight.start(), print(server.url, flush=True)))  # type: ignore[func-returns-value]
    stop.set()


if __name__ == "__main__":
    main()
