"""Nothing is mirrored or turned: an asymmetric ground flown at four headings lies on the map as it does on Earth."""

import numpy as np
import pytest
import rasterio

from photomap_gis.pipeline import map_flight
from photomap_gis.simulate import FlightSpec, GpsError, Motion, simulate_photos
from photomap_gis.simulate.scene import orientation_scene

EXACT_GPS = GpsError(white_sigma_m=0.02, walk_sigma_m=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_four_discs_lie_where_they_are(tmp_path, heading_deg):
    scene = orientation_scene()
    spec = FlightSpec(
        frames=15, width_px=640, height_px=480, headings_deg=(heading_deg,), gps=EXACT_GPS, motion=Motion(tilt_deg=0.5)
    )
    simulate_photos(scene.ground, spec, tmp_path)
    summary = map_flight([tmp_path / "photos"], tmp_path / "mission")
    with rasterio.open(summary.map) as raster:
        assert raster.crs == rasterio.crs.CRS.from_wkt(scene.ground.grid.crs_wkt)
        seen = raster.read().astype(float)
        rows, cols = np.mgrid[0 : raster.height, 0 : raster.width]
        found = 0
        for name, easting, northing, bgr in scene.marks:
            x, y = raster.transform @ (cols.ravel() + 0.5, rows.ravel() + 0.5)
            near = np.hypot(x - easting, y - northing).reshape(rows.shape) < 4 * scene.mark_radius_m
            colour = np.array(bgr[::-1], float)[:, None, None]
            alike = (np.abs(seen[:3] - colour).max(axis=0) < 70) & (seen[3] > 127) & near
            if alike.sum() < 20:
                continue
            found += 1
            at = x.reshape(rows.shape)[alike].mean(), y.reshape(rows.shape)[alike].mean()
            assert np.hypot(at[0] - easting, at[1] - northing) < 1.0, name
        assert found >= 3
