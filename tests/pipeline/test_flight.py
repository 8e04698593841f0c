"""The whole corridor on small simulated flights: maps, missions that resume and grow, and what they tell."""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from PIL import Image

from photomap_gis.core.errors import DataError, NotGeoreferencedError, OutputError, UsageError
from photomap_gis.pipeline import Format, MapSettings, export_mission, map_flight
from photomap_gis.pipeline.formats import DEFAULT_NAMES
from photomap_gis.simulate.evaluate import evaluate_map


def strip_gps(folder: Path, out: Path) -> Path:
    """Copy photos without any metadata."""
    out.mkdir()
    for photo in sorted(folder.glob("*.JPG")):
        with Image.open(photo) as picture:
            picture.save(out / photo.name, quality=92)
    return out


def read_rgba(path: Path) -> np.ndarray:
    with rasterio.open(path) as raster:
        return raster.read()


def test_the_map_lies_where_the_truth_is(flown, mapped):
    s = mapped.summary
    assert s.frames["registered"] == s.frames["total"] == 14
    assert s.georeferenced
    assert s.crs == "EPSG:32632"
    assert s.segments == 1
    assert s.registrations["sequential"] == 13
    assert s.registrations["loop"] > 5
    errors = evaluate_map(s.map, flown.truth.folder)
    assert errors.coverage > 0.98
    assert errors.unmatched_share <= 0.02
    assert errors.relative_rmse_gsd < 5
    assert errors.absolute_rmse_m < 1.15 * errors.floor_rmse_m + 0.5


def test_the_document_keeps_the_contract(mapped):
    document = json.loads(json.dumps(mapped.summary.as_document()))
    assert {
        "mission", "map", "crs", "georeferenced", "gsd_m_per_px", "area_m2", "frames", "registrations", "segments",
        "fit_to_gps_rms_m", "predicted_ce90_m", "seconds", "warnings",
    } <= document.keys()  # fmt: skip
    statuses = {"total", "registered", "gps_only", "oblique", "error_frame", "unplaced"}
    assert document["frames"].keys() == statuses
    assert document["registrations"].keys() == {"sequential", "loop"}
    assert sum(n for s, n in document["frames"].items() if s != "total") == document["frames"]["total"]
    assert document["predicted_ce90_m"] > 0


def test_every_format_is_written_from_the_mission_alone(flown, mapped, tmp_path):
    """The photos are gone: the mission folder holds all that an export needs."""
    folder = tmp_path / "mission"
    shutil.copytree(mapped.folder, folder)
    frames = folder / "frames.jsonl"
    frames.write_text(frames.read_text().replace(str(flown.photos), "/gone"))
    written = export_mission(folder, list(Format), out=tmp_path / "out")
    beside = {"map.pgw", "map.prj"}
    assert {p.name for p in written} == set(DEFAULT_NAMES.values()) | beside
    assert all(p.exists() for p in written)
    np.testing.assert_array_equal(read_rgba(tmp_path / "out" / "map.tif"), read_rgba(folder / "map.tif"))


def test_one_format_names_a_file_and_its_suffix_decides(mapped, tmp_path):
    assert export_mission(mapped.folder, [Format.POSES], out=tmp_path / "p.geojson") == [tmp_path / "p.geojson"]
    assert json.loads((tmp_path / "p.geojson").read_text())["type"] == "FeatureCollection"
    with pytest.raises(UsageError, match="must end in"):
        export_mission(mapped.folder, [Format.GEOTIFF], out=tmp_path / "map.png")
    (tmp_path / "a-file").write_text("")
    with pytest.raises(UsageError, match="folder"):
        export_mission(mapped.folder, [Format.GEOTIFF, Format.KML], out=tmp_path / "a-file")


def test_a_format_that_fails_does_not_cost_the_others(mapped, tmp_path):
    (tmp_path / "map.kmz").mkdir()  # a folder stands where the file should go
    with pytest.raises(OutputError, match=r"map\.kmz"):
        export_mission(mapped.folder, [Format.KML, Format.POSES], out=tmp_path)
    assert (tmp_path / "poses.csv").is_file()


def test_over_puts_the_new_map_on_the_old_grid(mapped, tmp_path):
    with rasterio.open(mapped.folder / "map.tif") as new:
        bounds, crs = new.bounds, new.crs
    old = tmp_path / "old.tif"
    transform = rasterio.transform.from_origin(bounds.left - 20, bounds.top + 20, 0.5, 0.5)
    size = (math.ceil((bounds.top - bounds.bottom + 40) / 0.5), math.ceil((bounds.right - bounds.left + 40) / 0.5))
    profile = {"driver": "GTiff", "count": 3, "dtype": "uint8", "crs": crs, "transform": transform}
    with rasterio.open(old, "w", height=size[0], width=size[1], **profile) as raster:
        raster.write(np.full((3, *size), 200, np.uint8))
    before = old.read_bytes()
    out = tmp_path / "new.tif"
    written = export_mission(mapped.folder, [Format.GEOTIFF], over=old, out=out)
    assert out in written
    assert old.read_bytes() == before
    with rasterio.open(out) as raster:
        assert (raster.transform, raster.crs, raster.shape, raster.count) == (transform, crs, size, 3)
        pixels = raster.read()
    assert (pixels[:, :10, :10] == 200).all()
    middle = pixels[:, size[0] // 2 - 20 : size[0] // 2 + 20, size[1] // 2 - 20 : size[1] // 2 + 20]
    assert middle.std() > 1
    footprint = json.loads(next(p for p in written if p.suffix == ".geojson").read_text())
    assert footprint["features"]


def test_a_finished_mission_is_resumed_without_work_and_other_sources_are_refused(flown, mapped, tmp_path):
    folder = tmp_path / "mission"
    shutil.copytree(mapped.folder, folder)
    lines = (folder / "registrations.jsonl").read_bytes()
    again = map_flight([flown.photos], folder)
    assert (folder / "registrations.jsonl").read_bytes() == lines
    assert again.frames == mapped.summary.frames
    np.testing.assert_array_equal(read_rgba(folder / "map.tif"), read_rgba(mapped.folder / "map.tif"))
    with pytest.raises(UsageError, match="--add"):
        map_flight([flown.photos.parent], folder)
    with pytest.raises(UsageError, match="--add"):
        map_flight([flown.photos], folder, MapSettings(max_off_nadir_deg=20))


@pytest.mark.slow
@pytest.mark.parametrize("after", ["prepared.jsonl", "registrations.jsonl", "solution.json"])
def test_a_killed_run_resumes_to_the_same_map(flown, mapped, tmp_path, after):
    """SIGKILL at the first sign of each stage; the same command then finishes the map."""
    folder = tmp_path / "mission"
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from photomap_gis.pipeline import map_flight\n"
        f"sign = Path({str(folder / after)!r})\n"
        "def progress(*_):\n"
        "    if sign.exists() and sign.stat().st_size > 200: os.kill(os.getpid(), signal.SIGKILL)\n"
        f"map_flight([{str(flown.photos)!r}], Path({str(folder)!r}), on_progress=progress)\n"
    )
    killed = subprocess.run([sys.executable, "-c", code], capture_output=True, env=os.environ)
    assert killed.returncode == -signal.SIGKILL
    assert not (folder / "map.tif").exists()
    summary = map_flight([flown.photos], folder)
    assert summary.frames == mapped.summary.frames
    np.testing.assert_array_equal(read_rgba(folder / "map.tif"), read_rgba(mapped.folder / "map.tif"))


def test_a_mission_is_extended_by_a_second_flight(flown, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    photos = sorted(flown.photos.glob("*.JPG"))
    for k, photo in enumerate(photos):
        shutil.copy(photo, (first if k < 8 else second) / photo.name)
    folder = tmp_path / "mission"
    alone = map_flight([first], folder)
    both = map_flight([second], folder, add=True)
    assert (alone.frames["total"], both.frames["total"]) == (8, 14)
    assert both.frames["registered"] == 14
    assert both.segments == 1, "overlap across the flights joins them"
    assert both.area_m2 > alone.area_m2
    again = map_flight([second], folder, add=True)
    assert again.frames["total"] == 14
    assert any("already" in w for w in again.warnings)
    assert again.registrations == both.registrations, "nothing that was registered is lost"
    with pytest.raises(DataError, match="no mission folder"):
        map_flight([second], tmp_path / "nowhere", add=True)


def test_without_gps_the_map_is_relative_and_says_so(flown, tmp_path):
    photos = strip_gps(flown.photos, tmp_path / "bare")
    folder = tmp_path / "mission"
    summary = map_flight([photos], folder)
    assert not summary.georeferenced
    assert summary.crs is None
    assert summary.fit_to_gps_rms_m is None
    assert summary.predicted_ce90_m is None
    assert any("not georeferenced" in w for w in summary.warnings)
    assert (folder / "map-1.tif").is_file()
    assert not (folder / "map.kmz").exists()
    with rasterio.open(folder / "map.tif") as raster:
        assert raster.crs is None or raster.crs.to_epsg() is None
    with pytest.raises(NotGeoreferencedError, match="--track"):
        export_mission(folder, [Format.KML])
    (poses,) = export_mission(folder, [Format.POSES])
    assert "local" in poses.read_text()


def test_broken_frames_are_named_and_the_rest_is_mapped(flown, tmp_path):
    photos = tmp_path / "photos"
    shutil.copytree(flown.photos, photos)
    names = sorted(p.name for p in photos.glob("*.JPG"))
    whole = (photos / names[3]).read_bytes()
    (photos / names[3]).write_bytes(whole[: len(whole) // 3])
    with Image.open(photos / names[6]) as photo:
        exif = photo.info["exif"]
    Image.fromarray(np.full((480, 640, 3), 127, np.uint8)).save(photos / names[6], exif=exif)
    summary = map_flight([photos], tmp_path / "mission")
    assert summary.frames["error_frame"] == 2
    assert summary.frames["registered"] == 12
    (poses,) = export_mission(tmp_path / "mission", [Format.POSES])
    rows = {line.split(",")[0]: line for line in poses.read_text().splitlines()}
    assert "error_frame" in rows[names[3]]
    assert "error_frame" in rows[names[6]]


def test_a_crs_of_the_users_choice(flown, tmp_path):
    summary = map_flight([flown.photos], tmp_path / "mission", MapSettings(crs="EPSG:3857", layers=True))
    with rasterio.open(summary.map) as raster:
        assert raster.crs.to_epsg() == 3857
        assert raster.bounds == pytest.approx(summary.bounds)
        # a Mercator metre at 53 degrees north is some 0.6 m on the ground: the pixel there is what the camera saw
        assert summary.gsd_m_per_px / raster.res[0] == pytest.approx(math.cos(math.radians(53.17)), rel=0.01)
        grid = raster.shape, raster.transform
    with rasterio.open(tmp_path / "mission" / "layers" / "views.tif") as views:
        assert (views.shape, views.transform) == grid
    assert summary.crs == "EPSG:3857"
    errors = evaluate_map(summary.map, flown.truth.folder)
    assert errors.relative_rmse_gsd < 5 and errors.coverage > 0.98
    with pytest.raises(UsageError, match="EPSG"):
        map_flight([flown.photos], tmp_path / "other", MapSettings(crs="EPSG:999999"))
    assert not (tmp_path / "other").exists()


def test_wrong_sources_are_told_before_a_mission_is_made(tmp_path):
    with pytest.raises(DataError):
        map_flight([tmp_path / "nothing-here"], tmp_path / "mission")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError):
        map_flight([tmp_path / "empty"], tmp_path / "mission")
    assert not (tmp_path / "mission").exists()
    blocked = tmp_path / "file"
    blocked.write_text("")
    photo = tmp_path / "p.jpg"
    cv2.imwrite(str(photo), np.random.default_rng(0).integers(0, 255, (90, 120, 3), np.uint8))
    with pytest.raises(OutputError, match="-o"):
        map_flight([photo], blocked / "mission")
