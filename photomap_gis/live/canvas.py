"""The live map's pixels: key frames pasted in the order in which they came, each resampled once.

A spot is shown by the frame that looks at it nearest to its middle; a frame that comes later is worth a little more, so
that what is shown is new where it is equally good. Where two meet, they are feathered. What a tile shows hangs only on
which frames were pasted on it, in which order, by which placements.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import TileIndex, Window
from photomap_gis.core.placement import FramePlacement
from photomap_gis.live.blending import DRAWN, FEATHER, blend_pixels
from photomap_gis.live.lattice import TILE_PX, LiveLattice
from photomap_gis.mosaic.lattice import Box, Lattice

STEP_PX = 16
WORTH_A_SECOND = 0.004
"""A frame a minute newer may be a quarter of its half diagonal further from its middle and is shown still."""
RIM_SHARE = 0.06
LOOK_LEAD = FEATHER / 2.0
"""By so much a look may be worth less than what is shown and be shown still, in part."""
IN_MEMORY = 128
"""Tiles held, each 1.2 megabytes; more where a single frame lies on more."""
MOST_PIXELS = 24_000_000
"""A frame that would cover more of the map is not where it is believed to be."""
MIN_GSD_RATIO, MAX_GSD_RATIO = 0.2, 5.0
NOBODY = -1

IntImage = npt.NDArray[np.int32]
FloatImage = npt.NDArray[np.float32]


@dataclass(slots=True, eq=False)
class TilePlanes:
    """A tile: ``rgb`` ``(t, t, 3)``, its ``worth``, the key frame ``shown``, when it was seen last, the best ``gsd``.

    ``shown`` is, of a look between two key frames, the key frame on which it hangs; ``seen_s`` is of the stream.
    """

    rgb: ImageArray
    worth: FloatImage
    shown: IntImage
    seen_s: FloatImage
    gsd: FloatImage

    @classmethod
    def blank(cls) -> TilePlanes:
        """Return a tile that shows nothing."""
        side = (TILE_PX, TILE_PX)
        return cls(
            np.zeros((*side, 3), np.uint8),
            np.full(side, -np.inf, np.float32),
            np.full(side, NOBODY, np.int32),
            np.full(side, -np.inf, np.float32),
            np.full(side, np.inf, np.float32),
        )

    @property
    def seen(self) -> npt.NDArray[np.bool_]:
        """``(t, t)`` where something is shown."""
        return self.shown != NOBODY

    def rgba(self) -> ImageArray:
        """Return the picture with its transparency."""
        out = np.empty((TILE_PX, TILE_PX, 4), np.uint8)
        out[..., :3] = self.rgb
        out[..., 3] = np.where(self.seen, 255, 0)
        return out


class Sheet(NamedTuple):
    """A frame in the map's pixels: window, ``(h, w, 3)`` RGB, where it has ground, and its worth there."""

    window: Window
    rgb: ImageArray
    inside: npt.NDArray[np.uint8]
    worth: FloatImage
    gsd: float
    time_s: float


def sheet_of(
    placement: FramePlacement, image: ImageArray, lattice: LiveLattice, time_s: float, clip: Window | None = None
) -> Sheet | None:
    """Return a frame drawn on the lattice, within ``clip``; ``None`` where there is nothing or it makes no sense.

    The nodes of the lattice are those of whole tiles, so that a part of a frame has the pixels of the whole.
    """
    grid = lattice.grid
    outline = placement.outline_xy_map_m()
    if len(outline) < 3:
        return None
    px = grid.to_px(lattice.frame.to_crs(outline))
    if not np.isfinite(px).all():
        return None
    (x0, y0), (x1, y1) = np.floor(px.min(axis=0)).astype(int) - 1, np.ceil(px.max(axis=0)).astype(int) + 2
    gsd = placement.gsd_m_per_px
    if (x1 - x0) * (y1 - y0) > MOST_PIXELS or not np.isfinite(gsd):
        return None
    if clip is not None:
        x0, y0 = max(int(x0), clip.col_off), max(int(y0), clip.row_off)
        x1, y1 = min(int(x1), clip.col_off + clip.width), min(int(y1), clip.row_off + clip.height)
        if x1 <= x0 or y1 <= y0:
            return None
    x0, y0 = (int(v) // STEP_PX * STEP_PX for v in (x0, y0))
    x1, y1 = (-(-int(v) // STEP_PX) * STEP_PX for v in (x1, y1))
    window = Window(x0, y0, x1 - x0, y1 - y0)
    nodes = Lattice.over(window, grid, lattice.frame, step_px=STEP_PX)
    xy = placement.camera_to_map.unproject(nodes.nodes_xy_map_m).reshape(*nodes.shape, 2)
    xy = np.where(np.isfinite(xy), xy, -1e5)
    half = (np.array([placement.width_px, placement.height_px]) - 1.0) / 2.0
    worth = 1.0 + WORTH_A_SECOND * time_s - np.hypot(*(xy - half).transpose(2, 0, 1)) / np.hypot(*half)
    box = Box(STEP_PX, STEP_PX, window.width, window.height)
    at = nodes.dense(xy.astype(np.float32), box)
    inside = cv2.inRange(at, (0.0, 0.0), tuple(2.0 * half))
    h, w = image.shape[:2]
    if (w, h) != (placement.width_px, placement.height_px):
        scale = np.array([w / placement.width_px, h / placement.height_px])
        at = nodes.dense(((xy + 0.5) * scale - 0.5).astype(np.float32), box)
    source = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    bgr = cv2.remap(source, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return Sheet(
        window, cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), inside, nodes.dense(worth.astype(np.float32), box), gsd, time_s
    )


class LiveCanvas:
    """The tiles of one lattice: the newest in memory, the others on disk; one writer, readers in any thread."""

    def __init__(self, lattice: LiveLattice, folder: Path, *, capacity: int = IN_MEMORY) -> None:
        self.lattice = lattice
        self._folder, self._capacity = folder, capacity
        self._tiles: OrderedDict[TileIndex, TilePlanes] = OrderedDict()
        self._stored: set[TileIndex] = set()
        self._dirty: set[TileIndex] = set()
        self._changed: set[TileIndex] = set()
        self._versions: dict[TileIndex, int] = {}
        self._seen: dict[TileIndex, int] = {}
        self._version = 0
        self._lock = threading.RLock()

    @property
    def version(self) -> int:
        """Grows with every change."""
        return self._version

    def tiles(self) -> list[TileIndex]:
        """Return the tiles that show something."""
        with self._lock:
            return sorted(self._versions)

    def version_of(self, tile: TileIndex) -> int:
        """Return the version at which a tile changed last, 0 where it shows nothing."""
        return self._versions.get(tile, 0)

    def paste(self, key: int, sheet: Sheet, *, is_look: bool = False) -> tuple[TileIndex, ...]:
        """Paste a frame; return the tiles that it lies on.

        A look shows what is there now: it is shown wherever it is as good as what was shown, and not drawn anew.
        """
        touched: list[TileIndex] = []
        lead = LOOK_LEAD if is_look else 0.0
        w = sheet.window
        under = tiles_under(w)
        with self._lock:
            self._version += 1
            self._capacity = max(self._capacity, len(under) * 5 // 4)
            for tile in under:
                here, there = shared(w, tile)
                if not sheet.inside[here].any():
                    continue
                if blend(self._planes(tile), there, sheet, here, key, lead) & DRAWN:
                    self._versions[tile] = self._version
                    self._dirty.add(tile)
                    self._changed.add(tile)
                self._seen[tile] = self._version
                if not is_look:
                    self._changed.add(tile)  # when it was seen last has changed
                touched.append(tile)
        return tuple(touched)

    def replace(self, fresh: Mapping[TileIndex, TilePlanes], pasted: Mapping[TileIndex, list[int]]) -> None:
        """Put tiles that were drawn anew in the place of the old ones, all at once."""
        with self._lock:
            self._version += 1
            for tile, planes in fresh.items():
                if not pasted[tile] and tile not in self._versions:
                    continue
                self._tiles[tile] = planes
                self._tiles.move_to_end(tile)
                self._dirty.add(tile)
                self._changed.add(tile)
                self._versions[tile] = self._seen[tile] = self._version
            self._shed()

    def window_of(self, tile: TileIndex) -> Window:
        """Return the pixels of a tile."""
        return Window(tile.col * TILE_PX, tile.row * TILE_PX, TILE_PX, TILE_PX)

    def extent(self) -> Window | None:
        """Return the window of whole tiles that may show something."""
        with self._lock:
            if not self._versions:
                return None
            rows, cols = [t.row for t in self._versions], [t.col for t in self._versions]
        top, left = min(rows), min(cols)
        return Window(left * TILE_PX, top * TILE_PX, (max(cols) - left + 1) * TILE_PX, (max(rows) - top + 1) * TILE_PX)

    def version_in(self, window: Window, *, seen: bool = False) -> int:
        """Return the newest version of any tile in a window; with ``seen`` of when and how well it was seen, too."""
        versions = self._seen if seen else self._versions
        under = tiles_under(window)
        if len(under) <= len(versions):
            return max((versions.get(t, 0) for t in under), default=0)
        inside = set(under)
        with self._lock:
            return max((v for t, v in versions.items() if t in inside), default=0)

    def read(self, window: Window, what: Callable[[TilePlanes], npt.NDArray[np.generic]], blank: float) -> np.ndarray:
        """Return a window of what a function makes of each tile's planes, ``blank`` where nothing was seen."""
        out: np.ndarray | None = None
        for tile in tiles_under(window):
            with self._lock:
                if tile not in self._versions:
                    continue
                values = what(self._planes(tile))
            if out is None:
                out = np.full((window.height, window.width, *values.shape[2:]), blank, values.dtype)
            here, there = shared(window, tile)
            out[here] = values[there]
        if out is None:
            sample = what(TilePlanes.blank())
            out = np.full((window.height, window.width, *sample.shape[2:]), blank, sample.dtype)
        return out

    def take_changed(self) -> list[TileIndex]:
        """Return the tiles whose pixels changed since the last call, for those who watch."""
        with self._lock:
            changed = sorted(self._changed)
            self._changed.clear()
            return changed

    def take_dirty(self) -> list[tuple[TileIndex, ImageArray, IntImage]]:
        """Return the tiles that changed since the last call: pictures, and which key frame each pixel shows."""
        with self._lock:
            dirty = sorted(self._dirty)
            self._dirty.clear()
            return [(t, (p := self._planes(t)).rgba(), p.shown.copy()) for t in dirty]

    def give_back(self, tiles: Iterable[TileIndex]) -> None:
        """Take tiles for changed again: they could not be written."""
        with self._lock:
            self._dirty.update(tiles)

    def under(self, window: Window, stride_px: int) -> Iterator[tuple[TilePlanes, Slices, Slices]]:
        """Yield the tiles that show something in a window: planes, and which pixels of them are which of the window.

        Every ``stride_px``-th of them; the window begins at a multiple of that. For the one who writes.
        """
        for tile in tiles_under(window):
            with self._lock:
                if tile not in self._versions:
                    continue
                planes = self._planes(tile)
            here, there = (tuple(slice(s.start, s.stop, stride_px) for s in part) for part in shared(window, tile))
            yield planes, (there[0], there[1]), (here[0], here[1])

    def _planes(self, tile: TileIndex) -> TilePlanes:
        planes = self._tiles.get(tile)
        if planes is None:
            planes = self._load(tile) if tile in self._stored else TilePlanes.blank()
            self._tiles[tile] = planes
            self._shed()
        self._tiles.move_to_end(tile)
        return planes

    def _shed(self) -> None:
        while len(self._tiles) > self._capacity:
            tile, planes = self._tiles.popitem(last=False)
            if tile in self._versions:
                self._folder.mkdir(parents=True, exist_ok=True)
                np.savez(
                    self._path(tile), rgb=planes.rgb, worth=planes.worth, shown=planes.shown, seen_s=planes.seen_s,
                    gsd=planes.gsd,
                )  # fmt: skip
                self._stored.add(tile)

    def _load(self, tile: TileIndex) -> TilePlanes:
        with np.load(self._path(tile)) as kept:
            return TilePlanes(kept["rgb"], kept["worth"], kept["shown"], kept["seen_s"], kept["gsd"])

    def _path(self, tile: TileIndex) -> Path:
        first = self.lattice.first_tile
        return self._folder / f"{tile.row + first.row}-{tile.col + first.col}.npz"


def tiles_under(window: Window) -> list[TileIndex]:
    """Return the tiles under a window of the lattice."""
    rows = range(window.row_off // TILE_PX, -(-(window.row_off + window.height) // TILE_PX))
    cols = range(window.col_off // TILE_PX, -(-(window.col_off + window.width) // TILE_PX))
    return [TileIndex(r, c) for r in rows for c in cols]


Slices = tuple[slice, slice]


def shared(window: Window, tile: TileIndex) -> tuple[Slices, Slices]:
    """Return which pixels of a window are which of a tile."""
    x, y = tile.col * TILE_PX, tile.row * TILE_PX
    x0, x1 = max(x, window.col_off), min(x + TILE_PX, window.col_off + window.width)
    y0, y1 = max(y, window.row_off), min(y + TILE_PX, window.row_off + window.height)
    here = np.s_[y0 - window.row_off : y1 - window.row_off, x0 - window.col_off : x1 - window.col_off]
    return here, np.s_[y0 - y : y1 - y, x0 - x : x1 - x]


def blend(planes: TilePlanes, there: Slices, sheet: Sheet, here: Slices, key: int, lead: float = 0.0) -> int:
    """Paste a part of a frame on a part of a tile; return ``LAID`` and ``DRAWN`` as bits."""
    return blend_pixels(
        planes.rgb[there], planes.worth[there], planes.shown[there], planes.seen_s[there], planes.gsd[there],
        sheet.rgb[here], sheet.inside[here], sheet.worth[here], key, sheet.time_s, sheet.gsd, lead,
    )  # fmt: skip
