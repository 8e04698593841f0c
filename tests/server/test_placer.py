"""Where a document says that things are, and back."""

import numpy as np
from pyproj import CRS, Transformer

from photomap_gis.core.grid import MapFrame
from photomap_gis.server.placer import Placer


def test_across_the_antimeridian_everything_is_on_one_side_of_the_world():
    x, y = Transformer.from_crs(4326, 32701, always_xy=True).transform(180.0, -17.0)
    frame = MapFrame(CRS.from_epsg(32701).to_wkt(), float(round(x)), float(round(y)))
    around = np.array([[-60.0, 0.0], [0.0, 10.0], [60.0, 0.0]])
    place = Placer(frame, around)
    one_by_one = np.array([place(p[None])[0] for p in around])
    np.testing.assert_allclose(one_by_one, place(around))
    assert np.ptp(one_by_one[:, 0]) < 0.01  # they do not jump by a turn
    np.testing.assert_allclose([place.to_map(tuple(p)) for p in one_by_one], around, atol=0.02)
    assert place(np.array([[np.nan, 0.0], [0.0, 0.0]])) == place(np.array([[0.0, 0.0]]))
