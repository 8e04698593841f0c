"""One giver a pixel, from nodes to pixels; and what each frame has a share in, against counting pixel by pixel."""

import numpy as np
import pytest

from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapGrid
from photomap_gis.mosaic.cells import NOBODY, UNSETTLED, name_frames, shares_of
from photomap_gis.mosaic.drawing import ALONE, FEATHER_PX
from photomap_gis.mosaic.lattice import STEP_PX
from photomap_gis.mosaic.sighting import BORDER_PX
from tests.mosaic.flight import GSD_M, place
from tests.mosaic.looking import labels_of, look

GRID = MapGrid("a CRS", 500_000.0, 4_000_000.0, GSD_M, 400, 300, 512)


def inner(image):
    return image[STEP_PX : STEP_PX + GRID.height, STEP_PX : STEP_PX + GRID.width]


def test_each_spot_is_taken_from_the_frame_whose_centre_is_nearest():
    lattice, views, sights = look(GRID, place(0, 40, 35), place(1, 62, 40))
    labels = inner(labels_of(views, sights, lattice)[0])
    centres = np.array([[40, 35], [62, 40]]) / GSD_M - 0.5
    y, x = np.mgrid[: GRID.height, : GRID.width]
    nearest = np.argmin([np.hypot(x - cx, y - cy) for cx, cy in centres], axis=0)
    both = (abs(x - centres[:, :1, None]) < 114).all(axis=0) & (abs(y - centres[:, 1:, None]) < 84).all(axis=0)
    assert (labels == nearest)[both].mean() > 0.99


def test_registered_frames_win_and_gps_placed_ones_fill():
    lattice, views, sights = look(GRID, place(0, 50, 40, status=FrameStatus.GPS_ONLY), place(1, 70, 40))
    labels = inner(labels_of(views, sights, lattice)[0])
    registered, alone = (next(i for i, v in enumerate(views) if v.frame == f) for f in (1, 0))
    inside_registered = np.abs(np.arange(GRID.width) - (70 / GSD_M - 0.5)) < 119
    assert (labels[160, inside_registered] == registered).all()
    assert alone in labels[160, ~inside_registered]


def test_pixels_go_to_the_nearest_node_whose_frame_sees_them(rng):
    lattice, views, sights = look(GRID, place(0, 40, 35), place(1, 62, 40))
    at_nodes = np.argmin(np.where(np.isnan(sights[:, 2]), np.inf, sights[:, 2]), axis=0)
    labels, givers = labels_of(views, sights, lattice, at_nodes)
    share = lattice.dense((at_nodes == 1).astype(np.float32))
    border = [lattice.dense(np.nan_to_num(s[BORDER_PX], nan=-99)) for s in sights]
    deep = (np.min(border, axis=0) > 2) & (np.abs(share - 0.5) > 1e-3)
    assert deep.any() and np.array_equal(labels[deep], (share[deep] > 0.5).astype(int))
    nobody = np.max(border, axis=0) < -2
    assert nobody.any() and (labels[nobody] == NOBODY).all()
    one = (border[0] > 2) & (border[1] < -2)
    assert one.any() and (labels[one] == 0).all(), "whoever is nearest: only one sees it"
    for i, j in rng.integers((0, 0), givers.shape, (400, 2)):
        y, x = STEP_PX * i - STEP_PX // 2, STEP_PX * j - STEP_PX // 2
        found = np.unique(labels[max(y, 0) : y + STEP_PX, max(x, 0) : x + STEP_PX])
        assert givers[i, j] == (found[0] if len(found) == 1 else UNSETTLED)


@pytest.mark.parametrize("seed", range(4))
def test_shares_are_counted_pixel_by_pixel(seed):
    """A twin: windows of the whole picture of labels."""
    rng = np.random.default_rng(seed)
    rows, columns, count = 9, 12, 5
    givers = np.repeat(np.repeat(rng.integers(NOBODY, count, (3, 4)), 3, 0), 3, 1)[: rows - 1, : columns - 1]
    height, width = STEP_PX * (rows - 2), STEP_PX * (columns - 2)
    labels = np.repeat(np.repeat(givers, STEP_PX, 0), STEP_PX, 1)[STEP_PX // 2 :, STEP_PX // 2 :][:height, :width]
    labels = np.ascontiguousarray(labels.astype(np.int16))
    givers = givers.astype(np.int16)
    for i, j in rng.integers((0, 0), givers.shape, (8, 2)):
        y, x = max(STEP_PX * i - STEP_PX // 2, 0), max(STEP_PX * j - STEP_PX // 2, 0)
        part = labels[y : STEP_PX * i + STEP_PX // 2, x : STEP_PX * j + STEP_PX // 2]
        part[rng.random(part.shape) < 0.3] = rng.integers(NOBODY, count)
        givers[i, j] = UNSETTLED
    box = (STEP_PX + 1, STEP_PX, width - 2 * STEP_PX - 4, height - 2 * STEP_PX)
    cells, slots, starts, slot_cells = shares_of(labels, givers, count, *box)
    expected: dict[int, list[int]] = {k: [] for k in range(count)}
    mixed = set()
    for i in range(rows - 1):
        for j in range(columns - 1):
            y0, y1 = (max(STEP_PX * i - 4, box[1]), min(STEP_PX * i + 4, box[1] + box[3]))
            x0, x1 = (max(STEP_PX * j - 4, box[0]), min(STEP_PX * j + 4, box[0] + box[2]))
            if y1 <= y0 or x1 <= x0:
                continue
            found = set(
                np.unique(labels[y0 - FEATHER_PX : y1 + FEATHER_PX, x0 - FEATHER_PX : x1 + FEATHER_PX]).tolist()
            )
            for k in found - {NOBODY}:
                expected[k].append(i * (columns - 1) + j)
            if len(found) > 1:
                mixed.add(i * (columns - 1) + j)
    for k in range(count):
        mine = slice(starts[k], starts[k + 1])
        assert cells[mine].tolist() == expected[k]
        for cell, slot in zip(cells[mine].tolist(), slots[mine].tolist(), strict=True):
            assert slot_cells[slot] == cell if cell in mixed else slot == ALONE
    assert sorted(slot_cells.tolist()) == sorted(mixed & {c for v in expected.values() for c in v})


def test_labels_are_named_by_their_frames():
    labels = np.array([[0, 1, -1], [2, 2, 0]], np.int16)
    out = np.empty((2, 2), np.int32)
    name_frames(labels, np.array([7, 300, 9, -1], np.int32), 1, 0, out)
    assert out.tolist() == [[300, -1], [9, 7]]
