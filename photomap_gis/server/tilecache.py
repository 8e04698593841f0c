"""Encoded tiles, kept while memory lasts: a page that pans back asks for what was made a moment ago."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from typing import NamedTuple

import numpy as np

from photomap_gis.export.encode import TileFormat, encode
from photomap_gis.export.webtiles import TILE_PX
from photomap_gis.server.missions import Snapshot

_MAX_BYTES = 96 << 20


class TileAddress(NamedTuple):
    """A tile of a layer of a mission at one epoch."""

    mission: str
    epoch: str
    layer: str
    zoom: int
    x: int
    y: int
    format: TileFormat


class TileCache:
    """Draws tiles, a few at a time, and keeps the newest; safe among threads."""

    def __init__(self, max_bytes: int = _MAX_BYTES) -> None:
        self._max_bytes = max_bytes
        self._held = 0
        self._tiles: OrderedDict[TileAddress, bytes] = OrderedDict()
        self._lock = threading.Lock()
        # More at once would only wait for each other, each with its window of the map in memory.
        self._drawing = threading.Semaphore(max(1, min(8, os.cpu_count() or 1)))
        self._empty = {f: encode(np.zeros((TILE_PX, TILE_PX, 4), np.uint8), f) for f in TileFormat}

    def get(self, snapshot: Snapshot, address: TileAddress) -> bytes:
        """Return the tile's bytes, wholly transparent where it shows nothing; ``KeyError``, ``UsageError`` if none."""
        with self._lock:
            if address in self._tiles:
                self._tiles.move_to_end(address)
                return self._tiles[address]
        with self._drawing:
            rgba = snapshot.layer(address.layer).tile(address.zoom, address.x, address.y)
            data = self._empty[address.format] if rgba is None else encode(rgba, address.format)
        with self._lock:
            if address not in self._tiles:
                self._tiles[address] = data
                self._held += len(data)
            while self._held > self._max_bytes:
                self._held -= len(self._tiles.popitem(last=False)[1])
        return data
