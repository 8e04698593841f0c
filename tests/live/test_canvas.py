"""The canvas: what a tile shows hangs on what was pasted on it, in which order; a part is the same as the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import FrameStatus, GpsFix
from photomap_gis.core.grid import MapFrame, TileIndex, Window
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.georef import choose_map_frame
from photomap_gis.live.canvas import NOBODY, LiveCanvas, sheet_of
from photomap_gis.live.flush import CanvasFolder
from photomap_gis.live.lattice import TILE_PX, LiveLattice, choose_lattice
from photomap_gis.live.light import Light
from photomap_gis.live.painter import Painter, Redrawn
from photomap_gis.mosaic import TileStore

W, H = 320, 200


def placement_at(x: float, y: float, angle: float = 0.0, scale: float = 1.0, frame: int = 0) -> FramePlacement:
    view = PlaneView.flat(Camera(W, H, 300.0))
    T = Similarity2D(x, y, angle, float(np.log(scale)))
    return FramePlacement(frame, W, H, PlanePlacement(view, T), np.eye(4), FrameStatus.REGISTERED)


def lattice() -> LiveLattice:
    return choose_lattice(MapFrame(None), placement_at(0.0, 0.0))


@pytest.fixture
def picture(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 255, (H, W, 3), np.uint8)


def test_a_frame_lies_where_its_placement_says(tmp_path: Path, picture: np.ndarray) -> None:
    """Pixel for pixel: on a lattice of its own pixels, shifted by whole ones, nothing is resampled."""
    canvas = LiveCanvas(lattice(), tmp_path)
    p = placement_at(-70.0 + (W - 1) / 2.0 + 0.5, 40.0 + (H - 1) / 2.0 + 0.5)
    sheet = sheet_of(p, picture, canvas.lattice, 0.0)
    assert sheet is not None
    canvas.paste(3, sheet)
    got = canvas.read(Window(-70, 40, W, H), lambda t: t.rgba(), 0)
    np.testing.assert_array_equal(got[..., :3], picture[..., ::-1])
    assert (got[..., 3] == 255).all()
    assert (canvas.read(Window(-70, 40, W, H), lambda t: t.shown, NOBODY) == 3).all()
    outside = canvas.read(Window(-72, 38, W + 4, H + 4), lambda t: t.rgba(), 0)
    assert (outside[0, :, 3] == 0).all() and (outside[:, -1, 3] == 0).all()


def test_a_clipped_sheet_is_a_part_of_the_whole(picture: np.ndarray) -> None:
    p = placement_at(33.3, -21.7, angle=0.4, scale=1.3)
    whole = sheet_of(p, picture, lattice(), 0.0)
    clip = Window(0, 0, TILE_PX, TILE_PX)
    part = sheet_of(p, picture, lattice(), 0.0, clip)
    assert whole is not None and part is not None
    y, x = part.window.row_off - whole.window.row_off, part.window.col_off - whole.window.col_off
    same = whole.rgb[y : y + part.window.height, x : x + part.window.width]
    np.testing.assert_array_equal(part.rgb, same)


def test_what_was_shed_comes_back(tmp_path: Path, picture: np.ndarray) -> None:
    wide = LiveCanvas(lattice(), tmp_path / "a", capacity=1000)
    tight = LiveCanvas(lattice(), tmp_path / "b", capacity=4)
    for k in range(6):
        sheet = sheet_of(placement_at(150.0 * k, 60.0 * k), picture, wide.lattice, float(k))
        assert sheet is not None
        wide.paste(k, sheet)
        tight.paste(k, sheet)
    window = Window(-300, -300, 1600, 1100)
    for what in (lambda t: t.rgba(), lambda t: t.shown, lambda t: t.seen_s):
        np.testing.assert_array_equal(wide.read(window, what, 0), tight.read(window, what, 0))


def test_drawn_anew_by_the_same_placements_is_the_same(tmp_path: Path, rng: np.random.Generator) -> None:
    images = {k: rng.integers(0, 255, (H, W, 3), np.uint8) for k in range(4)}
    done: list[Redrawn] = []
    painter = Painter(LiveCanvas(lattice(), tmp_path), lambda k: images[k], done.append)
    for k in images:
        painter.paste(k, placement_at(60.0 * k, 5.0 * k, frame=k), images[k], float(k))
    window = Window(-400, -400, 1100, 900)
    before = painter.canvas.read(window, lambda t: t.rgba(), 0)
    version = painter.canvas.version
    painter.redraw(painter.canvas.tiles(), sorted(images))
    np.testing.assert_array_equal(painter.canvas.read(window, lambda t: t.rgba(), 0), before)
    assert painter.canvas.version > version and len(done) == 1


def test_a_solution_moves_the_pixels(tmp_path: Path, rng: np.random.Generator) -> None:
    images = {k: rng.integers(0, 255, (H, W, 3), np.uint8) for k in range(2)}
    light = Light()  # a frame keeps the gain of its first pasting
    painter = Painter(LiveCanvas(lattice(), tmp_path), lambda k: images[k], light=light)
    for k in images:
        painter.paste(k, placement_at(100.0 * k, 0.0, frame=k), images[k], float(k))
    moved = painter.adopt(lambda k: placement_at(100.0 * k + 40.0, 7.0, frame=k), images)
    assert moved == pytest.approx(40.0)
    while painter.step():
        pass
    assert painter.is_idle
    fresh = Painter(LiveCanvas(lattice(), tmp_path / "fresh"), lambda k: images[k], light=light)
    for k in images:
        fresh.paste(k, placement_at(100.0 * k + 40.0, 7.0, frame=k), images[k], float(k))
    window = Window(-300, -300, 900, 700)
    np.testing.assert_array_equal(
        painter.canvas.read(window, lambda t: t.rgba(), 0), fresh.canvas.read(window, lambda t: t.rgba(), 0)
    )
    assert painter.adopt(lambda k: placement_at(100.0 * k + 40.2, 7.0, frame=k), images) == pytest.approx(0.2)
    assert painter.is_idle  # a fifth of a pixel draws nothing anew


def test_a_placement_that_makes_no_sense_is_not_pasted(tmp_path: Path, picture: np.ndarray) -> None:
    assert sheet_of(placement_at(0.0, 0.0, scale=1e5), picture, lattice(), 0.0) is None


def test_the_map_on_disk_grows_on_all_sides(tmp_path: Path, picture: np.ndarray) -> None:
    canvas = LiveCanvas(lattice(), tmp_path / "planes")
    folder = CanvasFolder(tmp_path / "mosaic", canvas, "live-1")
    for k, (x, y) in enumerate(((0.0, 0.0), (600.0, 300.0), (-700.0, -400.0))):
        sheet = sheet_of(placement_at(x, y), picture, canvas.lattice, float(k))
        assert sheet is not None
        canvas.paste(k, sheet)
        assert folder.flush(k) > 0
        store = TileStore(tmp_path / "mosaic")
        extent = canvas.extent()
        assert extent is not None and (store.grid.width, store.grid.height) == (extent.width, extent.height)
        np.testing.assert_array_equal(
            store.read(Window(0, 0, extent.width, extent.height)), canvas.read(extent, lambda t: t.rgba(), 0)
        )
    assert folder.flush(3) == 0
    assert (
        store.read_source(TileIndex(0, 0)) == canvas.read(Window(*extent[:2], 256, 256), lambda t: t.shown, -1)
    ).all()


def test_on_the_earth_the_lattice_is_that_of_web_tiles() -> None:
    frame = choose_map_frame([GpsFix(53.17, 8.65)])
    found = choose_lattice(frame, placement_at(12.0, -30.0, scale=0.1))
    world, side = 20037508.342789244, found.grid.pixel_size * TILE_PX
    assert found.georeferenced
    assert found.first_tile.col == pytest.approx((found.grid.west + world) / side, abs=1e-6)
    assert found.first_tile.row == pytest.approx((world - found.grid.north) / side, abs=1e-6)
    ground_m = found.grid.pixel_size * np.cos(np.radians(53.17))
    assert 0.1 / np.sqrt(2.0) < ground_m < 0.1 * np.sqrt(2.0)
    at = found.grid.to_px(found.frame.to_crs(np.array([[12.0, -30.0]])))[0]
    assert (at >= -1).all() and (at < TILE_PX + 1).all()
