"""The package: all that a commander needs, true checksums, the same bytes each time, small enough for a link."""

import hashlib
import json
import shutil
import sqlite3
import zipfile

import pytest
import rasterio
from click.testing import CliRunner

from photomap_gis.cli.app import cli
from photomap_gis.core.errors import DataError, OutputError, UsageError
from photomap_gis.core.find import FindKind
from photomap_gis.find_store import FindStore
from photomap_gis.pipeline.package import package_mission, parse_size

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole(mapped, tmp_path_factory):
    out = tmp_path_factory.mktemp("package") / "handover.zip"
    return out, package_mission(mapped.folder, out)


def test_it_holds_map_vectors_page_and_true_checksums(whole, tmp_path):
    out, summary = whole
    with zipfile.ZipFile(out) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path)
    assert names[0] == "summary.html" and names[-1] == "SHA256SUMS"
    assert {"map.tif", "map.kmz", "map.mbtiles", "vectors.gpkg", "poses.csv"} <= set(names)
    lines = (tmp_path / "SHA256SUMS").read_text().splitlines()
    assert {line.split("  ")[1] for line in lines} == set(names) - {"SHA256SUMS"}
    for line in lines:
        digest, name = line.split("  ")
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    html = (tmp_path / "summary.html").read_text()
    assert "data:image/jpeg;base64," in html and "Predicted CE90" in html and "It is a prediction" in html
    assert summary.lost == () and summary.bytes == out.stat().st_size
    assert summary.frames["total"] == 14 and summary.frames["used"] == summary.frames["by_status"]["registered"]
    assert sum(summary.frames["segment_frames"]) == summary.frames["by_status"]["registered"]


def test_the_same_mission_gives_the_same_bytes(whole, mapped, tmp_path):
    out, _ = whole
    package_mission(mapped.folder, tmp_path / "handover.zip")
    assert (tmp_path / "handover.zip").read_bytes() == out.read_bytes()


@pytest.mark.parametrize("share", [0.6, 0.2])
def test_a_limit_is_kept_and_what_it_cost_is_said(whole, mapped, tmp_path, share):
    limit = int(whole[1].bytes * share)
    out = tmp_path / "small.zip"
    summary = package_mission(mapped.folder, out, max_bytes=limit)
    assert out.stat().st_size <= limit
    assert summary.lost and "loss" in summary.lost[0]
    with zipfile.ZipFile(out) as archive:
        archive.extractall(tmp_path)
        html = archive.read("summary.html").decode()
    assert all(line in html for line in summary.lost)
    with rasterio.open(tmp_path / "map.tif") as dataset:
        assert dataset.compression.name == "jpeg"
        assert dataset.res[0] == pytest.approx(summary.gsd_m_per_px, rel=1e-3)


def test_a_limit_that_nothing_can_keep_says_so_and_leaves_no_file(mapped, tmp_path):
    with pytest.raises(OutputError, match="raise --max-size"):
        package_mission(mapped.folder, tmp_path / "tiny.zip", max_bytes=2000)
    assert list(tmp_path.iterdir()) == []


def test_finds_come_with_a_piece_of_the_map(mapped, tmp_path):
    folder = tmp_path / "m"
    shutil.copytree(mapped.folder, folder)
    with rasterio.open(folder / "map.tif") as dataset:
        from rasterio.warp import transform

        x, y = dataset.xy(dataset.height // 2, dataset.width // 2)
        lon, lat = transform(dataset.crs, "EPSG:4326", [x], [y])
    find = {"type": "Feature", "properties": {"name": "person <1>", "ce90_m": 2.5},
            "geometry": {"type": "Point", "coordinates": [lon[0], lat[0]]}}  # fmt: skip
    (folder / "finds.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [find]}))
    when, place = "2026-05-01T10:00:00Z", (lon[0], lat[0])
    marked = FindStore(folder).add(FindKind.HAZARD, time_utc=when, lon_lat=place, jpeg=b"\xff\xd8x")
    package_mission(folder, tmp_path / "h.zip")
    with zipfile.ZipFile(tmp_path / "h.zip") as archive:
        html = archive.read("summary.html").decode()
        assert archive.read("finds/find-001.jpg")[:3] == b"\xff\xd8\xff"
        assert archive.read(f"finds/{marked.id}.jpg") == b"\xff\xd8x"  # what was seen when it was marked
        assert "finds.geojson" in archive.namelist()
        archive.extract("vectors.gpkg", tmp_path)
    assert "person &lt;1&gt;" in html and "CE90 2.5 m" in html
    with sqlite3.connect(tmp_path / "vectors.gpkg") as db:
        assert db.execute("SELECT name FROM finds").fetchall() == [("person <1>",), ("Hazard 1",)]
    db.close()


def test_a_flight_with_an_autopilots_log_tells_who_flew(mapped, shared_data, tmp_path):
    folder = tmp_path / "m"
    shutil.copytree(mapped.folder, folder)
    flights = folder / "flights.jsonl"
    record = json.loads(flights.read_text().splitlines()[0])
    record["track_source"] = str(shared_data / "flightlogs" / "copter_survey.tlog")
    flights.write_text(json.dumps(record) + "\n")
    summary = package_mission(folder, tmp_path / "h.zip")
    (times,) = summary.times
    # above 1 m in AUTO by pymavlink's own reading of that log; it never flew by hand
    assert times.autonomous_s == pytest.approx(357.4, abs=0.5) and times.manual_s == 0.0
    assert times.overall_s > times.autonomous_s


def test_the_command_prints_one_document(mapped, tmp_path):
    out = tmp_path / "h.zip"
    words = ["package", str(mapped.folder), "-o", str(out), "--max-size", "1.5MB", "--json", "-q"]
    result = CliRunner().invoke(cli, words, standalone_mode=False)
    document = json.loads(result.stdout)
    assert document["bytes"] == out.stat().st_size <= 1_500_000
    assert document["max_bytes"] == 1_500_000


def test_wrong_words_say_what_to_write(mapped, tmp_path):
    for text in ("20 apples", "-3MB", "0MB", ""):
        with pytest.raises(UsageError, match="--max-size"):
            parse_size(text)
    with pytest.raises(UsageError, match=r"end in \.zip"):
        package_mission(mapped.folder, tmp_path / "h.rar")
    with pytest.raises(DataError, match="no mission folder"):
        package_mission(tmp_path, tmp_path / "h.zip")
