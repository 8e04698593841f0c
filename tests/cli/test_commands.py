"""The commands as a script or a person in a hurry uses them: stdout for results, stderr for words, exit codes."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio

from photomap_gis.cli import main


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli") / "flight"
    size = ["--frames", "6", "--width", "480", "--frame-height", "360", "--altitude", "80"]
    assert main(["simulate", "procedural", "-o", str(folder), "-q", *size]) == 0
    return folder


@pytest.fixture(scope="module")
def mission(flight: Path) -> Path:
    folder = flight.parent / "mission"
    assert main(["map", str(flight / "photos"), "-o", str(folder), "-q"]) == 0
    return folder


def test_simulate_says_where_the_photos_are(flight):
    assert len(list((flight / "photos").glob("*.JPG"))) == 6
    assert (flight / "truth" / "truth.json").is_file()


def test_map_json_is_one_document_and_nothing_else_is_on_stdout(flight, mission, capsys):
    capsys.readouterr()
    assert main(["map", str(flight / "photos"), "-o", str(mission), "--json"]) == 0
    out = capsys.readouterr().out
    assert json.loads(out)["frames"]["total"] == 6


def test_map_in_words(flight, mission, capsys):
    capsys.readouterr()
    assert main(["map", str(flight / "photos"), "-o", str(mission)]) == 0
    out, err = capsys.readouterr()
    assert "registered" in out
    assert "not the accuracy" in out
    assert "CE90" in out
    assert "geotiff" in err


def test_graph_is_drawn_and_written(mission, tmp_path, capsys):
    assert main(["graph", str(mission), "-q"]) == 0
    assert capsys.readouterr().out.strip() == str(mission / "graph.png")
    assert (mission / "graph.png").read_bytes().startswith(b"\x89PNG")
    out = tmp_path / "graph.geojson"
    assert main(["graph", str(mission), "-o", str(out), "--json", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["outputs"] == [str(out)]
    kinds = [f["properties"].get("kind") for f in json.loads(out.read_text())["features"]]
    told = json.loads((mission / "solution.json").read_text())["placements"]
    assert kinds.count(None) == sum(p["status"] in ("registered", "gps_only", "oblique") for p in told)
    assert kinds.count("sequential") >= 3
    assert main(["graph", str(mission), "-o", str(tmp_path / "graph.svg"), "-q"]) == 2
    assert ".g2o" in capsys.readouterr().err
    assert main(["graph", str(tmp_path)]) == 3


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "1;2;3", "100,0,0", "nan,0,0"])
def test_an_antenna_offset_that_is_none_is_told(flight, tmp_path, capsys, text):
    assert main(["map", str(flight / "photos"), "-o", str(tmp_path / "m"), "--antenna-offset", text]) == 2
    assert "--antenna-offset" in capsys.readouterr().err
    assert not (tmp_path / "m").exists()


def test_info(flight, capsys):
    assert main(["info", str(flight / "photos"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 6
    assert main(["info", str(flight / "photos")]) == 0
    assert "flight" in capsys.readouterr().out


def test_export_defaults_to_the_current_folder(mission, monkeypatch, capsys):
    monkeypatch.chdir(mission)
    assert main(["export", "--poses", "--mbtiles", "--json", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["outputs"] == ["map.mbtiles", "poses.csv"]
    assert (mission / "map.mbtiles").is_file()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["map", "/no/such/folder", "-o", "{tmp}/m"], 3, "no such"),
        (["map", "{tmp}", "-o", "{tmp}/m"], 3, "no photos"),
        (["map", "{photos}"], 2, "-o MISSION"),
        (["map", "{photos}", "-o", "{tmp}/m", "--crs", "EPSG:77"], 2, "EPSG:32633"),
        (["map", "{photos}", "-o", "{tmp}/m", "--crs", "EPSG:32755"], 2, "EPSG:32632"),
        (["map", "{photos}", "-o", "{tmp}/m", "--track", "{tmp}/none.gpx"], 3, "none.gpx"),
        (["map", "{photos}", "-o", "{tmp}/m", "--gsd", "-1"], 2, "--gsd"),
        (["export", "{tmp}", "--geotiff"], 3, "no mission folder"),
        (["export", "{mission}"], 2, "--geotiff"),
        (["export", "{mission}", "--geotiff", "-o", "{tmp}/map.png"], 2, ".tif"),
        (["export", "{mission}", "--geotiff", "--over", "{tmp}/old.tif"], 3, "old.tif"),
        (["info", "{tmp}/nothing.mp4"], 3, "nothing.mp4"),
        (["map", "{photos}", "-o", "{tmp}/m", "--gcp", "{tmp}/none.txt"], 3, "none.txt"),
        (["map", "{photos}", "-o", "{tmp}/m", "--gcp-crs", "EPSG:25832"], 2, "--gcp FILE"),
        (["solve", "{tmp}"], 3, "no mission folder"),
        (["solve", "{mission}", "--check", "P1"], 2, "--gcp FILE"),
        (["georeference", "{mission}"], 2, "--pick X,Y=LAT,LON"),
        (["georeference", "{mission}", "--pick", "1,2=3"], 2, "write X,Y=LAT,LON"),
        (["georeference", "{mission}", "--pick", "1,2=97,3"], 2, "latitude comes first"),
        (["georeference", "{mission}", "--check-pick", "1,2=97,3"], 2, "--check-pick 1,2=97,3: latitude"),
        (["georeference", "{mission}", "--pick", "1,2=53,8"], 2, "not on the map"),
        (["georeference", "{mission}", "--nudge", "1,nan"], 2, "EAST,NORTH"),
        (["simulate", "{tmp}/no.tif", "-o", "{tmp}/s"], 3, "no.tif"),
    ],
)
def test_what_goes_wrong_is_one_line_with_its_exit_code(flight, mission, tmp_path, capsys, arguments, code, words):
    capsys.readouterr()
    filled = [a.format(tmp=tmp_path, photos=flight / "photos", mission=mission) for a in arguments]
    assert main([*filled, "-q"] if filled[0] != "info" else filled) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert "Traceback" not in err
    last = err.strip().splitlines()[-1]
    assert last.startswith("photomap: ")


def test_control_points_from_the_command_line(flight, mission, tmp_path, capsys):
    truth = json.loads((flight / "truth" / "truth.json").read_text())
    camera = truth["camera"]
    x, y = (camera["width_px"] - 1) / 2, (camera["height_px"] - 1) / 2
    rows = ["name,x,y,image,px,py"]
    for n, f in enumerate(truth["frames"][::2], start=1):
        # what the middle of a picture shows: the optical axis followed down to the ground
        north, east, down = (row[2] for row in f["R_grid_camera"])
        reach = (f["height_m"] - f["ground_height_m"]) / down
        rows.append(f"P{n},{f['easting_m'] + reach * east},{f['northing_m'] + reach * north},{f['name']},{x},{y}")
    gcp = tmp_path / "points.csv"
    gcp.write_text("\n".join(rows))
    folder = tmp_path / "mission"
    shutil.copytree(mission, folder)
    solve = ["solve", str(folder), "--gcp", str(gcp), "--gcp-crs", "EPSG:32632", "--check", "P2", "-q"]
    assert main(solve) == 0
    words = capsys.readouterr().out
    assert "2 point(s) in the fit" in words
    assert "1 check point outside the fit" in words
    assert "P2: dx" in words
    assert main(["georeference", str(folder), "--nudge", "-1,0.5", "--json", "-q"]) == 0
    nudged = json.loads(capsys.readouterr().out)
    assert nudged["nudges"][0]["east_m"] == -1.0
    assert main(["info", str(folder), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["accuracy"] == nudged["accuracy"]
    assert told["accuracy"]["n"] == 1
    assert told["control_file"] == "points.csv"
    assert main(["info", str(folder)]) == 0
    words = capsys.readouterr().out
    assert "NSSDA" in words
    assert "by hand" in words


@pytest.mark.slow
def test_demo_compares_with_the_truth(tmp_path, capsys):
    assert main(["demo", "-o", str(tmp_path / "d"), "--frames", "9", "--json", "-q"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["map"]["frames"]["registered"] == 9
    assert document["errors"]["relative_rmse_gsd"] < 5
    assert main(["demo", "-o", str(tmp_path), "-q"]) == 2, "a folder with other things is not replaced"


def test_layers_and_preferences_from_the_command_line(mission, tmp_path, capsys):
    folder = tmp_path / "mission"
    shutil.copytree(mission, folder)
    assert main(["export", str(folder), "--layers", "-o", str(tmp_path / "out"), "--json", "-q"]) == 0
    assert json.loads(capsys.readouterr().out)["outputs"] == [str(tmp_path / "out")]
    assert {p.stem for p in (tmp_path / "out").iterdir()} == {"last_seen", "source_frame", "views", "sigma", "searched"}
    assert not (folder / "layers").exists()

    def shown():
        with rasterio.open(folder / "layers" / "source_frame.tif") as layer, rasterio.open(folder / "map.tif") as map_:
            assert (layer.shape, layer.transform) == (map_.shape, map_.transform)
            return layer.read(1)

    assert main(["solve", str(folder), "--layers", "--prefer", "newest", "--memory", "256", "-q"]) == 0
    newest = shown()
    with rasterio.open(folder / "layers" / "last_seen.tif") as layer:
        last = layer.read(1)
    assert newest.max() == 5 and (last[newest == 5] == last.max()).all()
    assert main(["solve", str(folder), "-q"]) == 0
    assert np.array_equal(shown(), newest), "the mission keeps how it is drawn"
    assert main(["solve", str(folder), "--prefer", "nadir", "--no-layers", "-q"]) == 0
    assert not np.array_equal(shown(), newest), "layers that lie there are never those of an older map"
    capsys.readouterr()
    assert main(["solve", str(folder), "--prefer", "best", "-q"]) == 2
    assert "newest" in capsys.readouterr().err
