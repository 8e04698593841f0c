"""``photomap finds``: listed, written, refused in words; and finds of the page in exports of the mission."""

import json
from xml.etree import ElementTree

import pytest

from photomap_gis.cli import main
from photomap_gis.core.find import FindKind
from photomap_gis.export.cot import cot_find
from photomap_gis.export.finds import read_finds
from photomap_gis.find_store import FindStore

WHEN = "2026-05-01T10:00:00Z"


@pytest.fixture
def folder(tmp_path):
    store = FindStore(tmp_path)
    store.add(FindKind.VICTIM, time_utc=WHEN, note="by the car", lon_lat=(9.123456, 48.5), ce90_m=1.7, jpeg=b"\xff\xd8")
    store.add(FindKind.HAZARD, time_utc=WHEN, lon_lat=(9.2, 48.6))
    store.add(FindKind.OTHER, time_utc=WHEN, xy_map=(10.0, 20.0))
    return tmp_path


def test_listed(folder, capsys):
    assert main(["finds", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        f"Victim 1  48.500000, 9.123456  CE90 1.7 m  {WHEN}  by the car", f"Hazard 1  48.600000, 9.200000  {WHEN}"
    ]  # fmt: skip
    assert err.startswith("1 of the finds have no place on Earth")


def test_written_and_read_back(folder, capsys):
    names = [folder / f"out.{suffix}" for suffix in ("geojson", "kml", "gpx", "cot")]
    assert main(["finds", str(folder), "--json", *(a for n in names for a in ("-o", str(n)))]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [f["properties"]["kind"] for f in document["features"]] == ["victim", "hazard"]
    for name in names[:3]:
        finds = read_finds(name)
        assert [(f.name, round(f.lon_deg, 6), round(f.lat_deg, 6)) for f in finds] == [
            ("Victim 1", 9.123456, 48.5), ("Hazard 1", 9.2, 48.6)
        ]  # fmt: skip
    assert "<when>2026-05-01T10:00:00Z</when>" in names[1].read_text()
    events = ElementTree.parse(names[3]).getroot()
    assert [e.find("point").get("ce") for e in events] == ["1.70", "9999999.0"]
    again = ElementTree.fromstring(names[3].read_text())
    assert [e.get("uid") for e in again] == [e.get("uid") for e in events]


def test_refused_in_words(folder, tmp_path_factory, capsys):
    assert main(["finds", str(folder), "-o", str(folder / "x.txt")]) == 2
    assert ".gpx" in capsys.readouterr().err
    empty = tmp_path_factory.mktemp("empty")
    assert main(["finds", str(empty)]) == 3
    assert main(["finds", str(empty / "nowhere")]) == 3
    assert main(["finds", str(folder), "-o", str(empty / "no" / "x.kml")]) == 3
    (folder / "finds.geojson").write_text("{}")
    assert main(["finds", str(folder)]) == 3


def test_no_find_is_no_fault(tmp_path, capsys):
    store = FindStore(tmp_path)
    store.remove(store.add(FindKind.OTHER, time_utc=WHEN, lon_lat=(1.0, 2.0)).id)
    assert main(["finds", str(tmp_path), "-o", str(tmp_path / "none.kml")]) == 0
    ElementTree.parse(tmp_path / "none.kml")
    assert "0 finds" in capsys.readouterr().err


def test_a_find_is_the_same_thing_in_files_and_on_devices_whatever_else_is_taken_away(folder):
    """Devices show an event with the same identifier once: numbers in a list would rename what stays."""
    name = folder / "out.cot"
    assert main(["finds", str(folder), "-o", str(name)]) == 0
    before = {e.find("detail/contact").get("callsign"): e.get("uid") for e in ElementTree.parse(name).getroot()}
    assert before == {f.name: cot_find(f).uid for f in read_finds(folder / "finds.geojson")}
    store = FindStore(folder)
    store.remove(store.all()[0].id)
    assert [cot_find(f).uid for f in read_finds(folder / "finds.geojson")] == [before["Hazard 1"]]
