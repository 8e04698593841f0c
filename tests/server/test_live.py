"""A flight behind the server: what clients get of it, and that it is where and when it should be."""

import io
import json
import math
import shutil
import threading
from pathlib import Path
from typing import get_args
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from PIL import Image
from pyproj import Geod, Transformer
from shapely.geometry import shape
from starlette.testclient import TestClient

from photomap_gis.cli.serve_view import open_view
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.export.encode import TileFormat
from photomap_gis.server import Access, Host, create_app
from photomap_gis.server import live_documents as documents
from photomap_gis.server.live_layers import LiveLayer
from photomap_gis.server.live_levels import Levels
from photomap_gis.server.live_view import LinkState, RasterKind
from tests.server.live_fake import HEIGHT, KEY_EVERY, TILE, WIDTH, FakeRaster, FakeSession

HALF_WORLD_M = math.pi * 6378137.0
OURS = {"origin": "http://127.0.0.1", "content-type": "application/json"}


def client_of(session: FakeSession, token: str | None = None) -> TestClient:
    session.folder.mkdir(parents=True, exist_ok=True)
    host = Host(open_view)
    host.open_live(session)
    app = create_app(host, Access(token, loopback_only=True), watch_s=0.05)
    return TestClient(app, base_url="http://127.0.0.1", follow_redirects=False)


@pytest.fixture
def session(tmp_path) -> FakeSession:
    return FakeSession(tmp_path / "flight")


@pytest.fixture
def client(session):
    with client_of(session) as client:
        yield client


def picture(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))


def tile_of(lon: float, lat: float, z: int) -> tuple[int, int]:
    n = 1 << z
    y = (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2
    return int((lon + 180) / 360 * n), int(y * n)


def tiles_over(bounds, z: int) -> list[tuple[int, int]]:
    west, south, east, north = bounds
    (x0, y0), (x1, y1) = tile_of(west, north, z), tile_of(east, south, z)
    return [(x, y) for x in range(x0, x1 + 1) for y in range(y0, y1 + 1)]


def middle(client) -> tuple[float, float]:
    return tuple(client.get("/missions/1/live").json()["pose"]["centre"])


# The map


def test_before_the_first_picture_there_is_a_mission_that_shows_nothing(client):
    document = client.get("/missions/1").json()
    assert document["live"]["phase"] == "starting" and document["live"]["pose"] is None
    assert [layer["id"] for layer in document["layers"]] == ["map", "age", "sigma"]
    z = document["layers"][0]["scheme"]["max_zoom"]
    x, y = tile_of(*document["bounds"][:2], z)
    assert not picture(client.get(f"/tiles/{z}/{x}/{y}.png").content)[..., 3].any()
    assert client.get("/missions/1/track.geojson").json()["features"] == []
    coverage = client.get("/missions/1/live/coverage.geojson").json()
    assert coverage["share"] == 0.0 and coverage["covered_m2"] == 0.0


@pytest.mark.parametrize("frames", [1, 200])
def test_a_tile_puts_a_pixel_where_the_map_has_it(client, session, frames):
    """An independent way: bilinear samples of the raster at where PROJ says that a tile's pixels lie."""
    session.step(frames)
    z = client.get("/missions/1").json()["layers"][0]["scheme"]["max_zoom"]
    x, y = tile_of(*middle(client), z)
    served = picture(client.get(f"/missions/1/layers/map/{z}/{x}/{y}.png").content)
    raster = session.rasters[0]
    extent, g = raster.extent(), raster.lattice
    rgba = raster.read(extent)
    size = 2 * HALF_WORLD_M / (256 << z)
    col, row = np.meshgrid(np.arange(256) + 256 * x + 0.5, np.arange(256) + 256 * y + 0.5)
    to_map = Transformer.from_crs("EPSG:3857", g.crs_wkt, always_xy=True)
    e, n = to_map.transform(col * size - HALF_WORLD_M, HALF_WORLD_M - row * size)
    px = (e - g.west) / g.pixel_size - 0.5 - extent.col_off
    py = (g.north - n) / g.pixel_size - 0.5 - extent.row_off
    wanted = np.dstack(
        [cv2.remap(np.ascontiguousarray(rgba[..., k]), px.astype(np.float32), py.astype(np.float32), 1)
         for k in range(4)]
    )  # fmt: skip
    seen = (served[..., 3] > 250) & (wanted[..., 3] > 250)
    assert seen.mean() > 0.3
    a, b = (np.where(seen, v[..., 1], v[..., 1][seen].mean()).astype(np.float64) for v in (served, wanted))
    (dx, dy), _ = cv2.phaseCorrelate(a, b)
    assert math.hypot(dx, dy) < 0.1


def test_coarser_tiles_are_the_mean_of_finer_ones_and_as_fresh(client, session):
    session.step(120)
    scheme = client.get("/missions/1").json()["layers"][0]["scheme"]
    fine, coarse = scheme["max_zoom"], scheme["max_zoom"] - 3
    for _ in range(2):
        x, y = tile_of(*middle(client), coarse)
        got = picture(client.get(f"/tiles/{coarse}/{x}/{y}.png").content)
        rows = [
            np.concatenate(
                [picture(client.get(f"/tiles/{fine}/{8 * x + c}/{8 * y + r}.png").content) for c in range(8)], axis=1
            )
            for r in range(8)
        ]
        whole = np.concatenate(rows)
        small = cv2.resize(whole, (256, 256), interpolation=cv2.INTER_AREA)
        full = (small[..., 3] == 255) & (got[..., 3] == 255)
        assert full.mean() > 0.02
        assert np.abs(small.astype(int) - got)[full][:, :3].mean() < 3.0
        session.step(40)  # new ground: the overview must show it as the fine tiles do


def test_only_what_changed_travels(client, session):
    session.step(200)
    document = client.get("/missions/1").json()
    z = document["layers"][0]["scheme"]["max_zoom"]
    addresses = [f"/missions/1/layers/map/{z}/{x}/{y}.webp" for x, y in tiles_over(document["bounds"], z)]
    first = {a: client.get(a).headers["etag"] for a in addresses}
    for a in addresses:
        assert client.get(a, headers={"if-none-match": first[a]}).status_code == 304
    session.step(9)
    again = {a: client.get(a, headers={"if-none-match": first[a]}).status_code for a in addresses}
    changed = [a for a, status in again.items() if status == 200]
    assert 0 < len(changed) < 0.6 * len(addresses)
    for a in changed:
        assert client.get(a).headers["etag"] != first[a]


def test_the_tiles_event_names_every_tile_that_changed(client, session):
    session.step(200)
    told = []
    host_mission = client.app.state.end_streams.__self__.get("1")
    document = client.get("/missions/1").json()
    z = document["layers"][0]["scheme"]["max_zoom"]
    before = {t: client.get(f"/tiles/{z}/{t[0]}/{t[1]}.png").headers["etag"] for t in tiles_over(document["bounds"], z)}
    session.subscribe(lambda event: told.append(host_mission._document(event)))
    session.step(17)
    areas = [a for d in told if d is not None and d.event == "tiles" for a in d.areas]
    assert areas
    named = {t for area in areas for t in tiles_over(area, z)}
    for t, etag in before.items():
        if client.get(f"/tiles/{z}/{t[0]}/{t[1]}.png").headers["etag"] != etag:
            assert any(abs(t[0] - a[0]) <= 1 and abs(t[1] - a[1]) <= 1 for a in named), t


def test_a_map_that_leaves_its_arena_gets_a_larger_one(rng):
    """Pixels lie where they lay, at every level, also where the window reaches over the arena's edge."""
    lattice = MapGrid(None, 0.0, 0.0, 1.0, TILE, TILE, TILE)
    raster = FakeRaster(RasterKind.MAP, lattice)
    seen = np.ones((300, 400), bool)
    pixels = rng.integers(0, 255, (300, 400, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    raster.paste(Window(-700, 900, 400, 300), pixels, seen, 1)
    small, large = Levels(raster, lambda p: p, 1024), Levels(raster, lambda p: p, 4096)
    assert small.holds(Window(-1024, -1024, 2048, 2048)) and not small.holds(raster.extent()._replace(width=3000))
    for level in range(3):
        f = 1 << level
        window = Window(-704 // f, 900 // f, 440 // f, 300 // f)
        a = small.read(level, window._replace(col_off=window.col_off + 1024 // f, row_off=window.row_off + 1024 // f))
        b = large.read(level, window._replace(col_off=window.col_off + 4096 // f, row_off=window.row_off + 4096 // f))
        inside = slice(0, 124 // f)  # the small arena ends at row 1024
        assert np.array_equal(a[inside], b[inside]) and b[..., 3].any()
    layer = LiveLayer(raster)
    assert layer.tile(13, *(1 << 12,) * 2, TileFormat.PNG).version == 0
    raster.paste(Window(1 << 18, 0, 400, 300), pixels, seen, 2)
    tile = layer.tile(13, (1 << 12) + (1 << 10), 1 << 12, TileFormat.PNG)
    assert tile.version == 2 and np.array_equal(picture(tile.data), pixels[:256, :256])


def test_numbers_have_colours_and_values(client, session):
    session.step(300)
    document = client.get("/missions/1").json()
    age = next(layer for layer in document["layers"] if layer["id"] == "age")
    assert age["legend"]["low"] == 0.0 and age["legend"]["high"] >= 300 / 30 / 60
    lon, lat = middle(client)
    value = client.get(f"/missions/1/layers/age/value?x={lon}&y={lat}").json()
    assert value["units"] == "s ago" and 0.0 <= value["value"] <= KEY_EVERY / 30
    assert client.get("/missions/1/layers/age/value?x=0&y=0").json()["value"] is None
    x, y = tile_of(lon, lat, age["scheme"]["max_zoom"])
    url = age["tiles"].replace("{z}", str(age["scheme"]["max_zoom"])).replace("{x}", str(x)).replace("{y}", str(y))
    assert picture(client.get("/" + url).content)[..., 3].any()


def test_wmts_of_a_flight_leaves_room_for_what_it_will_see(client, session):
    session.step(40)
    document = client.get("/missions/1").json()
    root = ElementTree.fromstring(client.get("/" + document["links"]["wmts"]).content)
    ns = {"w": "http://www.opengis.net/wmts/1.0", "ows": "http://www.opengis.net/ows/1.1"}
    layers = {e.findtext("ows:Identifier", namespaces=ns): e for e in root.iterfind("w:Contents/w:Layer", ns)}
    assert set(layers) == {layer["id"] for layer in document["layers"]}
    assert not layers["map"].findall(".//w:TileMatrixLimits", ns)
    west, south = map(float, layers["map"].findtext("ows:WGS84BoundingBox/ows:LowerCorner", namespaces=ns).split())
    session.step(100)  # the drone flies on: what is seen then lies within what the client was told
    after = client.get("/missions/1").json()
    bounds = after["layers"][0]["scheme"]["bounds"]
    assert west < bounds[0] and south < bounds[1]
    z = after["layers"][0]["scheme"]["max_zoom"]
    x, y = tile_of(*after["live"]["pose"]["centre"], z)
    template = layers["map"].find("w:ResourceURL", ns).get("template")
    url = template.replace("{TileMatrix}", str(z)).replace("{TileCol}", str(x)).replace("{TileRow}", str(y))
    assert picture(client.get(url).content)[..., 3].any()


def test_the_map_without_a_place_and_the_moment_it_snaps(tmp_path):
    session = FakeSession(tmp_path / "flight", georeferenced=False)
    with client_of(session) as client:
        session.step(100)
        document = client.get("/missions/1").json()
        scheme = document["layers"][0]["scheme"]
        assert not document["georeferenced"] and document["note"] and scheme["kind"] == "local"
        assert client.get("/missions/1/wmts.xml").status_code == 404
        x, y = document["live"]["pose"]["centre"]
        size = scheme["unit_per_px"]
        tx, ty = (int(abs(v - o) / size // 256) for v, o in zip((x, y), scheme["origin_xy"], strict=True))
        tile = picture(client.get(f"/tiles/{scheme['max_zoom']}/{tx}/{ty}.png").content)
        assert tile[..., 3].any()
        for name in ("kml", "gpx", "cot"):
            assert client.get(f"/missions/1/finds.{name}").status_code == 404
        find = client.post("/missions/1/finds", json={"kind": "hazard", "place": [x, y]}, headers=OURS).json()
        assert find["xy_map"] == [x, y] and find["lon_lat"] is None and find["ce90_m"] is None
        local = client.get("/missions/1/finds.geojson").json()
        assert local["coordinates"] == "local" and local["features"][0]["geometry"]["coordinates"] == [x, y]

        session.snap()
        after = client.get("/missions/1").json()
        assert after["georeferenced"] and after["epoch"] != document["epoch"]
        for _ in range(200):  # finds follow in a thread of their own
            [moved] = client.get("/missions/1/finds.geojson").json()["features"]
            if moved["geometry"] is not None:
                break
        lon, lat = moved["geometry"]["coordinates"]
        wanted = after["live"]["pose"]["centre"]
        assert Geod(ellps="WGS84").inv(lon, lat, *wanted)[2] < 8.0  # it was the pose's place, which had drifted
        assert moved["properties"]["ce90_m"] > 0
        z = after["layers"][0]["scheme"]["max_zoom"]
        tx, ty = tile_of(*wanted, z)
        assert picture(client.get(f"/tiles/{z}/{tx}/{ty}.png").content)[..., 3].any()


# What is known besides


def test_the_pose_tells_where_the_drone_is_and_how_sure(client, session):
    session.step(50)
    pose = client.get("/missions/1/live").json()["pose"]
    lon, lat = session._lon_lat([(session.drift @ session.truth(49)).translation])[0]
    assert Geod(ellps="WGS84").inv(*pose["centre"], lon, lat)[2] < 0.1
    sides = [Geod(ellps="WGS84").inv(*pose["footprint"][i], *pose["footprint"][i + 1])[2] for i in (0, 1)]
    assert sides == pytest.approx([WIDTH * 0.08, HEIGHT * 0.08], rel=2e-3)
    e = pose["ellipse"]
    assert e["major"] > e["minor"] > 0 and e["ce90"] == pytest.approx(1.5175 * math.hypot(e["major"], e["minor"]), 1e-2)
    # the placement's larger sigma is along the picture's x: square to where its top points
    off = (e["bearing_deg"] - pose["heading_deg"] - 90) % 180
    assert min(off, 180 - off) < 1.0
    session.lose()
    session.step(1)
    waiting = client.get("/missions/1/live").json()
    assert waiting["pose"]["centre"] is None and waiting["pose"]["drone"] and waiting["health"]["link"] == "lost"


def test_accuracy_at_a_place(client, session):
    session.step(50)
    lon, lat = middle(client)
    e = client.get(f"/missions/1/live/accuracy?x={lon}&y={lat}").json()["ellipse"]
    values = np.linalg.eigvalsh([[0.9, 0.3], [0.3, 0.4]])
    assert [e["minor"], e["major"]] == pytest.approx(np.sqrt(values), abs=1e-3)
    assert 90 < e["bearing_deg"] < 180  # x east, y south: the long axis runs to the south-east
    assert client.get("/missions/1/live/accuracy?x=0&y=0").json()["ellipse"] is None
    for query in ("", "?x=1", "?x=a&y=2"):
        assert client.get(f"/missions/1/live/accuracy{query}").status_code == 400
    assert client.get("/missions/1/live/accuracy?x=nan&y=1e999").json()["ellipse"] is None


def test_coverage_is_what_the_footprints_cover(client, session):
    session.step(240)
    answer = client.get("/missions/1/live/coverage.geojson")
    document = answer.json()
    raster = session.rasters[0]
    seen_px = (raster.read(raster.extent())[..., 3] > 0).sum()
    assert document["covered_m2"] == pytest.approx(seen_px * 0.08**2, rel=0.02)
    kinds = {f["properties"]["kind"]: f["geometry"] for f in document["features"]}
    assert set(kinds) == {"covered", "area", "gaps"} and 0.2 < document["share"] < 0.95
    geod = Geod(ellps="WGS84")
    area, gaps = (abs(geod.geometry_area_perimeter(shape(kinds[k]))[0]) for k in ("area", "gaps"))
    assert document["area_m2"] == pytest.approx(area, rel=5e-3)
    assert gaps == pytest.approx((1 - document["share"]) * area, rel=0.05)
    etag = answer.headers["etag"]
    assert client.get("/missions/1/live/coverage.geojson", headers={"if-none-match": etag}).status_code == 304


def test_the_stabilised_view_is_made_only_while_somebody_looks(client, session):
    session.step(10)
    assert session.watchers == []
    stop = threading.Event()

    def fly() -> None:
        while not stop.is_set():
            session.step()
            stop.wait(0.005)

    flight = threading.Thread(target=fly)
    flight.start()
    try:
        first = client.get("/missions/1/live/view.jpg")
        assert first.status_code == 200 and first.headers["content-type"] == "image/jpeg"
        words = json.loads(first.headers["photomap-view"])
        second = client.get(f"/missions/1/live/view.jpg?after={words['sequence']}")
        assert json.loads(second.headers["photomap-view"])["sequence"] > words["sequence"]
        assert client.get("/missions/1/live/view.jpg?after=x").status_code == 400
    finally:
        stop.set()
        flight.join()
    assert len(session.watchers) == 1  # one for all who look
    image = np.asarray(Image.open(io.BytesIO(first.content)))
    nw, ne, se, _ = (np.array(c) for c in words["corners"])
    width_m = Geod(ellps="WGS84").inv(*nw, *ne)[2]
    assert width_m == pytest.approx(image.shape[1] * 0.08 * 1.6, rel=2e-3) and nw[1] > se[1]


def test_what_cannot_be_is_told(client, session):
    session.step(20)
    assert client.get("/tiles.json").json()["tiles"][0].endswith("/missions/1/layers/map/{z}/{x}/{y}.png")
    for path in ("/missions/1/layers/nope/0/0/0.png", "/missions/1/layers/map/99/0/0.png",
                 "/missions/1/layers/map/1/2/0.png", "/missions/1/layers/map/1/0/0.gif", "/missions/2/live",
                 "/missions/2/live/events", "/missions/1/layers/map/a/0/0.png"):  # fmt: skip
        assert client.get(path).status_code == 404, path
    assert client.get("/missions/1/frames.geojson").json()["features"] == []


# The end


def test_ending_is_for_those_who_may(client, session):
    session.step(5)
    for headers in ({}, {"origin": "http://evil.example"}, {"content-type": "application/json"},
                    {"origin": "null", "content-type": "application/json"}):  # fmt: skip
        assert client.post("/missions/1/live/finalise", headers=headers).status_code in (403, 415)
    assert session.finalised == 0
    assert client.post("/missions/1/live/finalise", json={}, headers=OURS).status_code == 202
    assert session.finalised == 1
    state = client.get("/missions/1/live").json()
    assert state["phase"] == "finalising" and state["end"]["progress"] == 0.0
    session.progress(0.5)
    assert client.get("/missions/1/live").json()["end"]["progress"] == 0.5


def test_a_flight_that_has_ended_is_a_mission_like_any_other(mission, tmp_path):
    folder = tmp_path / "flight"
    shutil.copytree(mission, folder)
    session = FakeSession(folder)
    with client_of(session) as client:
        session.step(20)
        place = middle(client)
        client.post("/missions/1/finds", json={"kind": "victim", "place": place}, headers=OURS)
        session.lose(LinkState.ENDED)
        session.finalise()
        session.progress(1.0)
        for _ in range(500):
            document = client.get("/missions/1").json()
            if document["live"] is None:
                break
        assert document["live"] is None and document["name"] == "flight" and document["frames"]["total"] == 6
        assert client.get("/missions/1/live").status_code == 404
        [find] = client.get("/missions/1/finds.geojson").json()["features"]
        assert find["properties"]["kind"] == "victim"
        assert session.listeners == []


def test_a_document_is_of_one_moment_though_the_map_snaps_in_the_middle(tmp_path, monkeypatch):
    """A page that began with half of each would draw degrees on a map of pixels."""
    session = FakeSession(tmp_path / "flight", georeferenced=False)
    with client_of(session) as client:
        session.step(20)
        states = []
        plain = FakeSession.state.fget

        def snapping(self):
            states.append(plain(self))
            if len(states) == 2:
                self.snap()
            return states[-1]

        monkeypatch.setattr(FakeSession, "state", property(snapping))
        document = client.get("/missions/1").json()
    assert document["georeferenced"] == document["live"]["georeferenced"]
    assert document["epoch"] == document["live"]["epoch"]
    assert (document["layers"][0]["scheme"]["kind"] == "webmercator") == document["georeferenced"]
    assert document["layers"][0]["tiles"].split("epoch=")[1].split("-")[0] == document["epoch"]


def test_the_protocol_document_names_every_field():
    text = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
    models = [v for v in vars(documents).values() if isinstance(v, type) and issubclass(v, documents.Document)]
    assert len(models) >= 10
    for model in models:
        for field in model.model_fields:
            assert f"`{field}`" in text, (model.__name__, field)
        for name in get_args(model.model_fields["event"].annotation) if "event" in model.model_fields else ():
            assert f"`{name}`" in text, name
