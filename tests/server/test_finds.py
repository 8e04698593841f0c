"""Finds over HTTP: marked, changed, taken along; and no to everybody else."""

import io
import json
import math
from xml.etree import ElementTree

import numpy as np
import pyogrio
import pytest
import rasterio
from PIL import Image
from pyproj import Geod, Transformer
from shapely import from_wkb, get_coordinates

from photomap_gis.cli.serve_view import open_view
from photomap_gis.core.accuracy import CE90_PER_RMSE_R
from photomap_gis.find_store import FindStore
from tests.server.clients import client_of
from tests.server.live_fake import FakeSession
from tests.server.test_live import OURS, middle
from tests.server.test_live import client_of as live_client_of

ROOT = "/missions/1/finds"


@pytest.fixture
def flown(tmp_path):
    session = FakeSession(tmp_path / "flight")
    with live_client_of(session) as client:
        session.step(60)
        yield session, client


def test_a_find_has_its_place_its_accuracy_and_a_picture(flown):
    session, client = flown
    lon, lat = middle(client)
    answer = client.post(ROOT, json={"kind": "victim", "place": [lon, lat], "note": "waves ✋ <b>"}, headers=OURS)
    assert answer.status_code == 201
    find = answer.json()
    assert find["name"] == "Victim 1" and find["lon_lat"] == [lon, lat] and find["note"] == "waves ✋ <b>"
    assert find["ce90_m"] == pytest.approx(CE90_PER_RMSE_R * math.sqrt(1.3), abs=0.01)
    snapshot = client.get(f"{ROOT}/{find['id']}.jpg")
    seen = np.asarray(Image.open(io.BytesIO(snapshot.content)).convert("RGB")).astype(int)
    xy = session.true_frame.from_crs(
        [Transformer.from_crs(4326, session.ground.crs_wkt, always_xy=True).transform(lon, lat)]
    )
    anchor = session.anchor_at(tuple(xy[0]))
    wanted = session.picture_at(anchor).astype(int)
    assert seen.shape == wanted.shape and np.abs(seen - wanted).mean() < 6  # JPEG
    assert (session.folder / "finds" / f"{find['id']}.jpg").read_bytes() == snapshot.content

    second = client.post(ROOT, json={"kind": "victim", "place": [lon, lat], "name": " Roof "}, headers=OURS).json()
    third = client.post(ROOT, json={"kind": "victim", "place": [lon, lat]}, headers=OURS).json()
    assert (second["name"], third["name"]) == ("Roof", "Victim 2")
    changed = client.patch(f"{ROOT}/{second['id']}", json={"note": "empty", "kind": "hazard"}, headers=OURS).json()
    assert (changed["kind"], changed["note"], changed["name"]) == ("hazard", "empty", "Roof")
    assert client.delete(f"{ROOT}/{third['id']}", headers=OURS).status_code == 204
    assert client.delete(f"{ROOT}/{third['id']}", headers=OURS).status_code == 404
    left = client.get(f"{ROOT}.geojson").json()["features"]
    assert [f["properties"]["name"] for f in left] == ["Victim 1", "Roof"]
    assert sorted(p.stem for p in (session.folder / "finds").iterdir()) == sorted([find["id"], second["id"]])


def test_finds_go_along_when_the_solution_moves_the_map(flown):
    session, client = flown
    place = middle(client)
    id = client.post(ROOT, json={"kind": "intruder", "place": place}, headers=OURS).json()["id"]
    mission = client.app.state.end_streams.__self__.get("1")
    anchor = FindStore(session.folder).get(id).anchor
    session.solve()
    client.app.state.end_streams.__self__._moved(mission)  # what the thread does, done here at the latest
    moved = FindStore(session.folder).get(id)
    x, y = session.place_of(anchor)
    lon, lat = session._lon_lat([(x, y)])[0]
    assert Geod(ellps="WGS84").inv(*moved.lon_lat, lon, lat)[2] < 0.01
    assert Geod(ellps="WGS84").inv(*moved.lon_lat, *place)[2] > 1.0  # and it did move


def test_files_for_other_programs(flown, tmp_path):
    _, client = flown
    lon, lat = middle(client)
    for kind, note in (("intruder", "a & b"), ("hazard", "wire \u0001 here")):
        body = {"kind": kind, "place": [lon, lat], "note": note}
        assert client.post(ROOT, json=body, headers=OURS).status_code == 201
    for suffix, layer in (("kml", "flight 7: finds"), ("gpx", "waypoints"), ("geojson", None)):
        answer = client.get(f"{ROOT}.{suffix}")
        path = tmp_path / f"finds.{suffix}"
        path.write_bytes(answer.content)
        layers = [name for name, _ in pyogrio.list_layers(path)]
        meta, _, wkb, columns = pyogrio.raw.read(path, layer=layer if layer in layers else layers[0])
        assert np.allclose(get_coordinates(from_wkb(wkb)), [(lon, lat)] * 2, rtol=0, atol=1e-7), suffix
        fields = {str(n).lower(): list(c) for n, c in zip(meta["fields"], columns, strict=True)}
        assert fields["name"] == ["Intruder 1", "Hazard 1"]
    events = ElementTree.fromstring(client.get(f"{ROOT}.cot").content)
    assert [e.get("version") for e in events] == ["2.0", "2.0"] and len({e.get("uid") for e in events}) == 2
    assert events[0].find("detail/contact").get("callsign") == "Intruder 1"
    assert float(events[0].find("point").get("ce")) > 0
    assert "attachment" in client.get(f"{ROOT}.kml").headers["content-disposition"]


def test_a_finished_mission_takes_finds_too(mission):
    view = open_view(mission)
    with rasterio.open(mission / "map.tif") as d:
        centre = (d.bounds.left + d.bounds.right) / 2, (d.bounds.bottom + d.bounds.top) / 2
        lon, lat = Transformer.from_crs(d.crs, 4326, always_xy=True).transform(*centre)
        row, col = d.index(*centre)
        under = d.read([1, 2, 3])[:, row - 20 : row + 20, col - 20 : col + 20].reshape(3, -1).mean(axis=1)
    try:
        with client_of(mission) as client:
            find = client.post(ROOT, json={"kind": "other", "place": [lon, lat]}, headers=OURS).json()
            assert 0 < find["ce90_m"] < 50 and find["snapshot"]
            picture = np.asarray(Image.open(io.BytesIO(client.get(f"{ROOT}/{find['id']}.jpg").content)))
            h, w = picture.shape[:2]
            middle_ = picture[h // 2 - 20 : h // 2 + 20, w // 2 - 20 : w // 2 + 20].reshape(-1, 3).mean(axis=0)
            assert np.abs(middle_ - under).max() < 12
            far = client.post(ROOT, json={"kind": "other", "place": [lon + 1, lat]}, headers=OURS).json()
            assert far["ce90_m"] is None and not far["snapshot"]
            assert client.get(f"{ROOT}/{far['id']}.jpg").status_code == 404
            assert view.georeferenced
    finally:
        (mission / "finds.geojson").unlink(missing_ok=True)
        for picture_path in (mission / "finds").glob("*"):
            picture_path.unlink()
        (mission / "finds").rmdir()


FOREIGN = [
    {},
    {"origin": "http://evil.example"},
    {"origin": "null"},
    {"origin": "http://127.0.0.1:81"},
    {"origin": "https://127.0.0.1.evil.example"},
    {"origin": "http://127.0.0.1", "sec-fetch-site": "cross-site"},
    {"origin": "http://127.0.0.1", "sec-fetch-site": "same-site"},
    {"referer": "http://127.0.0.1/"},
]


@pytest.mark.parametrize("headers", FOREIGN)
def test_another_page_cannot_write(flown, headers):
    session, client = flown
    body = json.dumps({"kind": "other", "place": middle(client)})
    for kind in ("application/json", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        sent = {**headers, "content-type": kind}
        assert client.post(ROOT, content=body, headers=sent).status_code in (403, 415)
        assert client.request("PATCH", f"{ROOT}/f-1", content=body, headers=sent).status_code in (403, 415)
    assert client.delete(f"{ROOT}/f-1", headers=headers).status_code == 403
    preflight = client.options(ROOT, headers={**headers, "access-control-request-method": "POST"})
    assert "access-control-allow-origin" not in preflight.headers
    assert not (session.folder / "finds.geojson").exists()


def test_our_page_without_json_is_no_request_of_ours(flown):
    _, client = flown
    body = json.dumps({"kind": "other", "place": middle(client)})
    for kind in ("text/plain", "application/jsonx", ""):
        answer = client.post(ROOT, content=body, headers={"origin": "http://127.0.0.1", "content-type": kind})
        assert answer.status_code == 415


def test_a_foreign_host_cannot_write_even_with_its_own_origin(flown):
    _, client = flown
    evil = {"host": "evil.example", "origin": "http://evil.example", "content-type": "application/json"}
    assert client.post(ROOT, json={"kind": "other", "place": [0, 0]}, headers=evil).status_code == 403


def test_with_a_token_the_token_or_the_page_that_has_it_writes(tmp_path):
    session = FakeSession(tmp_path / "flight")
    with live_client_of(session, token="0123456789") as client:
        session.step(20)
        place = client.get("/missions/1/live?token=0123456789").json()["pose"]["centre"]
        body = {"kind": "other", "place": place}
        assert client.post(ROOT, json=body, headers=OURS).status_code == 401
        assert client.post(f"{ROOT}?token=wrong", json=body, headers=OURS).status_code == 401
        assert client.post(f"{ROOT}?token=0123456789", json=body).status_code == 201
        assert client.post(ROOT, json=body, headers={"authorization": "Bearer 0123456789"}).status_code == 201
        client.get("/?token=0123456789")  # the browser keeps the cookie
        assert client.post(ROOT, json=body, headers={"origin": "http://evil.example"}).status_code == 403
        assert client.post(ROOT, json=body, headers=OURS).status_code == 201


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{}", b"[]", b"null", b"{", b"\xff\xfe", b"[" * 10000, b'{"kind":"victim"}',
        b'{"kind":"friend","place":[9,48]}', b'{"kind":"victim","place":[9]}', b'{"kind":"victim","place":[9,NaN]}',
        b'{"kind":"victim","place":[9,1e999]}', b'{"kind":"victim","place":["a",48]}',
        b'{"kind":"victim","place":[9,48],"id":"x"}', b'{"kind":"victim","place":[9,91]}',
        b'{"kind":"victim","place":[9,48],"note":"' + b"x" * 2001 + b'"}',
        b'{"kind":"victim","place":[9,48],"name":["a"]}',
    ],
)  # fmt: skip
def test_hostile_bodies_get_a_400_with_words(flown, body):
    session, client = flown
    answer = client.post(ROOT, content=body, headers=OURS)
    assert answer.status_code == 400 and answer.json()["message"] and "Traceback" not in answer.text
    assert not (session.folder / "finds.geojson").exists()


def test_too_large_a_body_is_not_read_to_its_end(flown):
    _, client = flown
    assert client.post(ROOT, content=b" " * 40000, headers=OURS).status_code == 413


@pytest.mark.parametrize("id", ["nope", "..", "%2e%2e", "..%2f..%2fmission", "f-%00", "a" * 60, "%2fetc%2fpasswd"])
def test_names_of_finds_are_no_paths(flown, id):
    session, client = flown
    (session.folder / "mission.jpg").write_bytes(b"secret")
    for answer in (
        client.get(f"{ROOT}/{id}.jpg"),
        client.request("PATCH", f"{ROOT}/{id}", json={"note": "x"}, headers=OURS),
        client.delete(f"{ROOT}/{id}", headers=OURS),
    ):
        assert answer.status_code in (404, 405) and b"secret" not in answer.content


def test_a_damaged_file_is_not_overwritten(flown):
    session, client = flown
    (session.folder / "finds.geojson").write_text("[" * 100)
    assert client.get(f"{ROOT}.geojson").json()["features"] == []
    answer = client.post(ROOT, json={"kind": "other", "place": middle(client)}, headers=OURS)
    assert answer.status_code >= 400 and str(session.folder) not in answer.text
    assert (session.folder / "finds.geojson").read_text() == "[" * 100
