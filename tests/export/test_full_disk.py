"""A disk that takes no more: every format says so, and leaves neither a blank map nor rubbish."""

import contextlib
import os

import numpy as np
import pytest
from pyproj import CRS

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export import (
    write_geopackage,
    write_geopdf,
    write_geotiff,
    write_kmz,
    write_mbtiles,
    write_picture,
    write_pmtiles,
    write_tiles,
)
from photomap_gis.export.draft import draft_dataset
from photomap_gis.publish import file_in_place_of, folder_in_place_of

resource = pytest.importorskip("resource", reason="only POSIX can bound the size of a process's files")

WRITERS = {
    **{f"{c}.tif": (write_geotiff, {"compression": c}) for c in ("deflate", "zstd", "lzw", "none", "jpeg", "webp")},
    "map.pdf": (write_geopdf, {}),
    "map.png": (write_picture, {}),
    "map.jpg": (write_picture, {}),
    "map.kmz": (write_kmz, {}),
    "map.mbtiles": (write_mbtiles, {}),
    "map.pmtiles": (write_pmtiles, {}),
    "map.gpkg": (write_geopackage, {"image_format": "png"}),
    "tiles": (write_tiles, {}),
}


@contextlib.contextmanager
def files_of_at_most(size):
    """Let no file of this process grow beyond ``size`` bytes: to a program, the disk is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def noise(scene, rng):
    """A map that no format packs well."""
    rgba = rng.integers(0, 255, (600, 700, 4), dtype=np.uint8)
    rgba[..., 3] = 255
    return scene.of_array(rgba, MapGrid(CRS.from_epsg(32633).to_wkt(), 391_000.0, 5_820_000.0, 0.25, 700, 600))


@pytest.mark.parametrize(
    ("name", "size"), [*((name, 20_000) for name in WRITERS), *((n, 130_000) for n in WRITERS if n != "tiles")]
)
def test_every_format_says_that_it_could_not_be_written(noise, tmp_path, name, size):
    write, options = WRITERS[name]
    with files_of_at_most(size), pytest.raises(OutputError) as told:
        write(noise, tmp_path / name, **options)
    assert ".photomap-" not in str(told.value)  # where it is written meanwhile is nobody's business
    assert list(tmp_path.iterdir()) == []


def test_a_draft_must_hold_what_it_was_given(tmp_path):
    path, profile = tmp_path / "draft.tif", {"width": 1024, "height": 600, "count": 1, "dtype": "uint8"}
    with draft_dataset(path, profile) as draft:
        draft.write(np.ones((600, 700), np.uint8), Window(324, 0, 700, 600))
    draft.check(path)
    os.truncate(path, path.stat().st_size - 1000)
    with pytest.raises(OSError, match="not all of it reached the disk"):
        draft.check(path)
    with draft_dataset(path, profile):
        pass
    with pytest.raises(OSError, match="not all of it reached the disk"):
        draft.check(path)  # sound, and sparse where it was given something


def test_an_empty_draft_is_sound(tmp_path):
    profile = {"width": 1024, "height": 600, "count": 1, "dtype": "float32", "nodata": float("nan")}
    with draft_dataset(tmp_path / "empty.tif", profile) as draft:
        draft.write(np.full((600, 1024), np.nan, np.float32), Window(0, 0, 1024, 600))
    assert (tmp_path / "empty.tif").stat().st_size < 10_000


def test_errors_name_the_output_and_not_where_it_grows(tmp_path):
    with pytest.raises(OutputError) as told, folder_in_place_of(tmp_path / "out", ours=lambda p: True) as fresh:
        raise OutputError(f"{fresh / 'part.tif'} cannot be written")
    assert str(told.value) == f"{tmp_path / 'out' / 'part.tif'} cannot be written"
    with pytest.raises(OutputError) as told, file_in_place_of(tmp_path / "a.tif") as temporary:
        raise OutputError(f"{temporary} cannot be written")
    assert str(told.value) == f"{tmp_path / 'a.tif'} cannot be written"
