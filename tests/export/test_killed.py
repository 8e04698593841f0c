"""An export that is killed half way leaves the old output and, after the next run, nothing else."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import rasterio

from photomap_gis.core.grid import MapGrid
from photomap_gis.mosaic import TileStore

pytestmark = pytest.mark.skipif(os.name != "posix", reason="a process is killed by SIGKILL")

EXPORT = """
import os, signal, sys
from pathlib import Path
from photomap_gis.export import write_geotiff, write_mbtiles, write_tiles
from photomap_gis.mosaic import TileStore
kind, store, out, share = sys.argv[1:]
def progress(done, total):
    if done >= float(share) * total:
        os.kill(os.getpid(), signal.SIGKILL)
write = {"tif": write_geotiff, "mbtiles": write_mbtiles, "tiles": write_tiles}[kind]
write(TileStore(Path(store)), Path(out), on_progress=progress)
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    rng = np.random.default_rng(2)
    grid = MapGrid("EPSG:32632", 500_000.0, 5_900_000.0, 0.5, 2200, 1500)
    out = TileStore.create(tmp_path_factory.mktemp("map"), grid, revision=1)
    for tile in grid.tiles():
        window = grid.window(tile)
        rgba = rng.integers(0, 256, (window.height, window.width, 4), dtype=np.uint8)
        rgba[..., 3] = 255
        out.write(tile, rgba)
    return out


def contents(path):
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return {p.relative_to(path): p.read_bytes() for p in files}


@pytest.mark.parametrize("kind", ["tif", "mbtiles", "tiles"])
def test_a_killed_export_is_done_again_and_leaves_no_rubbish(store, tmp_path, kind):
    out, whole = tmp_path / "out" / f"map.{kind}", tmp_path / "whole" / f"map.{kind}"
    for path in (out, whole):
        path.parent.mkdir()

    def run(path, share):
        arguments = [kind, str(store.folder), str(path), str(share)]
        return subprocess.run([sys.executable, "-c", EXPORT, *arguments], capture_output=True, text=True)

    assert run(whole, 2.0).returncode == 0
    killed = run(out, 0.5)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert not out.exists() and any(out.parent.iterdir()), "it was killed while it wrote"
    again = run(out, 2.0)
    assert again.returncode == 0, again.stderr
    assert [p.name for p in out.parent.iterdir()] == [out.name]
    if kind == "tif":
        with rasterio.open(out) as ours, rasterio.open(whole) as theirs:
            assert np.array_equal(ours.read(), theirs.read())
    else:
        assert contents(out) == contents(whole)
