"""The render worker's work: key frames onto the canvas, and tiles drawn anew where a solution has moved them.

It owns no thread: ``do`` carries out one command or one step of a redrawing, so a key frame that comes meanwhile never
waits for long. What it did is journaled command by command; a replay that gives the same commands gets equal pixels.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photomap_gis.core.errors import PhotomapError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import TileIndex, Window
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.live.canvas import LiveCanvas, Sheet, TilePlanes, blend, shared, sheet_of, tiles_under
from photomap_gis.live.lattice import TILE_PX, LiveLattice
from photomap_gis.live.light import Light, brightened
from photomap_gis.live.outlines import Outlines, tiles_in

logger = logging.getLogger(__name__)

MOVED_PX, FAR_MOVED_PX = 0.5, 2.0
"""A key frame that a solution moves by more is drawn anew: near the drone, and elsewhere."""
NEAR_TILES = 6
BLOCK_TILES = 24
"""So many tiles at most are drawn anew at once."""
LOOK_MARGIN = 0.15
"""Looks that hang on a key frame may lie beyond it by such a share of it: they move with it."""

Placer = Callable[[int], FramePlacement]


@dataclass(frozen=True, slots=True, eq=False)
class Redrawn:
    """A command of the render journal: which tiles were drawn anew by which key frames."""

    tiles: tuple[TileIndex, ...]
    keys: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """The newest look, kept to be shown again where tiles are drawn anew."""

    key: int
    placement: FramePlacement
    image: ImageArray
    time_s: float
    gain: float = 1.0


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
        light: Light | None = None,
    ) -> None:
        self.canvas = canvas
        self._light = light or Light()
        self._pixels, self._on_redrawn = pixels, on_redrawn
        self._placements: dict[int, FramePlacement] = {}  # of key frames that the chart of before did not know
        self._placer: Placer | None = None
        self._times: dict[int, float] = {}
        self._latest_s = 0.0
        self._drawn, self._newest = Outlines(), Outlines()
        self._stale: set[TileIndex] = set()
        self._redrawing: _Redrawing | None = None
        self._focus: FloatArray = np.zeros(2)
        self._newest_look: _Look | None = None

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
        self._latest_s = max(self._latest_s, time_s)
        corners = self._corners(placement)
        self._newest[key] = self._drawn[key] = corners
        if np.isfinite(corners).all():
            self._focus = corners.mean(axis=0)
        sheet = self._sheet(key, image)
        if sheet is None:
            return False
        touched = self.canvas.paste(key, brightened(sheet, self._light.take(key, sheet, self.canvas)))
        if self._redrawing is not None and self._redrawing.tiles & set(touched):
            self._redrawing.keys.append(key)  # as kept: so will a replay draw it
        return bool(touched)

    def look(self, key: int, placement: FramePlacement, image: ImageArray, time_s: float) -> bool:
        """Paste a frame that hangs on a key frame and is none itself; return whether it lies on the map anywhere."""
        look = _Look(key, placement, image, time_s)
        sheet = self._sheet_of_look(look)
        if sheet is None:
            self._newest_look = look
            return False
        gain = self._light.of_look(key, sheet, self.canvas)
        self._newest_look = replace(look, gain=gain)
        return bool(self.canvas.paste(key, brightened(sheet, gain), is_look=True))

    def adopt(self, placer: Placer, keys: Iterable[int], known: int = 0) -> float:
        """Take new placements over; return by how many pixels the map moves most, near the newest key frame.

        Key frames below ``known`` are drawn as ``placer`` says from now on; ``keys`` are those that have moved.
        """
        pending = {} if self._redrawing is None else dict.fromkeys(self._redrawing.tiles)
        most = 0.0
        for key in keys:
            if key not in self._times:
                continue
            placement = placer(key)
            self._carry_look(key, placement)
            corners = self._corners(placement)
            self._newest[key] = corners
            if key >= known:
                self._placements[key] = placement
            if not np.isfinite(corners).all():
                continue
            near = self._is_near(corners)
            moved = float(np.abs(corners - self._drawn[key]).max())
            if near:
                most = max(most, moved)
            if moved > (MOVED_PX if near else FAR_MOVED_PX):
                self._stale.update(tiles_in(self._drawn[key], LOOK_MARGIN), tiles_in(corners))
                self._drawn[key] = corners  # as it will be: stale tiles are drawn by what is the newest then
        self._stale |= set(pending)
        self._redrawing = None
        self._placer = placer
        for key in [k for k in self._placements if k < known]:
            del self._placements[key]
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
            redrawing.take(key, self._bright_sheet(key, redrawing.clip))
            return True
        self._finish(redrawing)
        return bool(self._stale)

    def redraw(self, tiles: Iterable[TileIndex], keys: Sequence[int]) -> None:
        """Draw tiles anew by these key frames (a replay)."""
        redrawing = _Redrawing.of(tiles, keys)
        while redrawing.keys:
            key = redrawing.keys.popleft()
            redrawing.take(key, self._bright_sheet(key, redrawing.clip))
        self._finish(redrawing)

    def _begin(self, tiles: Sequence[TileIndex]) -> None:
        self._stale -= set(tiles)
        keys = [k for k in self._newest.over(tiles) if k in self._times]
        self._redrawing = _Redrawing.of(tiles, self._newest.uncrowded(keys))

    def _finish(self, redrawing: _Redrawing) -> None:
        self._redrawing = None
        self.canvas.replace(redrawing.fresh, redrawing.pasted)
        if self._newest_look is not None and self._newest_look.time_s >= self._latest_s:
            self._look_again(self._newest_look, redrawing)
        self._on_redrawn(Redrawn(tuple(sorted(redrawing.tiles)), tuple(redrawing.done)))

    def _look_again(self, look: _Look, redrawing: _Redrawing) -> None:
        """Show the newest look on tiles that were drawn anew by key frames."""
        sheet = self._sheet_of_look(look, redrawing.clip)
        if sheet is not None:
            self.canvas.paste(look.key, brightened(sheet, look.gain), is_look=True)

    def _sheet_of_look(self, look: _Look, clip: Window | None = None) -> Sheet | None:
        return sheet_of(look.placement, look.image, self.canvas.lattice, look.time_s, clip)

    def _carry_look(self, key: int, placement: FramePlacement) -> None:
        """Move the newest look as the key frame moves on which it hangs."""
        look = self._newest_look
        if look is None or look.key != key:
            return
        old, new, its = (p.camera_to_map for p in (self._placement(key), placement, look.placement))
        if isinstance(old, PlanePlacement) and isinstance(new, PlanePlacement) and isinstance(its, PlanePlacement):
            T = new.T_map_plane @ old.T_map_plane.inverse() @ its.T_map_plane
            self._newest_look = replace(
                look, placement=replace(look.placement, camera_to_map=replace(its, T_map_plane=T))
            )

    def _block(self) -> list[TileIndex]:
        """Return stale tiles that lie together, those near the drone first: they are what is looked at."""
        at = self._focus / TILE_PX
        nearest = min(self._stale, key=lambda t: (abs(t.row + 0.5 - at[1]) + abs(t.col + 0.5 - at[0]), t))
        around = sorted(
            self._stale, key=lambda t: (max(abs(t.row - nearest.row), abs(t.col - nearest.col)), t)
        )  # fmt: skip
        reach = NEAR_TILES
        return [t for t in around if max(abs(t.row - nearest.row), abs(t.col - nearest.col)) <= reach][:BLOCK_TILES]

    def _sheet(self, key: int, image: ImageArray | None, clip: Window | None = None) -> Sheet | None:
        try:
            pixels = self._pixels(key) if image is None else image
        except PhotomapError as error:
            logger.warning("%s", error)
            return None
        return sheet_of(self._placement(key), pixels, self.canvas.lattice, self._times[key], clip)

    def _placement(self, key: int) -> FramePlacement:
        known = self._placements.get(key)
        if known is not None:
            return known
        assert self._placer is not None  # it knows all others
        return self._placer(key)

    def _bright_sheet(self, key: int, clip: Window) -> Sheet | None:
        sheet = self._sheet(key, None, clip)
        return None if sheet is None else brightened(sheet, self._light.of(key))

    def _corners(self, placement: FramePlacement) -> FloatArray:
        """``(4, 2)`` the frame's corners in pixels of the lattice, clockwise from the first pixel's."""
        w, h = placement.width_px - 1.0, placement.height_px - 1.0
        xy = placement.camera_to_map.project(np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))
        lattice: LiveLattice = self.canvas.lattice
        return lattice.grid.to_px(lattice.frame.to_crs(xy))

    def _is_near(self, corners: FloatArray) -> bool:
        return bool(np.abs(corners.mean(axis=0) - self._focus).max() <= NEAR_TILES * TILE_PX)
