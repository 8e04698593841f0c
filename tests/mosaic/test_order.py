"""Tiles in an order in which a frame is decoded once, or nearly."""

import numpy as np

from photomap_gis.core.grid import TileIndex
from photomap_gis.mosaic.order import decodes, hilbert_index, in_best_order
from photomap_gis.mosaic.plan import TileJob


def test_hilbert_visits_every_cell_once_and_walks_to_neighbours():
    side = 16
    cells = sorted(((r, c) for r in range(side) for c in range(side)), key=lambda rc: hilbert_index(*rc, bits=4))
    assert [hilbert_index(r, c, bits=4) for r, c in cells] == list(range(side * side))
    steps = np.abs(np.diff(np.array(cells), axis=0)).sum(axis=1)
    assert (steps == 1).all()


def test_a_wide_map_is_not_walked_along_its_long_rows():
    """Each tile needs the frames around it; with memory for a column's worth, columns decode each frame about once."""
    jobs = [
        TileJob(TileIndex(r, c), frames := tuple(sorted({100 * y + x for y in (r, r + 1) for x in (c, c + 1)})), frames)
        for r in range(5)
        for c in range(40)
    ]
    ordered = in_best_order(jobs, frames_in_memory=16)
    assert sorted(job.tile for job in ordered) == [job.tile for job in jobs]
    assert decodes(ordered, 16) <= 1.05 * 6 * 41 < decodes(jobs, 16)


def test_nothing_to_order():
    assert in_best_order([], frames_in_memory=3) == []
