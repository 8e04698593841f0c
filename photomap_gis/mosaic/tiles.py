"""The map on disk: a grid and its tiles, each written whole or not at all, read by any window.

A tile that nobody wrote is empty. A folder belongs to one *plan* (grid, placements): its fingerprint tells whether
tiles that lie there still hold, so a run that was killed goes on where it stopped and never mixes two maps.
"""

from __future__ import annotations

import json
import os
import threading
import zlib
from collections import OrderedDict
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.grid import MapGrid, TileIndex, Window
from photomap_gis.mosaic.tile_codec import decode_source, decode_tile, encode_source, encode_tile

RgbaArray = npt.NDArray[np.uint8]
SourceArray = npt.NDArray[np.int32]

NOBODY = -1
"""In place of a frame's number where the map shows nothing."""

_FORMAT = 1
_GRID_FILE = "grid.json"
_CACHED_TILES = 24  # a megabyte each; who reads window by window needs one row of them
TILE, SOURCE = ".tile", ".from"
"""Ends of the names of a tile's files: its pixels, and which frame each of them shows."""
_OLD_TILE, _OLD_SOURCE = ".png", ".src"


class TileStore:
    """A folder of tiles, read as ``core.mosaic.TileSource``; safe among threads.

    ``grid.json`` says what the tiles are; ``<row>/<col>.tile`` is a tile, ``<row>/<col>.empty`` one that was rendered
    and shows nothing; ``<row>/<col>.from`` says which frame each of its pixels shows. Tiles as PNG, with ``.src``
    beside them, are read too: so older versions wrote them.
    """

    def __init__(self, folder: Path) -> None:
        """Open an existing store; ``DataError`` where the folder holds none."""
        self._folder = Path(folder)
        head = _read_head(self._folder)
        self._grid, self._revision, self._fingerprint = head
        self._first = _read_first(self._folder)
        self._lock = threading.Lock()
        self._decoded: OrderedDict[TileIndex, RgbaArray | None] = OrderedDict()
        self._made_rows: set[int] = set()

    @classmethod
    def create(cls, folder: Path, grid: MapGrid, *, revision: int, fingerprint: str = "") -> TileStore:
        """Open the store for writing; tiles that lie in the folder stay only if grid and fingerprint are the same."""
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not _holds(folder, grid, fingerprint):
                # The head goes first: were we killed now, no reader would take what is left for a map.
                (folder / _GRID_FILE).unlink(missing_ok=True)
                _remove_tiles(folder)
            for cut_short in folder.glob("*/*.tmp"):  # by a kill
                cut_short.unlink(missing_ok=True)
            write_atomically(folder / _GRID_FILE, _head_document(grid, revision, fingerprint))
        except OSError as error:
            raise _cannot_write(folder, error) from error
        return cls(folder)

    @property
    def folder(self) -> Path:
        """Where the tiles lie."""
        return self._folder

    @property
    def grid(self) -> MapGrid:
        """The map's grid."""
        return self._grid

    @property
    def revision(self) -> int:
        """The solution that the tiles show."""
        return self._revision

    @property
    def fingerprint(self) -> str:
        """What the tiles were made from."""
        return self._fingerprint

    def done(self, tile: TileIndex) -> bool:
        """Whether the tile was written, empty or not."""
        return any(self._path(tile, suffix).exists() for suffix in (TILE, ".empty", _OLD_TILE))

    def write(self, tile: TileIndex, rgba: RgbaArray, source: SourceArray | None = None) -> None:
        """Write a tile, ``(height, width, 4)`` RGBA of the size of the grid's window; whole or not at all.

        ``source`` is ``(height, width)``: the number of the frame that each pixel shows.
        """
        window = self._grid.window(tile)
        if rgba.shape != (window.height, window.width, 4) or rgba.dtype != np.uint8:
            raise ValueError(f"rgba must be uint8 {(window.height, window.width, 4)}, got {rgba.dtype} {rgba.shape}")
        seen = bool(rgba[..., 3].any())
        data = encode_tile(rgba) if seen else b""
        path, others = self._path(tile, TILE), (self._path(tile, ".empty"), self._path(tile, _OLD_TILE))
        if not seen:
            path, others = others[0], (path, others[1])
        try:
            if tile.row not in self._made_rows:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._made_rows.add(tile.row)
            if seen and source is not None:  # before the tile: where that lies, this does
                write_atomically(self._path(tile, SOURCE), encode_source(source))
            write_atomically(path, data)
            for other in others:
                other.unlink(missing_ok=True)
        except OSError as error:
            raise _cannot_write(path, error) from error
        with self._lock:
            self._decoded.pop(tile, None)

    def read(self, window: Window) -> RgbaArray:
        """``(height, width, 4)`` RGBA; alpha 0 where nothing was seen, as where the window overhangs the grid."""
        out = np.zeros((window.height, window.width, 4), dtype=np.uint8)
        size = self._grid.tile_size
        first_col, last_col = max(window.col_off, 0), min(window.col_off + window.width, self._grid.width)
        first_row, last_row = max(window.row_off, 0), min(window.row_off + window.height, self._grid.height)
        for row in range(first_row // size, -(-last_row // size)):
            for col in range(first_col // size, -(-last_col // size)):
                pixels = self._tile(TileIndex(row, col))
                if pixels is None:
                    continue
                x, y = col * size, row * size
                x0, x1 = max(x, first_col), min(x + pixels.shape[1], last_col)
                y0, y1 = max(y, first_row), min(y + pixels.shape[0], last_row)
                if x0 < x1 and y0 < y1:
                    out[y0 - window.row_off : y1 - window.row_off, x0 - window.col_off : x1 - window.col_off] = pixels[
                        y0 - y : y1 - y, x0 - x : x1 - x
                    ]
        return out

    def read_source(self, tile: TileIndex) -> SourceArray:
        """``(height, width)`` int32 the frame that each pixel of a tile shows; ``NOBODY`` where it shows nothing."""
        window = self._grid.window(tile)
        shape = (window.height, window.width)
        kept, path = (SOURCE, self._path(tile, SOURCE)), self._path(tile, TILE)
        if not path.exists():
            kept, path = (_OLD_SOURCE, self._path(tile, _OLD_SOURCE)), self._path(tile, _OLD_TILE)
        if not path.exists():
            return np.full(shape, NOBODY, dtype=np.int32)
        suffix, path = kept
        try:
            data = path.read_bytes()
        except FileNotFoundError as error:
            raise DataError(
                f"{self._folder}: this map was drawn by a version that did not note which frame shows what; "
                "draw it again by 'photomap solve MISSION'"
            ) from error
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error.strerror}); render the map again") from error
        source = decode_source(data, shape) if suffix == SOURCE else _decode_old_source(data, shape)
        if source is None:
            raise DataError(f"{path}: damaged; remove the folder and render the map again")
        return source

    def _tile(self, tile: TileIndex) -> RgbaArray | None:
        with self._lock:
            if tile in self._decoded:
                self._decoded.move_to_end(tile)
                return self._decoded[tile]
        pixels = self._decode(tile)
        with self._lock:
            self._decoded[tile] = pixels
            while len(self._decoded) > _CACHED_TILES:
                self._decoded.popitem(last=False)
        return pixels

    def _decode(self, tile: TileIndex) -> RgbaArray | None:
        window = self._grid.window(tile)
        shape = (window.height, window.width)
        for suffix, decode in ((TILE, decode_tile), (_OLD_TILE, _decode_old_tile)):
            path = self._path(tile, suffix)
            try:
                data = path.read_bytes()
            except FileNotFoundError:
                continue
            except OSError as error:
                raise DataError(f"{path}: cannot be read ({error.strerror}); render the map again") from error
            pixels = decode(data, shape)
            if pixels is None:
                raise DataError(f"{path}: the tile is damaged; remove it and render the map again")
            return pixels
        return None

    def _path(self, tile: TileIndex, suffix: str = TILE) -> Path:
        return tile_path(self._folder, TileIndex(tile.row + self._first.row, tile.col + self._first.col), suffix)


def tile_path(folder: Path, number: TileIndex, suffix: str = TILE) -> Path:
    """Return where a tile lies on disk; of a map that grows, ``number`` counts from ``first_tile`` of its head."""
    return folder / f"{number.row:05d}" / f"{number.col:05d}{suffix}"


def write_head(folder: Path, grid: MapGrid, *, revision: int, fingerprint: str, first_tile: TileIndex) -> None:
    """Say what the tiles of a map are that grows while it is read.

    Its files keep their numbers while the grid is cut out anew: ``first_tile`` is the number of the grid's first one.
    """
    head = json.loads(_head_document(grid, revision, fingerprint)) | {"first_tile": list(first_tile)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / _GRID_FILE, json.dumps(head, indent=1).encode())
    except OSError as error:
        raise _cannot_write(folder, error) from error


def clear_tiles(folder: Path) -> None:
    """Remove a map's tiles, its head first: no reader takes what is left for a map."""
    try:
        (folder / _GRID_FILE).unlink(missing_ok=True)
        if folder.is_dir():
            _remove_tiles(folder)
    except OSError as error:
        raise _cannot_write(folder, error) from error


def _decode_old_tile(data: bytes, shape: tuple[int, int]) -> RgbaArray | None:
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if pixels is None or pixels.ndim != 3 or pixels.dtype != np.uint8 or pixels.shape[:2] != shape:
        return None
    rgba: RgbaArray = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGBA if pixels.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)
    return rgba


def _decode_old_source(data: bytes, shape: tuple[int, int]) -> SourceArray | None:
    try:
        unpacked = zlib.decompressobj().decompress(data, 4 * shape[0] * shape[1] + 1)
        return np.frombuffer(unpacked, dtype="<i4").reshape(shape).astype(np.int32)
    except (ValueError, zlib.error):
        return None


def _read_head(folder: Path) -> tuple[MapGrid, int, str]:
    path = folder / _GRID_FILE
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["format"] != _FORMAT:
            raise DataError(f"{path}: written by another version of photomap; render the map again")
        return MapGrid(**document["grid"]), int(document["revision"]), str(document["fingerprint"])
    except OSError as error:
        raise DataError(f"{folder}: there is no rendered map here; run 'photomap map' first") from error
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: damaged; render the map again") from error


def _read_first(folder: Path) -> TileIndex:
    try:
        row, col = json.loads((folder / _GRID_FILE).read_text(encoding="utf-8")).get("first_tile", (0, 0))
        return TileIndex(int(row), int(col))
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{folder / _GRID_FILE}: damaged; render the map again") from error


def _holds(folder: Path, grid: MapGrid, fingerprint: str) -> bool:
    try:
        known_grid, _, known_fingerprint = _read_head(folder)
    except DataError:
        return False
    return known_grid == grid and known_fingerprint == fingerprint and _read_first(folder) == TileIndex(0, 0)


def _head_document(grid: MapGrid, revision: int, fingerprint: str) -> bytes:
    document: dict[str, Any] = {
        "format": _FORMAT, "revision": revision, "fingerprint": fingerprint, "grid": asdict(grid),
    }  # fmt: skip
    return json.dumps(document, indent=1).encode()


def _remove_tiles(folder: Path) -> None:
    """Remove the files that a store makes, and nothing else that may lie there."""
    for row in folder.iterdir():
        if not (row.is_dir() and row.name.isdigit()):
            continue
        for path in row.iterdir():
            if path.suffix in (TILE, SOURCE, ".empty", ".tmp", _OLD_TILE, _OLD_SOURCE):
                path.unlink()
        if not any(row.iterdir()):
            row.rmdir()


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written ({error.strerror}); free some space or choose another folder")
