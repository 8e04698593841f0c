"""What a long export of tiles has finished, kept beside its output until that is there: a killed one goes on from it.

A piece is a branch of the pyramid: its tiles as they are stored, and the pixels of its top, of which its parents are
made. Pieces lie in a folder named by all that decides their bytes, so that another map, area or format finds none. They
are an aid: one that cannot be written or read is made again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import shutil
import threading
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import zstandard

from photomap_gis.export.encode import TileFormat
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.pyramid import Pyramid, TileKey
from photomap_gis.publish import SCRATCH_PREFIX

logger = logging.getLogger(__name__)

WORTH_TILES = 2000
"""Tiles of the finest zoom from which an export is long enough (half a minute) to keep pieces of it."""
_CHECKSUM_BYTES = 4
_HEAD_LIMIT = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class EncodedTile:
    """A tile as it is stored; its row is counted from the north."""

    key: TileKey
    format: TileFormat
    data: bytes


class Pieces:
    """The finished branches of one export in a folder; safe among threads."""

    def __init__(self, folder: Path, tile_px: int) -> None:
        self._folder, self._tile_px = folder, tile_px
        self._found = 0

    def find(self, key: TileKey) -> tuple[list[EncodedTile], Rgba | None] | None:
        """Return a branch's tiles and the pixels of its top (``None``: it shows nothing); ``None`` where not kept."""
        try:
            branch = _unpacked(self._path(key).read_bytes(), self._tile_px)
        except (OSError, ValueError, KeyError, TypeError, zstandard.ZstdError):
            return None
        if not self._found:
            logger.info("an export that was stopped is continued: its pieces lie in %s", self._folder)
        self._found += 1
        return branch

    def keep(self, key: TileKey, made: list[EncodedTile], top: Rgba | None) -> None:
        """Keep a finished branch, whole or not at all."""
        with contextlib.suppress(OSError):
            self._folder.mkdir(exist_ok=True)
            growing = self._folder / f"{os.getpid()}-{threading.get_ident()}.tmp"
            growing.write_bytes(_packed(made, top))
            growing.replace(self._path(key))

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key.zoom}-{key.x}-{key.y}.piece"


@contextlib.contextmanager
def kept_pieces(path: Path, source_key: str | None, pyramid: Pyramid, *what: object) -> Iterator[Pieces | None]:
    """Yield where an export to ``path`` keeps its pieces; ``None`` where it is short or ``source_key`` is unknown.

    ``source_key`` names the map's pixels and the program's version, ``what`` is everything else that decides a tile's
    bytes. The pieces go when the export is done or has failed; they stay where it was stopped.
    """
    if source_key is None or pyramid.leaf_count < WORTH_TILES:
        yield None
        return
    decides = (source_key, pyramid.extent, pyramid.min_zoom, pyramid.max_zoom, pyramid.keep_zoom, *what)
    digest = hashlib.sha256("|".join(map(str, decides)).encode()).hexdigest()[:20]
    folder = path.parent / f"{SCRATCH_PREFIX}pieces-{digest}"
    try:
        yield Pieces(folder, pyramid.tile_px)
    except Exception:  # not KeyboardInterrupt: who stops an export may want to go on
        shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder, ignore_errors=True)


def _packed(made: list[EncodedTile], top: Rgba | None) -> bytes:
    """Return a line of JSON (keys, formats and sizes), the tiles, the top's pixels, and a checksum of all of it."""
    tiles = [[*t.key, t.format.value, len(t.data)] for t in made]
    head = json.dumps({"tiles": tiles, "top": top is not None}).encode()
    pixels = b"" if top is None else zstandard.compress(np.ascontiguousarray(top).tobytes(), 1)
    body = b"".join([head, b"\n", *(t.data for t in made), pixels])
    return body + zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little")


def _unpacked(data: bytes, tile_px: int) -> tuple[list[EncodedTile], Rgba | None]:
    """Return what ``_packed`` was given; ``ValueError`` and its kin where it is not whole."""
    body = data[:-_CHECKSUM_BYTES]
    if zlib.crc32(body) != int.from_bytes(data[-_CHECKSUM_BYTES:], "little"):
        raise ValueError("the piece is damaged")
    at = body.index(b"\n", 0, _HEAD_LIMIT) + 1
    head = json.loads(body[:at])
    made = []
    for zoom, x, y, kind, size in head["tiles"]:
        made.append(EncodedTile(TileKey(zoom, x, y), TileFormat(kind), body[at : at + size]))
        at += size
    if not head["top"]:
        return made, None
    size = tile_px * tile_px * 4
    pixels = zstandard.decompress(body[at:], max_output_size=size)
    return made, np.frombuffer(pixels, np.uint8).reshape(tile_px, tile_px, 4)
