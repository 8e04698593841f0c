"""What the docks ask of the engine (their checks in QGIS hold them to these words) is what the commands take."""

import pytest

from photomap_gis.cli.app import cli
from photomap_gis.engine.arguments import argv_of

ASKED = [
    ("map", {"sources": ["/p"], "output": "/m", "track": "/l.tlog", "gsd": 0.075, "prefer": "newest", "layers": False,
             "crs": "EPSG:32632", "dem": "/d.tif", "reference": ["/o.tif"], "gcp": "/g.csv", "check": "P3,P7",
             "fov_deg": 78.0, "memory": 2048}),
    ("export", {"mission": "/m", "vectors": True}),
    ("export", {"mission": "/m", "output": "/o", "crs": "EPSG:3857", "gsd": 0.1, "compress": "jpeg", "geotiff": True,
                "tile_format": "mixed", "cutline": "/a.geojson", "attribution": "FD", "bbox": "8,53,8.1,53.1",
                "kml": True, "mbtiles": True, "gpkg": True, "atak": True, "geopdf": True, "layers": True,
                "poses": True, "tiles": True, "tms": True, "pmtiles": True, "worldfile": True, "stac": True}),
    ("export", {"mission": "/m", "output": "/o/old-new.tif", "over": "/old.tif", "geotiff": True}),
    ("compare", {"old": "/a.tif", "new": "/b.tif", "output": "/c.tif", "polygons": "/c.gpkg", "threshold": 0.5,
                 "min_area": None}),
    ("georeference", {"mission": "/m", "pick": ["1.5,-2.0=53.1,8.6", "3.0,4.0=53.2,8.7"], "piece": 1, "reset": True,
                      "check_pick": ["5.0,6.0=53.3,8.8"]}),
    ("georeference", {"mission": "/m", "nudge": "-1.500,0.250,0.0000"}),
    ("reference", {"mission": "/m", "references": ["/o.tif"], "reference_sigma": 0.5}),
    ("solve", {"mission": "/m", "gcp": "/g.csv", "check": "every-third"}),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "arguments"), ASKED, ids=lambda v: v if isinstance(v, str) else "")
def test_the_engine_takes_what_the_docks_say(kind, arguments):
    command = cli.get_command(None, kind)
    argv = argv_of(kind, command, arguments, ("as_json",))
    assert argv[0] == kind
    assert "--json" in argv
    for value in arguments.values():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, str):
                assert any(one in word for word in argv)
