"""Where key frames lie on the canvas, as one array: an hour's flight has ten thousand, and all are asked at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import TileIndex
from photomap_gis.core.similarity import FloatArray
from photomap_gis.live.lattice import TILE_PX

CROWDED_SHARE, CROWDED_TURN_RAD = 0.18, 0.03
"""Drawn anew is, of key frames in a row that look the same way, only one in each such share of a frame."""
MOST_LOOKS = 12
"""A key frame is left out where each spot of it was seen by so many later ones."""
SAMPLE_PX = 32
"""Spots are looked at so far apart; a frame is held to see a little less, or a little more, than it does."""
_MOST_TILES = 64 * 16


class Outlines:
    """``(4, 2)`` corners of each key frame in pixels of the lattice, clockwise from the first pixel's; one owner."""

    def __init__(self) -> None:
        self._corners: FloatArray = np.full((64, 4, 2), np.nan)

    def __getitem__(self, key: int) -> FloatArray:
        """Return a key frame's corners, NaN where they are not known."""
        return self._corners[key]

    def __setitem__(self, key: int, corners: FloatArray) -> None:
        """Set a key frame's corners."""
        if key >= len(self._corners):
            more = np.full((max(key + 1, 2 * len(self._corners)) - len(self._corners), 4, 2), np.nan)
            self._corners = np.concatenate([self._corners, more])
        self._corners[key] = corners

    def over(self, tiles: Sequence[TileIndex]) -> list[int]:
        """Return the key frames whose boxes lie over any of some tiles, in their order."""
        rows, cols = np.array([t.row for t in tiles]), np.array([t.col for t in tiles])
        x0, y0, x1, y1 = _boxes(self._corners).T
        near = (x0 <= cols.max()) & (x1 > cols.min()) & (y0 <= rows.max()) & (y1 > rows.min())
        keys = np.flatnonzero(near)
        x0, y0, x1, y1 = (v[keys, None] for v in (x0, y0, x1, y1))
        inside = (x0 <= cols) & (cols < x1) & (y0 <= rows) & (rows < y1)
        return [int(k) for k in keys[inside.any(axis=1)]]

    def worth_drawing(self, keys: Sequence[int], tiles: Sequence[TileIndex]) -> list[int]:
        """Return those of some key frames that tiles are drawn anew by: few where many show the same ground.

        No spot is lost: what is left out is seen, at every sample in and next to it, by ``MOST_LOOKS`` later ones.
        """
        kept = self._uncrowded(keys)
        if len(kept) <= MOST_LOOKS:
            return kept
        spots = _spots(tiles)
        looks = np.zeros(len(spots), np.intp)
        wanted = []
        for key in reversed(kept):
            corners = self._corners[key]
            mine = _within(corners, spots, SAMPLE_PX)
            if mine.any() and not (looks[mine] < MOST_LOOKS).any():
                continue
            wanted.append(key)
            looks += _within(corners, spots, -SAMPLE_PX)
        return wanted[::-1]

    def _uncrowded(self, keys: Sequence[int]) -> list[int]:
        """Leave out key frames in a row that lie close to the last one that is kept."""
        kept: list[int] = []
        for n, key in enumerate(keys):
            if kept and key - 1 in keys[max(0, n - 1) : n] and n + 1 < len(keys) and keys[n + 1] == key + 1:
                a, b = self._corners[kept[-1]], self._corners[key]
                side = float(np.hypot(*(b[1] - b[0])))
                turn = abs(np.angle(complex(*(b[1] - b[0])) / complex(*(a[1] - a[0]))))
                apart = float(np.hypot(*(b.mean(axis=0) - a.mean(axis=0))))
                if apart < CROWDED_SHARE * side and turn < CROWDED_TURN_RAD:
                    continue
            kept.append(key)
        return kept


def tiles_in(corners: FloatArray, margin: float = 0.0) -> list[TileIndex]:
    """Return the tiles under the box around four corners, wider by a share of it on each side; none if it is absurd."""
    x0, y0, x1, y1 = (int(v) for v in _boxes(corners[None], margin)[0])
    if (x1 - x0) * (y1 - y0) > _MOST_TILES:
        return []
    return [TileIndex(r, c) for r in range(y0, y1) for c in range(x0, x1)]


def _boxes(corners: FloatArray, margin: float = 0.0) -> npt.NDArray[np.int64]:
    """``(n, 4)`` first column and row of tiles under ``(n, 4, 2)`` corners, and one beyond the last; none where NaN."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    more = margin * (high - low)
    tiles = np.concatenate(
        [np.floor(np.floor(low - more) / TILE_PX), np.ceil((np.ceil(high + more) + 1) / TILE_PX)], axis=1
    )
    known = np.isfinite(tiles).all(axis=1) & (np.abs(tiles) < 1e9).all(axis=1)
    return np.where(known[:, None], tiles, 0.0).astype(np.int64)


def _spots(tiles: Iterable[TileIndex]) -> FloatArray:
    """``(n, 2)`` samples of tiles, ``SAMPLE_PX`` apart."""
    at = (np.arange(TILE_PX // SAMPLE_PX) + 0.5) * SAMPLE_PX - 0.5
    one = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    return np.concatenate([one + np.array([t.col, t.row]) * TILE_PX for t in tiles])


def _within(corners: FloatArray, spots: FloatArray, margin_px: float) -> npt.NDArray[np.bool_]:
    """``(n,)`` whether spots lie within an outline widened by a margin (of a bent one: within its every side)."""
    along = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    turn = np.sign(along[0, 0] * along[1, 1] - along[0, 1] * along[1, 0]) or 1.0
    depth = np.einsum("nsk,sk->ns", spots[:, None] - corners, turn * normal)
    return np.asarray((depth >= -margin_px).all(axis=1))
