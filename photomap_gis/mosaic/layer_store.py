"""A map's layers on disk: a file a tile that holds all of them, each written whole or not at all."""

from __future__ import annotations

import json
import math
import threading
import zlib
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.grid import MapGrid, TileIndex, Window
from photomap_gis.core.layer import LAYERS, Layer, empty
from photomap_gis.mosaic.tiles import write_atomically

LayerTile = dict[Layer, npt.NDArray[Any]]

_HEAD_FILE = "layers.json"
_CACHED_TILES = 4  # of some 8 MB; what is read row by row needs no more


class LayerStore:
    """A map's layers on disk, a file a tile; readable as ``core.layer.LayerSource``; safe among threads."""

    def __init__(self, folder: Path, grid: MapGrid) -> None:
        self._folder, self._grid = folder, grid
        self._lock = threading.Lock()
        self._decoded: OrderedDict[TileIndex, LayerTile] = OrderedDict()

    @classmethod
    def open(cls, folder: Path, grid: MapGrid, fingerprint: str) -> LayerStore:
        """Return the store in a folder; tiles that lie there stay only if their fingerprint is the same."""
        head = folder / _HEAD_FILE
        try:
            known = json.loads(head.read_text(encoding="utf-8"))["fingerprint"]
        except (OSError, ValueError, KeyError, TypeError):
            known = None
        try:
            if known != fingerprint:
                head.unlink(missing_ok=True)
                for path in folder.glob("*/*.layers"):
                    path.unlink()
                folder.mkdir(parents=True, exist_ok=True)
                write_atomically(head, json.dumps({"fingerprint": fingerprint}).encode())
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written ({error.strerror}); free some space") from error
        return cls(folder, grid)

    @property
    def grid(self) -> MapGrid:
        """The map's own grid."""
        return self._grid

    def done(self, tile: TileIndex) -> bool:
        """Whether the tile was written."""
        return self._path(tile).exists()

    def write(self, tile: TileIndex, layers: LayerTile) -> None:
        """Write a tile of all layers, whole or not at all."""
        data = b"".join(np.ascontiguousarray(layers[layer]).tobytes() for layer in LAYERS)
        path = self._path(tile)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, zlib.compress(data, 1))
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror}); free some space") from error

    def read(self, layer: Layer, window: Window) -> npt.NDArray[Any]:
        """``(bands, height, width)`` of the layer; its nodata where nothing is known, as beyond the grid."""
        out = empty(layer, window.height, window.width)
        g, size = self._grid, self._grid.tile_size
        left, right = max(window.col_off, 0), min(window.col_off + window.width, g.width)
        top, bottom = max(window.row_off, 0), min(window.row_off + window.height, g.height)
        for row in range(top // size, -(-bottom // size)):
            for col in range(left // size, -(-right // size)):
                tile = TileIndex(row, col)
                if not self.done(tile):
                    continue
                x, y, w, h = g.window(tile)
                x0, x1, y0, y1 = max(x, left), min(x + w, right), max(y, top), min(y + h, bottom)
                here = np.s_[:, y0 - window.row_off : y1 - window.row_off, x0 - window.col_off : x1 - window.col_off]
                out[here] = self._tile(tile)[layer][:, y0 - y : y1 - y, x0 - x : x1 - x]
        return out

    def _tile(self, tile: TileIndex) -> LayerTile:
        with self._lock:
            if tile in self._decoded:
                self._decoded.move_to_end(tile)
                return self._decoded[tile]
        layers = self._decode(tile)
        with self._lock:
            self._decoded[tile] = layers
            while len(self._decoded) > _CACHED_TILES:
                self._decoded.popitem(last=False)
        return layers

    def _decode(self, tile: TileIndex) -> LayerTile:
        path, window = self._path(tile), self._grid.window(tile)
        layers, at = {}, 0
        sizes = {k: len(s.bands) * window.height * window.width * np.dtype(s.dtype).itemsize for k, s in LAYERS.items()}
        try:
            data = zlib.decompressobj().decompress(path.read_bytes(), sum(sizes.values()) + 1)
            if len(data) != sum(sizes.values()):
                raise ValueError("not as long as it should be")
        except (OSError, ValueError, zlib.error) as error:
            raise DataError(f"{path}: damaged; remove it and ask for --layers again") from error
        for layer, spec in LAYERS.items():
            shape = (len(spec.bands), window.height, window.width)
            layers[layer] = np.frombuffer(data, spec.dtype, math.prod(shape), at).reshape(shape)
            at += sizes[layer]
        return layers

    def _path(self, tile: TileIndex) -> Path:
        return self._folder / f"{tile.row:05d}" / f"{tile.col:05d}.layers"
