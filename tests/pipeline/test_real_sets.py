"""Real photo sets, mapped whole."""

import json

import pytest
import rasterio
from rio_cogeo import cog_validate

from photomap_gis.pipeline import Format, export_mission, map_flight

pytestmark = [pytest.mark.slow, pytest.mark.shared]


def test_caliterra_is_one_connected_map(shared_data, tmp_path):
    """75 photos with GPS, a banking camera that reports no attitude, turns at the strips' ends."""
    summary = map_flight([shared_data / "caliterra" / "images"], tmp_path / "m")
    assert summary.frames["registered"] == summary.frames["total"] == 75
    assert summary.segments == 1
    assert summary.crs == "EPSG:32614"
    assert summary.registrations["sequential"] == 74
    assert summary.fit_to_gps_rms_m is not None
    assert summary.predicted_ce90_m > 0.3 * summary.fit_to_gps_rms_m  # the misfit is not hidden
    assert 0.03 < summary.gsd_m_per_px < 0.06
    valid, errors, warnings = cog_validate(summary.map, strict=True)
    assert valid, (errors, warnings)
    with rasterio.open(summary.map) as raster:
        assert raster.count == 4


def test_seneca_is_placed_whole(shared_data, tmp_path):
    """167 near-infrared photos of a fixed wing over bare fields, with gaps: all have a place and an honest status."""
    summary = map_flight([shared_data / "seneca" / "images"], tmp_path / "m")
    assert summary.frames["total"] == 167
    assert summary.frames["registered"] + summary.frames["gps_only"] == 167
    assert summary.frames["registered"] >= 150
    (poses,) = export_mission(tmp_path / "m", [Format.POSES], out=tmp_path / "poses.geojson")
    features = json.loads(poses.read_text())["features"]
    assert len(features) == 167
    assert all(f["geometry"] is not None for f in features)


def test_boruszyn_is_relative_and_says_so(shared_data, tmp_path):
    """28 kite photos without GPS: maps in local units, never at a place on Earth."""
    summary = map_flight([shared_data / "boruszyn" / "images"], tmp_path / "m")
    assert not summary.georeferenced
    assert summary.frames["gps_only"] == 0
    assert summary.frames["registered"] >= 20
    assert any("not georeferenced" in w for w in summary.warnings)
    assert (tmp_path / "m" / "map-1.tif").is_file()
    with rasterio.open(tmp_path / "m" / "map.tif") as raster:
        assert raster.crs is None or raster.crs.to_epsg() is None
