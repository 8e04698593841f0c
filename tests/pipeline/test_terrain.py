"""Maps over ground of known heights."""

import shutil

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from photomap_gis.core.errors import DataError
from photomap_gis.pipeline import solve_again
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission

PIXEL_M = 5.0


@pytest.fixture
def mission(mapped, tmp_path):
    """A copy of the mapped mission that a test may change."""
    folder = tmp_path / "mission"
    shutil.copytree(mapped.folder, folder)
    return folder


def write_dem(flown, path, *, west_half_only=False, everything=True):
    """Write the ground below the flight, houses and trees opened away, 200 m above the sea."""
    from scipy.ndimage import gaussian_filter, grey_opening

    centres = np.array([(f.pose.easting_m, f.pose.northing_m) for f in flown.truth.frames])
    low, high = centres.min(axis=0) - 100.0, centres.max(axis=0) + 100.0
    columns, rows = (int(s) for s in (high - low) / PIXEL_M)
    row, column = np.mgrid[0:rows, 0:columns]
    at = np.stack([low[0] + PIXEL_M * (column + 0.5), high[1] - PIXEL_M * (row + 0.5)], axis=-1)
    heights = flown.truth.ground().heights_at(at.reshape(-1, 2)).reshape(rows, columns)
    known = np.isfinite(heights)
    ground = gaussian_filter(grey_opening(np.where(known, heights, np.nanmedian(heights)), size=7), 2.0) + 200.0
    if west_half_only:
        known = known & (column < columns // 4)
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", nodata=-9999.0,
        crs=flown.truth.crs_wkt, transform=from_origin(low[0], high[1], PIXEL_M, PIXEL_M),
    ) as dataset:  # fmt: skip
        dataset.write(np.where(known | everything & ~np.isfinite(heights), ground, -9999.0).astype(np.float32), 1)
    return path


def test_the_ground_is_that_of_the_elevation_model_and_stays_so(flown, mission, tmp_path):
    dem = write_dem(flown, tmp_path / "dtm.tif")
    first = solve_again(mission, dem=dem)
    with Mission.open(mission) as opened:
        ground = next(p.camera_to_map.ground for p in Solved.load(opened).trajectory.placements)
    assert ground.up.shape[0] > 20 and not ground.is_level
    assert not any("--dem" in w for w in first.warnings)
    again = solve_again(mission)
    assert again.predicted_ce90_m == pytest.approx(first.predicted_ce90_m)
    with Mission.open(mission) as opened:
        kept = next(p.camera_to_map.ground for p in Solved.load(opened).trajectory.placements)
    assert kept.up == pytest.approx(ground.up)


def test_a_model_with_a_hole_too_large_changes_nothing(flown, mission, tmp_path):
    before = (mission / "mission.json").read_bytes(), (mission / "solution.json").read_bytes()
    with pytest.raises(DataError, match="of the ground under the map"):
        solve_again(mission, dem=write_dem(flown, tmp_path / "half.tif", west_half_only=True, everything=False))
    assert ((mission / "mission.json").read_bytes(), (mission / "solution.json").read_bytes()) == before


def test_a_model_that_could_not_be_used_is_told(flown, mission, tmp_path, monkeypatch):
    monkeypatch.setattr("photomap_gis.pipeline.flight.solve_in_space", lambda *a, **k: a[3])
    told = solve_again(mission, dem=write_dem(flown, tmp_path / "dtm.tif"))
    assert any("--dem was not used" in w for w in told.warnings)
