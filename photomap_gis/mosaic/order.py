"""In which order to render the tiles, so that frames, once decoded, are used while they are still in memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence

from photomap_gis.mosaic.plan import TileJob


def in_best_order(jobs: Sequence[TileJob], *, frames_in_memory: int) -> list[TileJob]:
    """Return the jobs in that one of some good orders in which the fewest frames are decoded twice."""
    if not jobs:
        return []
    side = max(max(job.tile.row, job.tile.col) for job in jobs) + 1
    bits = max(1, (side - 1).bit_length())
    keys: list[Callable[[TileJob], tuple[int, ...]]] = [
        lambda job: (job.tile.row, _to_and_fro(job.tile.row, job.tile.col)),
        lambda job: (job.tile.col, _to_and_fro(job.tile.col, job.tile.row)),
        lambda job: (hilbert_index(job.tile.row, job.tile.col, bits),),
        lambda job: (min(job.frames), max(job.frames), job.tile.row, job.tile.col),
    ]
    orders = [sorted(jobs, key=key) for key in keys]
    return min(orders, key=lambda order: decodes(order, frames_in_memory))


def decodes(jobs: Sequence[TileJob], frames_in_memory: int) -> int:
    """Return how often a frame is decoded when the last ``frames_in_memory`` used are kept."""
    held: OrderedDict[int, None] = OrderedDict()
    count = 0
    for job in jobs:
        for frame in job.frames:
            if frame in held:
                held.move_to_end(frame)
                continue
            count += 1
            held[frame] = None
            if len(held) > frames_in_memory:
                held.popitem(last=False)
    return count


def hilbert_index(row: int, col: int, bits: int) -> int:
    """Return the place of a cell along Hilbert's curve over ``2^bits`` cells a side."""
    index, x, y = 0, col, row
    for level in range(bits - 1, -1, -1):
        side = 1 << level
        right, down = int(bool(x & side)), int(bool(y & side))
        index += side * side * ((3 * right) ^ down)
        if not down:
            if right:
                x, y = side - 1 - (x & (side - 1)), side - 1 - (y & (side - 1))
            x, y = y, x
        x, y = x & (side - 1), y & (side - 1)
    return index


def _to_and_fro(line: int, place: int) -> int:
    return -place if line % 2 else place
