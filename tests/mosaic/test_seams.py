"""Seams go around what two frames see differently, are straight where all is even, and fit from tile to tile."""

import heapq

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.render import render_tile_and_sources
from photomap_gis.mosaic.seams import BAND, NOBODY, SLIVER_NODES, flood, flood_line, node_labels, without_slivers
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME, Flight, picture, place
from tests.mosaic.test_render import Source

SIDE = 68
EDGES = (2, SIDE - 2)
HALF = 100.0  # nodes
SIZES = {"half_diagonals_nodes": [HALF, HALF]}


def pictures(greys, roughness):
    """What frames show at the nodes that two of them contend for."""

    def look(contest):
        which = np.maximum(contest.two, 0).astype(int)
        return tuple(np.take_along_axis(np.stack(a).astype(np.float32), which, axis=0) for a in (greys, roughness))

    return look


def two_cells(tilt: float = 0.0) -> np.ndarray:
    """``(2, rows, columns)`` costs of two frames that meet along the middle."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    gap = (x - SIDE / 2 + tilt * (y - SIDE / 2)) * 2.0 * 0.4 / HALF  # of middles 0.4 half diagonals apart
    return np.stack([0.3 + gap / 2, 0.3 - gap / 2])


def flat(k: int = 2) -> list[np.ndarray]:
    return [np.full((SIDE, SIDE), 100.0, np.float32) for _ in range(k)]


def test_where_all_is_even_the_seam_is_where_both_cost_the_same():
    costs = two_cells(0.2)
    labels = node_labels(costs, pictures(flat(), flat()), edges=EDGES, **SIZES)
    inner = np.s_[2:-2, 2:-2]
    assert np.abs((labels == 0)[inner].sum(axis=1) - (costs[0] < costs[1])[inner].sum(axis=1)).max() <= 1


def test_a_roof_on_the_line_goes_to_one_frame_whole():
    a, b = flat()
    a[20:40, 30:38], b[20:40, 31:39] = 190.0, 150.0  # each frame sees another side of it
    rough = [np.where(g > 120, 20.0, 0.0).astype(np.float32) for g in (a, b)]
    labels = node_labels(two_cells(), pictures([a, b], rough), edges=EDGES, **SIZES)
    roof = labels[20:40, 30:39]
    assert (roof == roof[0, 0]).all()
    assert set(np.unique(labels)) == {0, 1}
    assert (node_labels(two_cells(), pictures(flat(), flat()), edges=EDGES, **SIZES)[20:40, 30:39] == 0).any(), (
        "else it would be cut"
    )


def test_the_seam_is_free_in_its_band_only():
    rng = np.random.default_rng(0)
    costs = two_cells()
    labels = node_labels(
        costs, pictures([g + rng.normal(0, 30, g.shape) for g in flat()], flat()), edges=EDGES, **SIZES
    )
    off = np.abs(np.arange(SIDE) - SIDE / 2) > BAND * HALF + 1
    assert np.array_equal(labels[:, off], costs.argmin(axis=0)[:, off])
    assert not np.array_equal(labels, costs.argmin(axis=0)), "in it a noise leads it astray"


def test_who_sees_nothing_gives_nothing():
    costs = two_cells()
    costs[0, :, 30:] = np.inf
    costs[:, :10] = np.inf
    labels = node_labels(costs, pictures(flat(), flat()), edges=EDGES, **SIZES)
    assert (labels[10:, 30:] == 1).all() and (labels[:10] == NOBODY).all()


def test_slivers_are_left_to_others_but_for_those_on_an_edge():
    labels = np.zeros((SIDE, SIDE), np.int16)
    labels[30, 30 : 30 + SLIVER_NODES - 1] = 1
    labels[50, 50 : 50 + SLIVER_NODES] = 2
    labels[2, 20] = 3
    labels[40, 40] = 4
    costs = np.zeros((5, SIDE, SIDE), np.float32) + np.arange(5, dtype=np.float32)[:, None, None]
    costs[:4, 40, 40] = np.inf  # nobody else sees it
    kept = without_slivers(labels, costs, EDGES)
    expected = labels.copy()
    expected[labels == 1] = 0
    assert np.array_equal(kept, expected)


def test_tiles_agree_along_their_common_edge():
    rng = np.random.default_rng(5)
    wide = 2 * (SIDE - 4) + 4
    y, x = np.mgrid[:SIDE, :wide].astype(np.float32)
    centres = rng.uniform((0, 0), (wide, SIDE), (6, 2))
    costs = np.stack([((x - cx) ** 2 + (y - cy) ** 2) / HALF**2 for cx, cy in centres]).astype(np.float32)
    grey = [100 + 40 * rng.random((SIDE, wide)).astype(np.float32) for _ in centres]
    left, right = (
        node_labels(
            costs[:, :, cut],
            pictures([g[:, cut] for g in grey], [g[:, cut] for g in grey]),
            edges=EDGES,
            half_diagonals_nodes=[HALF] * 6,
        )
        for cut in (np.s_[:SIDE], np.s_[SIDE - 4 :])
    )
    # The last four columns of the one are the first four of the other; those next to the edge are both tiles' own.
    assert np.array_equal(left[2:-2, -3:-1], right[2:-2, 1:3])


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(2, 9))
def test_the_flood_is_that_of_a_queue(seed, rows, cols):
    """A twin: nodes taken from a heap, lowest first; heights all different, so that there is one answer."""
    rng = np.random.default_rng(seed)
    height = rng.permutation(rows * cols).reshape(rows, cols).astype(np.float32)
    labels = rng.integers(-1, 3, (rows, cols)).astype(np.int16)
    free = rng.random((rows, cols)) < 0.6
    free[0, 0], labels[0, 0] = False, 1
    expected, waiting = labels.copy(), free.copy()
    queue: list = []

    def spread(r, c, label, level):
        for i, j in ((r, c - 1), (r, c + 1), (r - 1, c), (r + 1, c)):
            if 0 <= i < rows and 0 <= j < cols and waiting[i, j]:
                heapq.heappush(queue, (max(level, height[i, j]), -level, i, j, label))

    for r, c in np.argwhere(~free & (labels >= 0)):
        spread(r, c, labels[r, c], -1.0)
    got = flood(height, labels, free)
    reached = np.zeros_like(free)
    while queue:
        level, _, r, c, label = heapq.heappop(queue)
        if waiting[r, c]:
            waiting[r, c], expected[r, c], reached[r, c] = False, label, True
            spread(r, c, label, level)
    assert np.array_equal(got[~free], labels[~free])
    assert np.array_equal(got[free & ~reached], labels[free & ~reached])
    # Whom a node goes to is told by how high its way leads: equally high ways are equally good.
    for label in np.unique(got[reached]):
        assert label in labels[~free]
    best = lowest_pass(height, labels, free)
    for r, c in np.argwhere(reached):
        assert best[got[r, c]][r, c] == min(b[r, c] for b in best.values())


def lowest_pass(height, labels, free):
    """By label: ``(rows, cols)`` the least height over which each free node can be reached from one of its nodes."""
    out = {}
    for label in range(3):
        level = np.where(~free & (labels == label), -1.0, np.inf)
        for _ in range(height.size):
            wide = np.pad(level, 1, constant_values=np.inf)
            near = np.min([wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]], axis=0)
            better = np.where(free, np.minimum(level, np.maximum(near, height)), level)
            if np.array_equal(better, level):
                break
            level = better
        out[label] = level
    return out


@pytest.fixture(scope="module")
def leaning():
    """A flat ground with towers that lean away from each camera: 24 pixels high, by what 0.6 of a side does."""
    rng = np.random.default_rng(9)
    ground = np.full((400, 900, 3), 90, np.uint8)
    ground += rng.integers(0, 12, ground.shape, dtype=np.uint8)
    towers = [(int(x), int(y)) for x, y in rng.uniform((320, 60), (560, 330), (9, 2))]
    flight = Flight(ground, [], {})
    for frame, centre in enumerate((300.0, 580.0)):
        p = place(frame, centre * GSD_M, 190 * GSD_M, size=(520, 380))
        seen = ground.copy()
        for x, y in towers:
            lean = round((x - centre) * 0.08)
            seen[y - 7 : y + 7, x - 7 + lean : x + 7 + lean] = (40, 60, 210)
        flight.placements.append(p)
        flight.images[frame] = np.clip(np.rint(picture(seen, p)), 0, 255).astype(np.uint8)
    return flight, towers


def test_towers_are_not_cut_in_a_map(leaning):
    flight, towers = leaning
    views = views_of(flight.trajectory)
    grid = MapGrid("a CRS", *MAP_FRAME.to_crs([[0.0, 0.0]])[0], GSD_M, 900, 400)
    tile = render_tile_and_sources(
        Window(0, 0, 900, 400), grid, MAP_FRAME,
        givers=views, neighbours=views, source=Source(flight, GSD_M), exposure=Exposure({}),
    )  # fmt: skip
    red = (tile.rgba[..., 0] > 150) & (tile.rgba[..., 2] < 80)
    assert len(np.unique(tile.source[tile.source >= 0])) == 2
    areas = [int(red[y - 12 : y + 12, x - 40 : x + 40].sum()) for x, y in towers]
    assert min(areas) > 0.8 * 14 * 14, "a tower is missing or cut"


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(2, 20))
def test_along_a_line_the_flood_is_that_of_the_plane(seed, count):
    """A twin: the flood of an area one node high, heights all different."""
    rng = np.random.default_rng(seed)
    height = rng.permutation(count).astype(np.float32)
    labels, free = rng.integers(-1, 3, count).astype(np.int16), rng.random(count) < 0.7
    line, plane = flood_line(height, labels, free), flood(height[None], labels[None], free[None])[0]
    # A run's highest node may go either way: from both sides the way to it leads over itself.
    assert np.array_equal(line[~free], labels[~free])
    for k in np.flatnonzero(line != plane):
        start = k - next(n for n in range(k + 1) if k - n == 0 or not free[k - n - 1])
        stop = k + next(n for n in range(1, count - k + 1) if k + n == count or not free[k + n])
        assert height[k] == height[start:stop].max()
