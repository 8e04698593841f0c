"""The harness itself: real QGIS runs here, and nothing of photomap's own environment leaks in."""

import importlib.util
import sys

from qgis.core import Qgis, QgsProject, QgsRasterLayer


def test_this_is_qgis_and_its_own_python(qgis_app):
    assert Qgis.QGIS_VERSION_INT >= 32200
    assert importlib.util.find_spec("rasterio") is None or "site-packages" not in sys.prefix
    assert importlib.util.find_spec("pydantic") is None


def test_a_simulated_mission_loads(qgis_app, qgis_new_project, mission):
    layer = QgsRasterLayer(str(mission / "map.tif"), "map", "gdal")
    QgsProject.instance().addMapLayer(layer)
    assert layer.isValid()
    assert layer.crs().authid() == "EPSG:32632"
