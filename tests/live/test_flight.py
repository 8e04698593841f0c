"""A whole flight: the loop places every frame, the map finds its place, the folder is a mission."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from photomap_gis.cli import main
from photomap_gis.core.grid import Window
from photomap_gis.live.landing import land
from photomap_gis.live.lattice import TILE_PX
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline import map_flight
from photomap_gis.simulate.evaluate import evaluate_map
from tests.live.conftest import Flown, frame_of, worst_error_m


@pytest.fixture(scope="module")
def landed(flown: Flown, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight by the command line, landed but not finalised."""
    folder = tmp_path_factory.mktemp("landed") / "mission"
    code = main(["live", str(flown.video), "-o", str(folder), "--as-fast-as-possible", "--no-finalise", "--json", "-q"])
    assert code == 0
    return folder


def test_every_frame_is_placed_and_the_map_finds_the_ground(fly, flown: Flown) -> None:
    flight = fly(frame_of(flown, k) for k in range(len(flown.refs)))
    tally = flight.session.loop.tally
    assert tally.frames == tally.tracked == len(flown.refs)
    assert tally.segments_begun == 0 and tally.intervals == []
    assert tally.snapped_at_s is not None and tally.snapped_at_s < 6.0
    chart = flight.session.loop.chart
    assert chart.map_frame.crs_wkt is not None
    assert worst_error_m(flight, flown) < 3.0 * flown.truth.gsd_m_per_px


def test_without_positions_the_map_is_relative_and_whole(fly, flown: Flown) -> None:
    flight = fly(
        frame_of(flown, k, fix=None, attitude=None, height_m=None, time_s=None) for k in range(len(flown.refs))
    )
    assert flight.session.loop.chart.map_frame.crs_wkt is None
    assert flight.session.loop.tracker.pieces == 1
    assert worst_error_m(flight, flown) < 6.0 * flown.truth.gsd_m_per_px


def test_the_map_on_disk_is_the_map_that_was_shown(landed: Path, tmp_path: Path) -> None:
    """In mid flight an export reads what the page shows: the same pixels, in the same place."""
    out = tmp_path / "mid.tif"
    assert main(["export", str(landed), "--geotiff", "--crs", "EPSG:3857", "-o", str(out), "-q"]) in (0, 2)
    import rasterio

    store = TileStore(landed / "mosaic")
    if not out.exists():
        assert main(["export", str(landed), "--geotiff", "--crs", "EPSG:3857", "-o", str(out)]) == 0
    with rasterio.open(out) as file:
        assert file.crs.to_epsg() == 3857
        g = store.grid
        assert file.transform.a == pytest.approx(g.pixel_size, rel=1e-9)
        x, y = (file.transform.c - g.west) / g.pixel_size, (g.north - file.transform.f) / g.pixel_size
        assert abs(x - round(x)) < 0.1 and abs(y - round(y)) < 0.1
        pixels = np.moveaxis(file.read(), 0, -1)
    shown = store.read(Window(round(x), round(y), pixels.shape[1], pixels.shape[0]))
    both = (shown[..., 3] > 0) & (pixels[..., -1] > 0)
    assert both.mean() > 0.3
    np.testing.assert_array_equal(shown[both][:, :3], pixels[both][:, :3])


def test_a_replay_gives_the_same_poses_and_pixels(landed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["replay", str(landed), "--json", "-q"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["same"] and result["pixels_equal"] is True
    assert result["largest_difference"] <= 1e-9 and result["poses"] > 100 and result["solutions"] > 3


def test_a_replay_tells_where_poses_differ(landed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(landed, copy)
    journal = copy / "live" / "journal.jsonl"
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    changed = next(line for line in lines if line.get("n") == 40)
    changed["pose"][0] += 1e-3
    journal.write_text("".join(json.dumps(line) + "\n" for line in lines))
    capsys.readouterr()
    assert main(["replay", str(copy), "--json", "-q"]) == 1
    assert json.loads(capsys.readouterr().out)["first_difference"] == 40


@pytest.mark.slow
def test_the_finished_map_is_as_good_as_that_of_the_recording(landed: Path, flown: Flown, tmp_path: Path) -> None:
    summary = land(landed, lambda stage, done, total: None)
    assert summary.georeferenced and summary.segments == 1
    ours = evaluate_map(landed / "map.tif", flown.folder / "truth")
    map_flight([flown.video], tmp_path / "mapped")
    theirs = evaluate_map(tmp_path / "mapped" / "map.tif", flown.folder / "truth")
    assert ours.relative_rmse_gsd <= 1.2 * theirs.relative_rmse_gsd
    assert ours.coverage >= theirs.coverage - 0.02
    assert main(["export", str(landed), "--poses", "-o", str(tmp_path / "poses.csv")]) == 0
    assert main(["live", "--resume", str(landed)]) == 2  # it has landed


def test_tiles_are_whole_ones_of_the_web(landed: Path) -> None:
    grid = TileStore(landed / "mosaic").grid
    side = grid.pixel_size * TILE_PX
    world = 20037508.342789244
    assert ((grid.west + world) / side) == pytest.approx(round((grid.west + world) / side), abs=1e-6)
    assert ((world - grid.north) / side) == pytest.approx(round((world - grid.north) / side), abs=1e-6)
