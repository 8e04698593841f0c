"""The render worker's work: key frames onto the canvas, and tiles drawn anew where a solution has moved them.

It owns no thread: ``do`` carries out one command or one step of a redrawing, so a key frame that comes meanwhile never
waits for long. What it did is journaled command by command; a replay that gives the same commands gets equal pixels.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from photomap_gis.core.errors import PhotomapError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import TileIndex, Window
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.live.canvas import LiveCanvas, Sheet, TilePlanes, blend, shared, sheet_of, tiles_under
from photomap_gis.live.lattice import TILE_PX, LiveLattice

logger = logging.getLogger(__name__)

MOVED_PX, FAR_MOVED_PX = 0.5, 2.0
"""A key frame that a solution moves by more is drawn anew: near the drone, and elsewhere."""
NEAR_TILES = 6
BLOCK_TILES = 24
"""So many tiles at most are drawn anew at once."""
CROWDED_SHARE, CROWDED_TURN_RAD = 0.18, 0.03
"""Drawn anew is, of key frames in a row that look the same way, only one in each such share of a frame."""

Placer = Callable[[int], FramePlacement]


@dataclass(frozen=True, slots=True, eq=False)
class Redrawn:
    """A command of the render journal: which tiles were drawn anew by which key frames."""

    tiles: tuple[TileIndex, ...]
    keys: tuple[int, ...]


@dataclass(slots=True, eq=False)
class _Redrawing:
    """Tiles on their way to being drawn anew (a builder)."""

    tiles: frozenset[TileIndex]
    keys: deque[int]
    clip: Window
    done: list[int] = field(default_factory=list)
    fresh: dict[TileIndex, TilePlanes] = field(default_factory=dict)
    pasted: dict[TileIndex, list[int]] = field(default_factory=dict)

    @classmethod
    def of(cls, tiles: Iterable[TileIndex], keys: Sequence[int]) -> _Redrawing:
        """Begin with blank tiles."""
        wanted = frozenset(tiles)
        rows, cols = [t.row for t in wanted], [t.col for t in wanted]
        top, left = min(rows), min(cols)
        clip = Window(left * TILE_PX, top * TILE_PX, (max(cols) - left + 1) * TILE_PX, (max(rows) - top + 1) * TILE_PX)
        return cls(wanted, deque(keys), clip, [], {t: TilePlanes.blank() for t in wanted}, {t: [] for t in wanted})

    def take(self, key: int, sheet: Sheet | None) -> None:
        """Paste a frame on those of the tiles on which it lies."""
        self.done.append(key)
        if sheet is None:
            return
        for tile in tiles_under(sheet.window):
            if tile in self.tiles:
                here, there = shared(sheet.window, tile)
                if sheet.inside[here].any():
                    blend(self.fresh[tile], there, sheet, here, key)
                    self.pasted[tile].append(key)


class Painter:
    """Key frames and their pixels on the canvas of the present epoch; one owner.

    ``pixels`` reads a key frame's raster; ``on_redrawn`` hears of each redrawing that is done.
    """

    def __init__(
        self,
        canvas: LiveCanvas,
        pixels: Callable[[int], ImageArray],
        on_redrawn: Callable[[Redrawn], None] = lambda done: None,
    ) -> None:
        self.canvas = canvas
        self._pixels, self._on_redrawn = pixels, on_redrawn
        self._placements: dict[int, FramePlacement] = {}
        self._times: dict[int, float] = {}
        self._drawn: dict[int, FloatArray] = {}
        self._newest: dict[int, FloatArray] = {}
        self._stale: set[TileIndex] = set()
        self._tiles_of: dict[int, set[TileIndex]] = {}
        self._redrawing: _Redrawing | None = None
        self._focus: FloatArray = np.zeros(2)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be drawn anew."""
        return self._redrawing is None and not self._stale

    @property
    def count(self) -> int:
        """Key frames pasted."""
        return len(self._times)

    def paste(self, key: int, placement: FramePlacement, image: ImageArray | None, time_s: float) -> bool:
        """Paste a key frame; return whether it lies on the map anywhere."""
        self._placements[key], self._times[key] = placement, time_s
        corners = self._corners(placement)
        self._newest[key] = self._drawn[key] = corners
        if np.isfinite(corners).all():
            self._focus = corners.mean(axis=0)
        sheet = self._sheet(key, image)
        if sheet is None:
            return False
        touched = self.canvas.paste(key, sheet)
        self._tiles_of[key] = set(touched)
        if self._redrawing is not None and self._redrawing.tiles & set(touched):
            self._redrawing.keys.append(key)  # as kept: so will a replay draw it
        return bool(touched)

    def adopt(self, placer: Placer, keys: Iterable[int]) -> float:
        """Take new placements over; return by how many pixels the map moves most, near the newest key frame."""
        pending = {} if self._redrawing is None else dict.fromkeys(self._redrawing.tiles)
        most = 0.0
        for key in keys:
            if key not in self._times:
                continue
            placement = placer(key)
            corners = self._corners(placement)
            self._placements[key], self._newest[key] = placement, corners
            if not np.isfinite(corners).all():
                continue
            near = self._is_near(corners)
            moved = float(np.abs(corners - self._drawn[key]).max())
            if near:
                most = max(most, moved)
            if moved > (MOVED_PX if near else FAR_MOVED_PX):
                self._stale |= self._tiles_of.get(key, set()) | set(_tiles_of(corners))
        self._stale |= set(pending)
        self._redrawing = None
        return most

    def step(self) -> bool:
        """Do a little of what is to be drawn anew; return whether more is left."""
        if self._redrawing is None:
            if not self._stale:
                return False
            self._begin(self._block())
        redrawing = self._redrawing
        assert redrawing is not None
        if redrawing.keys:
            key = redrawing.keys.popleft()
            redrawing.take(key, self._sheet(key, None, redrawing.clip))
            return True
        self._finish(redrawing)
        return bool(self._stale)

    def redraw(self, tiles: Iterable[TileIndex], keys: Sequence[int]) -> None:
        """Draw tiles anew by these key frames (a replay)."""
        redrawing = _Redrawing.of(tiles, keys)
        while redrawing.keys:
            key = redrawing.keys.popleft()
            redrawing.take(key, self._sheet(key, None, redrawing.clip))
        self._finish(redrawing)

    def _begin(self, tiles: Sequence[TileIndex]) -> None:
        self._stale -= set(tiles)
        wanted = set(tiles)
        keys = sorted(
            k for k, corners in self._newest.items()
            if np.isfinite(corners).all() and not wanted.isdisjoint(_tiles_of(corners))
        )  # fmt: skip
        self._redrawing = _Redrawing.of(tiles, self._thinned(keys))

    def _finish(self, redrawing: _Redrawing) -> None:
        self._redrawing = None
        for tile, keys in redrawing.pasted.items():
            for key in self.canvas.keys_of(tile):
                self._tiles_of.get(key, set()).discard(tile)
            for key in keys:
                self._tiles_of.setdefault(key, set()).add(tile)
        self.canvas.replace(redrawing.fresh, redrawing.pasted)
        for key in redrawing.done:
            if not (self._tiles_of.get(key, set()) & self._stale):
                self._drawn[key] = self._newest[key]
        left_out = {k for t in redrawing.tiles for k in self._newest if t in self._tiles_of.get(k, set())}
        for key in left_out:
            self._drawn[key] = self._newest[key]
        self._on_redrawn(Redrawn(tuple(sorted(redrawing.tiles)), tuple(redrawing.done)))

    def _block(self) -> list[TileIndex]:
        """Return stale tiles that lie together, those near the drone first: they are what is looked at."""
        at = self._focus / TILE_PX
        nearest = min(self._stale, key=lambda t: (abs(t.row + 0.5 - at[1]) + abs(t.col + 0.5 - at[0]), t))
        around = sorted(
            self._stale, key=lambda t: (max(abs(t.row - nearest.row), abs(t.col - nearest.col)), t)
        )  # fmt: skip
        reach = NEAR_TILES
        return [t for t in around if max(abs(t.row - nearest.row), abs(t.col - nearest.col)) <= reach][:BLOCK_TILES]

    def _thinned(self, keys: Sequence[int]) -> list[int]:
        """Leave out key frames in a row that lie close to the last one that is drawn."""
        kept: list[int] = []
        for n, key in enumerate(keys):
            if kept and key - 1 in keys[max(0, n - 1) : n] and n + 1 < len(keys) and keys[n + 1] == key + 1:
                a, b = self._newest[kept[-1]], self._newest[key]
                side = float(np.hypot(*(b[1] - b[0])))
                turn = abs(np.angle(complex(*(b[1] - b[0])) / complex(*(a[1] - a[0]))))
                apart = float(np.hypot(*(b.mean(axis=0) - a.mean(axis=0))))
                if apart < CROWDED_SHARE * side and turn < CROWDED_TURN_RAD:
                    continue
            kept.append(key)
        return kept

    def _sheet(self, key: int, image: ImageArray | None, clip: Window | None = None) -> Sheet | None:
        try:
            pixels = self._pixels(key) if image is None else image
        except PhotomapError as error:
            logger.warning("%s", error)
            return None
        return sheet_of(self._placements[key], pixels, self.canvas.lattice, self._times[key], clip)

    def _corners(self, placement: FramePlacement) -> FloatArray:
        """``(4, 2)`` the frame's corners in pixels of the lattice, clockwise from the first pixel's."""
        w, h = placement.width_px - 1.0, placement.height_px - 1.0
        xy = placement.camera_to_map.project(np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))
        lattice: LiveLattice = self.canvas.lattice
        return lattice.grid.to_px(lattice.frame.to_crs(xy))

    def _is_near(self, corners: FloatArray) -> bool:
        return bool(np.abs(corners.mean(axis=0) - self._focus).max() <= NEAR_TILES * TILE_PX)


def _tiles_of(corners: FloatArray) -> list[TileIndex]:
    """Return the tiles under the box around four corners."""
    (x0, y0), (x1, y1) = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int) + 1
    if (x1 - x0) * (y1 - y0) > 64 * TILE_PX * TILE_PX * 16:
        return []
    return tiles_under(Window(int(x0), int(y0), int(x1 - x0), int(y1 - y0)))
