"""Which ground has been seen: cells of the map, kept in blocks where there are any, so that its size is no matter."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.outline import distance_inside

_BLOCK = 128
_MOST_CELLS = 512  # a side: a frame from far above is looked at by no more cells than that

BoolArray = npt.NDArray[np.bool_]


class SeenGround:
    """A growing union of convex footprints, in cells of ``cell_m``."""

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._blocks: dict[tuple[int, int], BoolArray] = {}

    def add(self, hull_xy_map_m: FloatArray, *, least_new: float) -> int:
        """Add a footprint and return how many new cells it brought; -1, and nothing added, where it brings too few.

        ``least_new`` is the least share of its cells that must be new.
        """
        first = np.floor(hull_xy_map_m.min(axis=0) / self._cell_m).astype(int)
        last = np.floor(hull_xy_map_m.max(axis=0) / self._cell_m).astype(int)
        step = max(1, math.ceil(int(np.max(last - first)) / _MOST_CELLS))
        cols, rows = np.arange(first[0], last[0] + 1, step), np.arange(first[1], last[1] + 1, step)
        centres = np.stack(np.meshgrid(cols + 0.5, rows + 0.5), axis=-1).reshape(-1, 2) * self._cell_m
        inside = (distance_inside(hull_xy_map_m, centres) >= 0.0).reshape(len(rows), len(cols))
        if step > 1:
            inside = np.repeat(np.repeat(inside, step, axis=0), step, axis=1)
        new = sum(
            int(np.count_nonzero(inside[part] & ~self._blocks[key][cells])) if key in self._blocks
            else int(np.count_nonzero(inside[part]))
            for key, part, cells in _parts(int(first[1]), int(first[0]), inside.shape)
        )  # fmt: skip
        if new < least_new * np.count_nonzero(inside):
            return -1
        for key, part, cells in _parts(int(first[1]), int(first[0]), inside.shape):
            block = self._blocks.setdefault(key, np.zeros((_BLOCK, _BLOCK), dtype=bool))
            block[cells] |= inside[part]
        return new


def _parts(
    row: int, col: int, shape: tuple[int, ...]
) -> Iterator[tuple[tuple[int, int], tuple[slice, slice], tuple[slice, slice]]]:
    """Yield the blocks under a rectangle of cells: key, slices of the rectangle, slices of the block."""
    for block_row in range(row // _BLOCK, (row + shape[0] - 1) // _BLOCK + 1):
        top, bottom = max(row, block_row * _BLOCK), min(row + shape[0], (block_row + 1) * _BLOCK)
        for block_col in range(col // _BLOCK, (col + shape[1] - 1) // _BLOCK + 1):
            left, right = max(col, block_col * _BLOCK), min(col + shape[1], (block_col + 1) * _BLOCK)
            yield (
                (block_row, block_col),
                (slice(top - row, bottom - row), slice(left - col, right - col)),
                (
                    slice(top - block_row * _BLOCK, bottom - block_row * _BLOCK),
                    slice(left - block_col * _BLOCK, right - block_col * _BLOCK),
                ),
            )
