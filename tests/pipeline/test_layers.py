"""Layers and preferences through the corridor: killed runs, maps without a place, missions that grow."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image

from photomap_gis.core.layer import Layer
from photomap_gis.mosaic import Prefer
from photomap_gis.pipeline import Drawing, Format, MapSettings, export_mission, map_flight, solve_again


def read(path: Path) -> np.ndarray:
    with rasterio.open(path) as raster:
        return raster.read()


def everything(folder: Path) -> dict[str, np.ndarray]:
    return {"map": read(folder / "map.tif")} | {k: read(folder / "layers" / f"{k}.tif") for k in Layer}


@pytest.mark.slow
def test_a_run_killed_while_it_draws_and_while_it_layers_ends_as_if_nothing_had_happened(flown, mapped, tmp_path):
    """SIGKILL half way through the tiles; then half way through the layers; the third run finishes."""
    whole, folder = tmp_path / "whole", tmp_path / "mission"
    for copy in (whole, folder):
        shutil.copytree(mapped.folder, copy)
    settings = MapSettings(prefer=Prefer.SHARP, layers=True, workers=2)
    map_flight([flown.photos], whole, settings)
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from photomap_gis.mosaic import Prefer\n"
        "from photomap_gis.pipeline import MapSettings, map_flight\n"
        "def progress(stage, done, total):\n"
        "    if stage == sys.argv[1] and done >= float(sys.argv[2]) * total: os.kill(os.getpid(), signal.SIGKILL)\n"
        "settings = MapSettings(prefer=Prefer.SHARP, layers=True, workers=2)\n"
        f"map_flight([{str(flown.photos)!r}], Path({str(folder)!r}), settings, on_progress=progress)\n"
    )
    made: list[set[Path]] = []
    for stage, share, kind in (("render", 0.8, "*/*.tile"), ("layers", 0.3, "layers/*/*.layers")):
        killed = subprocess.run([sys.executable, "-c", code, stage, str(share)], capture_output=True, env=os.environ)
        assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
        made.append(set((folder / "mosaic").glob(kind)))
    assert 0 < len(made[0]) < len(list((folder / "mosaic").glob("*/*.tile")))
    stamps = {p: p.stat().st_mtime_ns for p in made[1]}
    map_flight([flown.photos], folder, settings)
    assert stamps and all(p.stat().st_mtime_ns == stamp for p, stamp in stamps.items()), "what was done is kept"
    ours, theirs = everything(folder), everything(whole)
    for name, values in theirs.items():
        np.testing.assert_array_equal(ours[name], values, err_msg=str(name))


def test_each_piece_of_a_map_without_a_place_has_its_layers(flown, tmp_path):
    bare = tmp_path / "bare"
    bare.mkdir()
    photos = sorted(flown.photos.glob("*.JPG"))
    for photo in photos[:3] + photos[-3:]:
        with Image.open(photo) as picture:
            picture.save(bare / photo.name, quality=92)
    summary = map_flight([bare], tmp_path / "m", MapSettings(layers=True))
    assert not summary.georeferenced
    with (
        rasterio.open(tmp_path / "m" / "map.tif") as first,
        rasterio.open(tmp_path / "m" / "layers/views.tif") as views,
    ):
        assert views.shape == first.shape and views.transform == first.transform
        assert "NOT GEOREFERENCED" in views.tags()["GEOREFERENCE"]
    assert not read(tmp_path / "m" / "layers" / "last_seen.tif").any(), "photos without a clock"
    pieces = len(list((tmp_path / "m").glob("map-*.tif")))
    assert len(list((tmp_path / "m").glob("layers-*"))) == pieces - 1
    (folder,) = export_mission(tmp_path / "m", [Format.LAYERS], out=tmp_path / "out")
    np.testing.assert_array_equal(read(folder / "views.tif"), read(tmp_path / "m" / "layers" / "views.tif"))


def test_how_a_mission_is_drawn_is_kept_with_it(mapped, tmp_path):
    folder = tmp_path / "mission"
    shutil.copytree(mapped.folder, folder)
    solve_again(folder, drawing=Drawing(Prefer.NEWEST, layers=True))
    kept = json.loads((folder / "mission.json").read_text())["settings"]
    assert (kept["prefer"], kept["layers"]) == ("newest", True)
    newest = read(folder / "layers" / "source_frame.tif")
    last = read(folder / "layers" / "last_seen.tif")
    top = newest.max()
    assert (last[newest == top] == last.max()).all()
    solve_again(folder)
    np.testing.assert_array_equal(read(folder / "layers" / "source_frame.tif"), newest)
    with rasterio.open(folder / "layers" / "searched.tif") as searched:
        tags = searched.tags()
        assert int(tags["FRAMES"]) == 14 and int(tags["FRAMES_WITH_BLUR"]) >= 10 and tags["NEWEST_FRAME"].endswith("Z")
        resolution, gsd, blur, age = searched.read(masked=True)
    assert 0.9 < float(np.ma.median(gsd)) / mapped.summary.gsd_m_per_px < 1.2
    assert float(blur.max()) < 3.0 and float(age.min()) == 0.0 and (resolution >= 0.999 * gsd).all()
