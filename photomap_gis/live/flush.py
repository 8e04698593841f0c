"""The canvas on disk as an ordinary map: tiles that changed are written whole, and the head says how far it goes.

Anybody may read it meanwhile: ``photomap export`` and ``photomap serve`` of the same folder work in mid flight.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import TileIndex
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.lattice import TILE_PX
from photomap_gis.mosaic.tile_codec import encode_source, encode_tile
from photomap_gis.mosaic.tiles import SOURCE, clear_tiles, tile_path, write_head


class CanvasFolder:
    """A canvas's folder of tiles; one owner."""

    def __init__(self, folder: Path, canvas: LiveCanvas, fingerprint: str) -> None:
        """Begin an empty map there."""
        self._folder, self._canvas, self._fingerprint = folder, canvas, fingerprint
        self._extent: tuple[int, int, int, int] | None = None
        clear_tiles(folder)

    def flush(self, revision: int) -> int:
        """Write the tiles that changed since the last time; return how many."""
        dirty = self._canvas.take_dirty()
        first = self._canvas.lattice.first_tile
        for done, (tile, rgba, shown) in enumerate(dirty):
            number = TileIndex(tile.row + first.row, tile.col + first.col)
            try:
                write_quickly(tile_path(self._folder, number, SOURCE), encode_source(shown))
                write_quickly(tile_path(self._folder, number), encode_tile(rgba))
            except OutputError:
                self._canvas.give_back(t for t, _, _ in dirty[done:])
                raise
        extent = _extent(self._canvas.tiles())
        if extent is not None and extent != self._extent:
            self._extent = extent
            top, left, bottom, right = extent
            g = self._canvas.lattice.grid
            side = TILE_PX * g.pixel_size
            grid = replace(
                g, west=g.west + left * side, north=g.north - top * side,
                width=(right - left + 1) * TILE_PX, height=(bottom - top + 1) * TILE_PX,
            )  # fmt: skip
            write_head(
                self._folder, grid, revision=revision, fingerprint=self._fingerprint,
                first_tile=TileIndex(top + first.row, left + first.col),
            )  # fmt: skip
        return len(dirty)


def _extent(tiles: Iterable[TileIndex]) -> tuple[int, int, int, int] | None:
    known = list(tiles)
    if not known:
        return None
    rows, cols = [t.row for t in known], [t.col for t in known]
    return min(rows), min(cols), max(rows), max(cols)


def write_quickly(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, but do not wait for the disk: a power cut may lose it, a killed session not."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror}); free some space") from error
