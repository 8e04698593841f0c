"""What the server answers: tiles that lie where the files lie, documents that GIS programs read, and no to the rest."""

import io
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import Transformer

from photomap_gis import __version__
from photomap_gis.cli import main
from photomap_gis.cli.serve_view import open_view
from photomap_gis.core.errors import DataError
from photomap_gis.server import Host
from photomap_gis.server.missions import mission_layers
from tests.server.clients import client_of

HALF_WORLD_M = math.pi * 6378137.0


def picture(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))


def exported_tiles(mission: Path) -> list[tuple[int, int, int, Path]]:
    files = sorted((mission / "tiles").glob("*/*/*.*"))
    return [(int(f.parts[-3]), int(f.parts[-2]), int(f.stem), f) for f in files if f.suffix in (".png", ".webp")]


def shift_px(a: np.ndarray, b: np.ndarray) -> float:
    """How far two pictures lie apart (phase correlation of their greens where both are seen)."""
    seen = (a[..., 3] > 0) & (b[..., 3] > 0)
    x, y = ((np.where(seen, v[..., 1], v[..., 1][seen].mean())).astype(np.float64) for v in (a, b))
    (dx, dy), _ = cv2.phaseCorrelate(x, y)
    return math.hypot(dx, dy)


def test_tiles_are_those_of_the_export(client, mission):
    tiles = exported_tiles(mission)
    finest = max(z for z, *_ in tiles)
    compared = 0
    for z, x, y, path in tiles:
        exported = picture(path.read_bytes())
        response = client.get(f"/missions/1/layers/map/{z}/{x}/{y}.png")
        assert response.status_code == 200 and response.headers["content-type"] == "image/png"
        served = picture(response.content)
        if (exported[..., 3] > 0).mean() < 0.3 or z < finest - 2:
            continue
        assert shift_px(served, exported) < 0.1, (z, x, y)
        both = (served[..., 3] > 0) & (exported[..., 3] > 0)
        if z == finest:  # coarser ones are averaged another way
            assert np.abs(served.astype(int) - exported)[both].mean() < 3.0
        compared += 1
    assert compared >= 3


def test_a_tile_puts_a_pixel_where_the_geotiff_has_it(client, mission):
    """An independent way: bilinear samples of map.tif at where PROJ says that a tile's pixels lie."""
    document = client.get("/missions/1").json()
    z = document["layers"][0]["scheme"]["max_zoom"]
    with rasterio.open(mission / "map.tif") as d:
        rgba, inverse, crs = d.read(), ~d.transform, d.crs
        cx, cy = (d.bounds.left + d.bounds.right) / 2, (d.bounds.bottom + d.bounds.top) / 2
    mx, my = Transformer.from_crs(crs, "EPSG:3857", always_xy=True).transform(cx, cy)
    size = 2 * HALF_WORLD_M / (256 << z)
    x, y = int((mx + HALF_WORLD_M) / size // 256), int((HALF_WORLD_M - my) / size // 256)
    served = picture(client.get(f"/tiles/{z}/{x}/{y}.png").content)
    col, row = np.meshgrid(np.arange(256) + 256 * x + 0.5, np.arange(256) + 256 * y + 0.5)
    to_map = Transformer.from_crs("EPSG:3857", crs, always_xy=True)
    e, n = to_map.transform(col * size - HALF_WORLD_M, HALF_WORLD_M - row * size)
    px, py = inverse * (np.asarray(e), np.asarray(n))
    here = (px - 0.5).astype(np.float32), (py - 0.5).astype(np.float32)
    wanted = np.dstack([cv2.remap(band, *here, cv2.INTER_LINEAR) for band in rgba])
    assert shift_px(served, wanted) < 0.1


def test_documents_of_a_mission(client, mission):
    api = client.get("/api").json()
    assert api == {"api": 1, "product": "photomap", "version": __version__, "missions": ["1"]}
    document = client.get("/missions/1").json()
    assert document["georeferenced"] and document["frames"]["total"] == 6 and document["crs"].startswith("EPSG:")
    assert client.get("/missions").json()["missions"] == [document]
    assert any(w.startswith("Predicted: CE90") for w in document["accuracy_words"])
    roles = {layer["id"]: layer["role"] for layer in document["layers"]}
    assert roles["map"] == "map" and roles["layer-sigma"] == "layer"
    assert "Searched: resolution" in [layer["title"] for layer in document["layers"]]
    assert str(mission.parent) not in json.dumps(document)  # where it lies is nobody's business
    legend = next(layer["legend"] for layer in document["layers"] if layer["id"] == "layer-sigma")
    assert legend["low"] < legend["high"]
    with rasterio.open(mission / "map.tif") as d:
        box = rasterio.warp.transform_bounds(d.crs, "EPSG:4326", *d.bounds)
    assert np.allclose(document["bounds"], box, atol=2e-4)


def test_frames_and_track_as_geojson(client, mission):
    frames = client.get("/missions/1/frames.geojson")
    assert frames.headers["content-type"] == "application/geo+json"
    features = frames.json()["features"]
    assert [f["properties"]["order"] for f in features] == list(range(6))
    west, south, east, north = client.get("/missions/1").json()["bounds"]
    for f in features:
        ring = np.array(f["geometry"]["coordinates"][0])
        assert (ring[0] == ring[-1]).all()
        lon, lat = ring.mean(axis=0)
        assert west < lon < east and south < lat < north
        assert f["properties"]["time_utc"].endswith("Z")
    [track] = client.get("/missions/1/track.geojson").json()["features"]
    assert track["geometry"]["type"] == "LineString" and len(track["geometry"]["coordinates"]) == 6
    assert client.get("/missions/1/finds.geojson").json()["features"] == []
    again = client.get("/missions/1/frames.geojson", headers={"if-none-match": frames.headers["etag"]})
    assert again.status_code == 304


def test_finds_are_shown_and_change_the_epoch(client, mission):
    document = client.get("/missions/1").json()
    before, tiles = document["epoch"], [layer["tiles"] for layer in document["layers"]]
    path = mission / "finds.geojson"
    find = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [9, 48]}, "properties": {"name": "<b>"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [find, 7]}))
    try:
        after = client.get("/missions/1").json()
        assert after["epoch"] != before
        assert [layer["tiles"] for layer in after["layers"]] == tiles  # a find changes no picture
        assert client.get("/missions/1/finds.geojson").json()["features"] == [find]
        path.write_text("[" * 100000)
        assert client.get("/missions/1/finds.geojson").json()["features"] == []
    finally:
        path.unlink()


def test_a_half_written_mission_stays_as_it_was(client, mission, monkeypatch):
    """While it is solved again the last whole state is shown, and a file that vanishes meanwhile is no fault."""
    solution = mission / "solution.json"
    whole = solution.read_bytes()
    before = client.get("/missions/1").json()
    try:
        for half in (b"", whole[: len(whole) // 2], b"[]"):
            solution.write_bytes(half)
            assert client.get("/missions/1").json() == before
        solution.unlink()
        assert client.get("/missions/1").json() == before
    finally:
        solution.write_bytes(whole)

    def vanish(*arguments):
        raise FileNotFoundError(str(mission / "map.tif"))

    monkeypatch.setattr(Host, "tile", vanish)
    gone = client.get("/tiles/0/0/0.png")
    assert gone.status_code == 503 and "ask again" in gone.json()["message"] and str(mission) not in gone.text


def test_tilejson_and_wmts_name_tiles_that_are_there(client):
    tilejson = client.get("/tiles.json").json()
    assert tilejson["tilejson"] == "3.0.0" and tilejson["scheme"] == "xyz"
    west, south, east, north = tilejson["bounds"]
    z = tilejson["maxzoom"]
    x = int(((west + east) / 2 + 180) / 360 * 2**z)
    lat = math.radians((south + north) / 2)
    y = int((1 - math.asinh(math.tan(lat)) / math.pi) / 2 * 2**z)
    url = tilejson["tiles"][0].format(z=z, x=x, y=y)
    assert picture(client.get(url).content)[..., 3].any()

    root = ElementTree.fromstring(client.get("/wmts.xml").content)
    ns = {"w": "http://www.opengis.net/wmts/1.0", "ows": "http://www.opengis.net/ows/1.1"}
    layers = {e.findtext("ows:Identifier", namespaces=ns): e for e in root.iterfind("w:Contents/w:Layer", ns)}
    assert {"map", "layer-sigma"} <= set(layers)
    template = layers["map"].find("w:ResourceURL", ns).get("template")
    url = template.replace("{TileMatrix}", str(z)).replace("{TileCol}", str(x)).replace("{TileRow}", str(y))
    assert picture(client.get(url).content)[..., 3].any()
    limits = layers["map"].findall(".//w:TileMatrixLimits", ns)[-1]
    [low, high] = (int(limits.findtext(f"w:{m}TileCol", namespaces=ns)) for m in ("Min", "Max"))
    assert limits.findtext("w:TileMatrix", namespaces=ns) == str(z) and low <= x <= high
    matrix = root.find("w:Contents/w:TileMatrixSet/w:TileMatrix", ns)
    assert float(matrix.findtext("w:ScaleDenominator", namespaces=ns)) == pytest.approx(559082264.0287178)


def test_the_number_of_a_layer_at_a_place(client, mission):
    west, south, east, north = client.get("/missions/1").json()["bounds"]
    lon, lat = (west + east) / 2, (south + north) / 2
    answer = client.get(f"/missions/1/layers/layer-sigma/value?x={lon}&y={lat}").json()
    with rasterio.open(mission / "layers" / "sigma.tif") as d:
        xy = Transformer.from_crs("EPSG:4326", d.crs, always_xy=True).transform(lon, lat)
        [wanted] = next(d.sample([xy], indexes=[1]))
    assert answer["value"] == pytest.approx(float(wanted))
    assert client.get("/missions/1/layers/layer-sigma/value?x=0&y=0").json()["value"] is None
    for query in ("", "x=1", "x=a&y=1", "x=nan&y=1", "x=1e400&y=0"):
        assert client.get(f"/missions/1/layers/layer-sigma/value?{query}").status_code == 400


@pytest.mark.parametrize(
    "path",
    [
        "/missions/2", "/missions/%2e%2e", "/missions/%2e%2e/frames.geojson", "/missions/1/layers/nope/0/0/0.png",
        "/missions/1/layers/map/99/0/0.png", "/missions/1/layers/map/1/2/0.png", "/missions/1/layers/map/1/-1/0.png",
        "/missions/1/layers/map/1/0/0.gif", "/missions/1/layers/map/a/0/0.png", "/missions/1/layers/map/1/0/0.png/..",
        "/missions/1/layers/map/99999999999999999999/0/0.png", "/tiles/1/0/\u0661.png", "/tiles/1/0/1e1.png",
        "/assets/..%2fapp.py", "/assets/%2e%2e", "/assets/%2fetc%2fpasswd", "/assets/nope.js", "/assets/dist%2fol.js",
        "/assets/page.js%00.txt", "/etc/passwd", "/missions/1/map.tif", "/.git/config",
    ],
)  # fmt: skip
def test_hostile_paths_get_a_404_that_says_nothing_of_the_disk(client, path):
    response = client.get(path)
    assert response.status_code == 404
    assert "/work" not in response.text and "Traceback" not in response.text


def test_only_reading(client):
    ours = {"origin": "http://127.0.0.1", "content-type": "application/json"}
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        for path in ("/missions/1", "/tiles/0/0/0.png"):
            assert client.request(method, path, headers=ours).status_code == 405
            assert client.request(method, path).status_code in (403, 415)


def test_a_foreign_name_for_this_machine_is_turned_away(client):
    for host in ("evil.example", "evil.example:8765", "127.0.0.1.evil.example", "", "[2001:db8::1]:80", "0.0.0.0"):
        assert client.get("/api", headers={"host": host}).status_code == 403
    for host in ("localhost", "localhost:8765", "127.0.0.1:1", "[::1]:8765"):
        response = client.get("/api", headers={"host": host})
        assert response.status_code == 200
        assert "access-control-allow-origin" not in response.headers


def test_the_token(mission):
    with client_of(mission, token="0123456789", local=False) as client:
        for path in ("/", "/api", "/missions/1", "/tiles/0/0/0.png", "/assets/page.js", "/nothing"):
            assert client.get(path).status_code == 401
            assert client.get(path + "?token=wrong").status_code == 401
            assert client.get(path + "?token=").status_code == 401
        assert client.get("/api?token=0123456789").status_code == 200
        assert client.get("/api", headers={"authorization": "Bearer 0123456789"}).status_code == 200
        assert client.get("/api", headers={"authorization": "Bearer \u00e9".encode()}).status_code == 401
        assert "token=0123456789" in client.get("/tiles.json?token=0123456789").json()["tiles"][0]
        assert "token=0123456789" in client.get("/wmts.xml?token=0123456789").text
        welcome = client.get("/?token=0123456789&x=1")
        assert welcome.status_code == 303 and welcome.headers["location"] == "/?x=1"
        cookie = welcome.headers["set-cookie"].lower()
        assert "httponly" in cookie and "samesite=strict" in cookie
        assert client.get("/api").status_code == 200  # the client keeps the cookie


def test_a_map_without_a_place_is_shown_in_its_own_pixels(relative):
    with client_of(relative) as client:
        document = client.get("/missions/1").json()
        assert not document["georeferenced"] and document["note"].startswith("not georeferenced")
        scheme = document["layers"][0]["scheme"]
        assert scheme["kind"] == "local"
        with rasterio.open(next(relative.glob("map*.tif"))) as d:
            rgba = d.read().transpose(1, 2, 0)
        tile = picture(client.get(f"/missions/1/layers/map/{scheme['max_zoom']}/0/0.png").content)
        wanted = rgba[: tile.shape[0], : tile.shape[1]]
        both = (tile[: wanted.shape[0], : wanted.shape[1], 3] > 0) & (wanted[..., 3] > 0)
        assert both.any()
        assert np.abs(tile[: wanted.shape[0], : wanted.shape[1]].astype(int) - wanted)[both].mean() < 1.0
        assert client.get("/tiles.json").status_code == client.get("/wmts.xml").status_code == 404
        assert client.get("/missions/1/frames.geojson").json()["coordinates"] == "local"


def test_every_piece_of_a_map_without_a_place_has_its_own_layers(relative):
    """Two pieces, by a mission folder that says so: the second is the first one's pixels under its own name."""
    with client_of(relative) as client:
        [first, *others] = client.get("/missions/1").json()["layers"]
    assert first["piece"] is not None and others == []
    assert main(["export", str(relative), "--layers", "-q"]) == 0
    view = open_view(relative)
    shutil.copytree(relative / "layers", relative / "layers-2")
    two = replace(view, mosaics=view.mosaics * 2, pieces=(*view.pieces, 7))
    layers = {layer.id: layer.piece for layer in mission_layers(two)}
    assert layers["map"] == layers["layer-views"] == view.pieces[0]
    assert layers["map-2"] == layers["layer-views-2"] == 7


def test_before_is_another_mission_or_a_geotiff(mission, relative, tmp_path):
    for before in (mission, mission / "map.tif"):
        with client_of(mission, before) as client:
            document = client.get("/missions/1").json()
            layer = document["layers"][-1]
            assert layer["role"] == "before"
            z = document["layers"][0]["scheme"]["max_zoom"] - 1
            west, south, east, north = document["bounds"]
            x = int(((west + east) / 2 + 180) / 360 * 2**z)
            y = int((1 - math.asinh(math.tan(math.radians((south + north) / 2))) / math.pi) / 2 * 2**z)
            a, b = (picture(client.get(f"/missions/1/layers/{i}/{z}/{x}/{y}.png").content) for i in ("map", "before"))
            assert shift_px(a, b) < 0.1
    for bad in (relative, tmp_path / "nothing.tif", tmp_path):
        with pytest.raises(DataError):
            client_of(mission, bad)
    (tmp_path / "text.tif").write_text("no raster")
    with pytest.raises(DataError):
        client_of(mission, tmp_path / "text.tif")


def test_a_changed_mission_is_told_to_listeners(mission):
    """The stream of events, by its own application: the test client cannot leave an endless answer."""
    import asyncio

    from photomap_gis.server.events import Events
    from photomap_gis.server.protocol import EventDocument

    async def listen() -> list[bytes]:
        events = Events()
        stream = events.stream([EventDocument(event="hello")])
        first = await anext(stream)
        events.send(EventDocument(event="mission", mission="1", epoch="abc"))
        second = await anext(stream)
        events.send(None)
        rest = [x async for x in stream]
        return [first, second, *rest]

    first, second = asyncio.run(listen())
    assert first.startswith(b"id: 1\nevent: hello\ndata: ") and first.endswith(b"\n\n")
    assert json.loads(second.split(b"data: ")[1]) == {"event": "mission", "mission": "1", "epoch": "abc"}


def test_the_protocol_document_names_every_address_and_field(client):
    text = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
    for route in client.app.routes:
        path = (
            route.path.replace("{mission}", "1")
            .replace("{layer}", "LAYER")
            .replace("{format}", "png")
            .replace("{find}", "ID")
        )
        assert path.startswith("/assets") or f"`{path}" in text, path
    document = client.get("/missions/1").json()
    layer = next(v for v in document["layers"] if v["legend"])
    frame = client.get("/missions/1/frames.geojson").json()["features"][0]["properties"]
    track = client.get("/missions/1/track.geojson").json()["features"][0]["properties"]
    for fields in (document, document["links"], layer, layer["scheme"], layer["legend"], frame, track):
        for field in fields:
            assert f"`{field}`" in text, field
