"""What other programs make of the outputs: GDAL's tools and real QGIS, where they are installed."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString

from photomap_gis.export import (
    MapWords,
    PoseRow,
    VectorLayer,
    write_geopackage,
    write_geopdf,
    write_geotiff,
    write_kmz,
    write_mbtiles,
    write_over,
    write_picture,
    write_poses,
    write_tiles,
    write_vectors,
)

SYSTEM_PYTHON = Path("/usr/bin/python3")
# A stray PYTHONPATH or GDAL_DATA of this environment must not reach the system's own GDAL.
CLEAN = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "GDAL", "PROJ", "VIRTUAL"))}

QGIS = """
import json, os, sys
os.environ["QT_QPA_PLATFORM"] = "offscreen"
sys.path.append("/usr/share/qgis/python")
from qgis.core import QgsApplication, QgsMapRendererParallelJob, QgsMapSettings, QgsRasterLayer, QgsVectorLayer
from qgis.core import QgsCoordinateReferenceSystem, QgsRectangle
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor
app = QgsApplication([], False)
app.initQgis()
out = {}
for name, (uri, provider, picture, west, south, east, north) in json.load(open(sys.argv[1])).items():
    layer = QgsVectorLayer(uri, name, "ogr") if provider == "ogr" else QgsRasterLayer(uri, name, provider)
    out[name] = {"valid": layer.isValid(), "crs": layer.crs().authid()}
    if provider == "ogr":
        out[name]["features"] = layer.featureCount()
        continue
    settings = QgsMapSettings()
    settings.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:32633"))
    settings.setLayers([layer])
    settings.setBackgroundColor(QColor(255, 255, 255, 0))
    settings.setOutputSize(QSize(840, 760))
    settings.setExtent(QgsRectangle(west, south, east, north))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(picture)
print("RESULT" + json.dumps(out))
sys.stdout.flush()
os._exit(0)
"""


def tool(name):
    found = shutil.which(name, path="/usr/bin")
    if found is None:
        pytest.skip(f"{name} is not installed (apt-get install gdal-bin)")
    return found


def run(*command, timeout=120):
    done = subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, timeout=timeout, env=CLEAN, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """One map in every format."""
    from .conftest import make_source

    folder, source = tmp_path_factory.mktemp("peers"), make_source()
    write_geotiff(source, folder / "map.tif")
    write_geotiff(source, folder / "jpeg.tif", compression="JPEG")
    write_geotiff(source, folder / "mercator.tif", crs="EPSG:3857")
    write_kmz(source, folder / "map.kmz")
    write_kmz(source, folder / "plain.kml")
    write_tiles(source, folder / "tiles", image_format="png")
    write_mbtiles(source, folder / "map.mbtiles")
    for compression in ("zstd", "webp"):
        write_geotiff(source, folder / f"{compression}.tif", compression=compression)
    words = MapWords("Flood", "a map", "Fire Dept", last_utc="2026-11-25T10:00:00Z")
    write_geopackage(source, folder / "map.gpkg", words=words)
    write_geopackage(source, folder / "mercator.gpkg", crs="EPSG:3857", image_format="png")
    write_picture(source, folder / "picture.png")
    write_geopdf(source, folder / "map.pdf", words=words)
    ring = LineString([(391_010, 5_819_990), (391_050, 5_819_950)])
    track = [VectorLayer("track", (ring,), ({"name": "one"},))]
    for suffix in (".gpkg", ".geojson", ".kml"):
        write_vectors(track, folder / f"vectors{suffix}", crs_wkt="EPSG:32633", words=words)
    write_over(source, folder / "mercator.tif", folder / "over.tif", feather_px=0)
    rows = [PoseRow("a", "a.jpg", easting_m=391_010.0, northing_m=5_819_990.0, crs="EPSG:32633"), PoseRow("b", "b.jpg")]
    write_poses(rows, folder / "poses.geojson")
    return folder


@pytest.mark.parametrize("name", ["map.tif", "jpeg.tif", "mercator.tif", "over.tif"])
def test_gdalinfo(outputs, name):
    info = json.loads(run(tool("gdalinfo"), "-json", outputs / name))
    assert info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"] == "COG"
    expected = ["Red", "Green", "Blue"] if name == "jpeg.tif" else ["Red", "Green", "Blue", "Alpha"]
    assert [b["colorInterpretation"] for b in info["bands"]] == expected
    centre = info["wgs84Extent"]["coordinates"][0]
    assert 13.3 < np.mean([p[0] for p in centre]) < 13.5
    assert 52.4 < np.mean([p[1] for p in centre]) < 52.6


@pytest.mark.parametrize("name", ["map.tif", "jpeg.tif", "zstd.tif", "webp.tif", "mercator.tif", "over.tif"])
def test_gdals_own_cog_validator(outputs, name):
    tool("gdalinfo")
    module = "osgeo_utils.samples.validate_cloud_optimized_geotiff"
    probe = subprocess.run([SYSTEM_PYTHON, "-c", f"import {module}"], capture_output=True, env=CLEAN, check=False)
    if probe.returncode:
        pytest.skip("GDAL's Python samples are not installed (apt-get install python3-gdal)")
    assert "is a valid cloud optimized GeoTIFF" in run(SYSTEM_PYTHON, "-m", module, outputs / name)


@pytest.mark.parametrize(
    "name",
    ["map.kmz", "plain.kml", "map.mbtiles", "map.gpkg", "mercator.gpkg", "picture.png"],
)
def test_gdal_reads_the_pyramids(outputs, name, scene, tmp_path):
    from PIL import Image

    # gdalwarp of another build, back into the map's own grid: every landmark must lie where it was
    source = scene.source()
    bounds = [str(v) for v in source.grid.bounds]
    target = ["-t_srs", "EPSG:32633", "-te", *bounds, "-tr", "0.25", "0.25", "-r", "cubic"]
    run(tool("gdalwarp"), "-q", *target, outputs / name, tmp_path / "back.tif")
    run(tool("gdal_translate"), "-q", "-of", "PNG", tmp_path / "back.tif", tmp_path / "back.png")
    rgba = np.asarray(Image.open(tmp_path / "back.png").convert("RGBA"))
    assert scene.errors_px(source, rgba, "EPSG:32633", source.grid.to_crs) < 0.2


def test_ogrinfo_reads_the_vectors(outputs):
    text = run(tool("ogrinfo"), "-al", outputs / "poses.geojson")
    assert "Feature Count: 2" in text
    assert "POINT (13.3" in text
    assert "POLYGON" in run(tool("ogrinfo"), "-al", outputs / "over-footprint.geojson")
    for name in ("vectors.gpkg", "vectors.geojson", "vectors.kml"):
        assert "LINESTRING" in run(tool("ogrinfo"), "-al", outputs / name), name


def test_gdal_reads_the_page(outputs, scene, tmp_path):
    from PIL import Image

    source = scene.source()
    info = json.loads(run(tool("gdalinfo"), "-json", outputs / "map.pdf"))
    assert info["metadata"][""]["AUTHOR"] == "Fire Dept"
    assert info["geoTransform"][0] == pytest.approx(source.grid.west, abs=1e-3)
    # the map is framed, without the strip of words below it
    neatline = shapely.from_wkt(info["metadata"][""]["NEATLINE"])
    np.testing.assert_allclose(neatline.bounds, source.grid.bounds, atol=0.01 * source.grid.pixel_size)
    assert info["size"][1] > source.grid.height
    # drawn finely, since the reader puts pictures on whole pixels of its own, and brought back to the map's grid
    target = ["-t_srs", "EPSG:32633", "-te", *map(str, source.grid.bounds), "-tr", "0.25", "0.25", "-r", "average"]
    fine = ["--config", "GDAL_PDF_DPI", "576"]
    run(tool("gdalwarp"), "-q", *fine, *target, outputs / "map.pdf", tmp_path / "page.tif")
    run(tool("gdal_translate"), "-q", "-of", "PNG", tmp_path / "page.tif", tmp_path / "page.png")
    rgba = np.asarray(Image.open(tmp_path / "page.png").convert("RGBA"))
    assert scene.errors_px(source, rgba, "EPSG:32633", source.grid.to_crs) < 0.25


@pytest.fixture(scope="module")
def in_qgis(outputs):
    """What real QGIS says and draws, all layers in one run."""
    from .conftest import make_source

    if subprocess.run(
        [SYSTEM_PYTHON, "-c", "import qgis.core"], capture_output=True, env=CLEAN, check=False
    ).returncode:
        pytest.skip("QGIS is not installed (apt-get install qgis python3-qgis)")
    view = make_source().grid.bounds  # drawn at two pixels for one of the map
    zooms = json.loads((outputs / "tiles" / "tiles.json").read_text())
    xyz = f"type=xyz&url=file://{outputs}/tiles/{{z}}/{{x}}/{{y}}.png&zmin={zooms['minzoom']}&zmax={zooms['maxzoom']}"
    uris = {
        "geotiff": (f"{outputs}/map.tif", "gdal"),
        "jpeg": (f"{outputs}/jpeg.tif", "gdal"),
        "mercator": (f"{outputs}/mercator.tif", "gdal"),
        "mbtiles": (f"{outputs}/map.mbtiles", "gdal"),
        "kmz": (f"{outputs}/map.kmz", "gdal"),
        "kml": (f"{outputs}/plain.kml", "gdal"),
        "gpkg": (f"{outputs}/map.gpkg", "gdal"),
        "picture": (f"{outputs}/picture.png", "gdal"),
        "xyz": (xyz, "wms"),
        "poses": (f"{outputs}/poses.geojson", "ogr"),
        "footprint": (f"{outputs}/over-footprint.geojson", "ogr"),
        "track": (f"{outputs}/vectors.kml|layername=track", "ogr"),
    }
    request = {n: (uri, provider, f"{outputs}/qgis-{n}.png", *view) for n, (uri, provider) in uris.items()}
    (outputs / "request.json").write_text(json.dumps(request))
    (outputs / "run.py").write_text(QGIS)
    text = run(SYSTEM_PYTHON, outputs / "run.py", outputs / "request.json", timeout=240)
    return json.loads(text[text.index("RESULT") + 6 :].splitlines()[0])


@pytest.mark.parametrize("name", ["geotiff", "jpeg", "mercator", "mbtiles", "kmz", "kml", "gpkg", "picture", "xyz"])
def test_qgis_draws_the_map_where_it_is(outputs, in_qgis, scene, name):
    from PIL import Image

    assert in_qgis[name]["valid"]
    source = scene.source()
    rgba = np.asarray(Image.open(outputs / f"qgis-{name}.png").convert("RGBA"))
    # two drawn pixels a map pixel; QGIS draws tiles to about a screen pixel
    assert scene.errors_px(source, rgba, "EPSG:32633", lambda xy: source.grid.to_crs((xy + 0.5) / 2 - 0.5)) < 0.75
    assert rgba[-20:, :20, 3].max() == 0  # where nothing was seen, nothing is drawn


@pytest.mark.parametrize(("name", "features"), [("poses", 2), ("footprint", 1), ("track", 1)])
def test_qgis_opens_the_vectors(in_qgis, name, features):
    assert in_qgis[name] == {"valid": True, "crs": "EPSG:4326", "features": features}
