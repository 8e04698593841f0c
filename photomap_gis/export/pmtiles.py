"""All tiles in one file that is read from any web server by ranges of bytes: PMTiles, version 3.

Specification: github.com/protomaps/PMTiles, spec/v3. Tiles lie in the order of a Hilbert curve through all zooms, equal
ones are stored once, and the directory tells runs of them in a few bytes.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from photomap_gis.core.errors import OutputError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.encode import TileFormat, parse_tile_choice
from photomap_gis.export.pieces import EncodedTile, kept_pieces
from photomap_gis.export.publish import file_in_place_of
from photomap_gis.export.pyramid import TileKey
from photomap_gis.export.webtiles import OnProgress, WebTiles, plan_web_tiles
from photomap_gis.export.words import MapWords

_HEADER_BYTES = 127
_ROOT_BYTES = 16384 - _HEADER_BYTES  # header and root directory are read at once
_TILE_TYPE = {TileFormat.PNG: 2, TileFormat.JPG: 3, TileFormat.WEBP: 4}
_GZIP, _PLAIN = 2, 1
_NO_WORDS = MapWords()


@dataclass(frozen=True, slots=True)
class Entry:
    """A run of ``run`` tiles from ``tile_id`` on that share their bytes; a leaf directory where ``run`` is 0."""

    tile_id: int
    offset: int
    length: int
    run: int


def write_pmtiles(
    source: TileSource,
    path: Path | str,
    *,
    min_zoom: int | None = None,
    max_zoom: int | None = None,
    gsd_m: float | None = None,
    area: Area | None = None,
    image_format: str = "auto",
    quality: int | None = None,
    words: MapWords = _NO_WORDS,
    source_key: str | None = None,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the archive and return how many tiles it holds; one ``image_format`` (png, webp, jpg; auto is png).

    ``source_key`` is as in ``write_tiles``.
    """
    path = Path(path).absolute()
    choice = parse_tile_choice(image_format, mixed=False)
    plan = plan_web_tiles(
        clipped(source, area), "PMTiles", min_zoom=min_zoom, max_zoom=max_zoom, gsd_m=gsd_m, area=area
    )
    with (
        kept_pieces(path, source_key, plan.pyramid, choice, quality) as pieces,
        file_in_place_of(path, lambda p: _check(p, path)) as temporary,
    ):
        pool = temporary.with_name("tiles")
        with pool.open("wb") as file:
            entries = _spool(plan.encoded(choice, quality, on_progress, pieces), file)
        if not entries:
            raise OutputError(f"{path} was not written: the map shows nothing")
        with pool.open("rb") as tiles, temporary.open("wb") as out:
            _assemble(plan, entries, tiles, out, _TILE_TYPE[TileFormat(choice.value)], words)
        pool.unlink()
    return len(entries)


def tile_id(key: TileKey) -> int:
    """Return the number of a tile: those of all wider zooms first, then along a Hilbert curve.

    >>> [tile_id(TileKey(*k)) for k in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0), (2, 0, 0))]
    [0, 1, 2, 3, 4, 5]
    """
    x, y, n = key.x, key.y, 1 << key.zoom
    if not (0 <= x < n and 0 <= y < n):
        raise ValueError(f"x and y must lie within zoom {key.zoom}, got {x}, {y}")
    place, side = ((1 << 2 * key.zoom) - 1) // 3, n >> 1
    while side:
        right, below = int(x & side > 0), int(y & side > 0)
        place += side * side * ((3 * right) ^ below)
        if not below:  # turn the quarter so that the curve goes on where the last one ended
            if right:
                x, y = n - 1 - x, n - 1 - y
            x, y = y, x
        side >>= 1
    return place


def _spool(tiles: Iterator[EncodedTile], file: IO[bytes]) -> list[Entry]:
    """Write every tile once, as they are made; return where each lies, in order of their numbers."""
    known: dict[bytes, tuple[int, int]] = {}
    entries, end = [], 0
    for tile in tiles:
        digest = hashlib.blake2b(tile.data, digest_size=16).digest()
        place = known.get(digest)
        if place is None:
            place = known[digest] = (end, len(tile.data))
            file.write(tile.data)
            end += len(tile.data)
        entries.append(Entry(tile_id(tile.key), *place, 1))
    return sorted(entries, key=lambda e: e.tile_id)


def _assemble(
    plan: WebTiles, spooled: Sequence[Entry], tiles: IO[bytes], out: IO[bytes], tile_type: int, words: MapWords
) -> None:
    """Write header, directories, metadata and the tiles in the order of their numbers."""
    moved: dict[int, int] = {}
    entries: list[Entry] = []
    order: list[tuple[int, int]] = []  # (offset in the pool, length) as they are to be copied
    end = 0
    for e in spooled:
        if e.offset not in moved:
            moved[e.offset] = end
            order.append((e.offset, e.length))
            end += e.length
        last = entries[-1] if entries else None
        if last is not None and last.tile_id + last.run == e.tile_id and last.offset == moved[e.offset]:
            entries[-1] = replace(last, run=last.run + 1)
        else:
            entries.append(Entry(e.tile_id, moved[e.offset], e.length, 1))
    root, leaves = _directories(entries)
    document = {
        "name": words.title, "description": words.paragraph, "attribution": words.attribution, "type": "overlay",
        **words.pairs,
    }  # fmt: skip
    metadata = gzip.compress(json.dumps(document, ensure_ascii=False).encode(), mtime=0)
    at_metadata = _HEADER_BYTES + len(root)
    at_leaves = at_metadata + len(metadata)
    at_tiles = at_leaves + len(leaves)
    lon, lat, zoom = plan.centre
    west, south, east, north = plan.bounds_deg
    out.write(
        b"PMTiles\x03"
        + struct.pack("<4Q", _HEADER_BYTES, len(root), at_metadata, len(metadata))
        + struct.pack("<4Q", at_leaves, len(leaves), at_tiles, end)
        + struct.pack("<3Q", len(spooled), len(entries), len(order))
        + struct.pack("<6B", 1, _GZIP, _PLAIN, tile_type, plan.min_zoom, plan.max_zoom)
        + struct.pack("<4i", *(round(v * 1e7) for v in (west, south, east, north)))
        + struct.pack("<B2i", zoom, round(lon * 1e7), round(lat * 1e7))
        + root + metadata + leaves
    )  # fmt: skip
    for offset, length in order:
        tiles.seek(offset)
        out.write(tiles.read(length))


def _directories(entries: Sequence[Entry]) -> tuple[bytes, bytes]:
    """Return the root directory and the leaves; the root is small enough to be read with the header."""
    root = _directory(entries)
    if len(root) <= _ROOT_BYTES:
        return root, b""
    size = 4096
    while True:
        leaves, pointers = bytearray(), []
        for i in range(0, len(entries), size):
            packed = _directory(entries[i : i + size])
            pointers.append(Entry(entries[i].tile_id, len(leaves), len(packed), 0))
            leaves += packed
        root = _directory(pointers)
        if len(root) <= _ROOT_BYTES:
            return root, bytes(leaves)
        size *= 2


def _directory(entries: Sequence[Entry]) -> bytes:
    out = bytearray(_varint(len(entries)))
    last = 0
    for e in entries:
        out += _varint(e.tile_id - last)
        last = e.tile_id
    for e in entries:
        out += _varint(e.run)
    for e in entries:
        out += _varint(e.length)
    follows = -1
    for e in entries:
        out += _varint(0 if e.offset == follows else e.offset + 1)
        follows = e.offset + e.length
    return gzip.compress(bytes(out), mtime=0)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _check(temporary: Path, path: Path) -> None:
    """Re-open the archive: its parts must fill the file, its directory and metadata must unpack."""
    try:
        with temporary.open("rb") as file:
            head = file.read(_HEADER_BYTES)
            offsets = struct.unpack_from("<8Q", head, 8)
            file.seek(offsets[0])
            gzip.decompress(file.read(offsets[1]))
            file.seek(offsets[2])
            json.loads(gzip.decompress(file.read(offsets[3])))
        whole = offsets[6] + offsets[7] == temporary.stat().st_size
    except (OSError, EOFError, ValueError, struct.error) as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
    if not whole:
        raise OutputError(f"{path} is cut short; check the disk")
