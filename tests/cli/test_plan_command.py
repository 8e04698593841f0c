"""``photomap plan`` as a script or a person in a hurry uses it."""

import contextlib
import json

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from photomap_gis.cli import main

FIELD = "47,8;47,8.004;47.003,8.004;47.003,8.001"
CONTRACT = {"waypoints", "frame", "covered_share", "uncovered", "photos", "length_m", "duration_s", "gsd_m_per_px",
            "sorties", "warnings"}  # fmt: skip


def test_json_is_the_contract_and_the_files_are_written(tmp_path, capsys):
    out = tmp_path / "field.plan"
    assert main(["plan", FIELD, "--camera", "FC6310", "--gsd", "3cm", "-o", str(out), "--json", "-q"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert set(plan) >= CONTRACT
    assert plan["covered_share"] == 1.0
    assert plan["uncovered"] is None
    assert plan["gsd_m_per_px"] == pytest.approx(0.03)
    assert json.loads(out.read_text())["fileType"] == "Plan"
    assert (tmp_path / "field.png").read_bytes().startswith(b"\x89PNG")


def test_words_on_stderr_files_on_stdout(tmp_path, capsys):
    out = tmp_path / "field.waypoints"
    assert main(["plan", FIELD, "--camera", "FC6310", "--target", "person", "-o", str(out), "-q"]) == 0
    told = capsys.readouterr()
    assert told.out.split() == [str(out), str(tmp_path / "field.png")]
    assert "sure to be seen" in told.err
    assert "flat ground" in told.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["plan"], 2, "AREA"),
        (["plan", FIELD], 2, "-o PLAN.plan"),
        (["plan", "nothing.geojson", "--json"], 3, "nothing.geojson"),
        (["plan", FIELD, "--json", "--gsd", "2"], 2, "2cm"),
        (["plan", FIELD, "--json", "--gsd", "2cm", "--height", "50"], 2, "one of"),
        (["plan", FIELD, "--json", "--target", "ufo"], 2, "0.4x0.3"),
        (["plan", FIELD, "--json", "--camera", "no such"], 2, "no such"),
        (["plan", FIELD, "--json", "--focal-mm", "8.8"], 2, "--sensor-width-mm"),
        (["plan", FIELD, "--json", "--sensor-width-mm", "13.2"], 2, "--focal-mm"),
        (["plan", FIELD, "--json", "--fov-deg", "73.7", "--focal-35mm", "50"], 2, "contradict"),
        (["plan", FIELD, "--json", "--focal-mm", "880", "--sensor-width-mm", "13.2"], 2, "check the millimetres"),
        (["plan", FIELD, "--json", "--focal-mm", "8.8", "--sensor-width-mm", "13.2", "--image-width", "5472"], 2,
         "--image-height"),
        (["plan", FIELD, "--json", "--camera", "FC6310", "--image-width", "4000"], 2, "5472 x 3648"),
        (["plan", FIELD, "--json", "--battery-wh", "90"], 2, "--power-w"),
        (["plan", FIELD, "--json", "--heading", "north"], 2, "degrees clockwise"),
        (["plan", FIELD, "--json", "--heading", "nan"], 2, "degrees clockwise"),
        (["plan", FIELD, "--json", "--wind", "x"], 2, "SPEED,FROM_DEG"),
        (["plan", "47,8;47.01,8.01", "--json", "--height", "50"], 3, "--corridor-width"),
        (["plan", FIELD, "--json", "--height", "50", "--home", "47.001,8.002", "--avoid",
          "47.0005,8.0015;47.0005,8.0025;47.0015,8.0025;47.0015,8.0015"], 2, "--home"),
        (["plan", "--gaps", "no-mission", "--json", "--height", "50"], 3, "no mission folder"),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_one_line_with_its_exit_code(capsys, arguments, code, words):
    assert main([*arguments, "-q"]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert "Traceback" not in err


def test_the_gaps_of_a_mission_are_planned(tmp_path, capsys):
    size = ["--frames", "6", "--width", "480", "--frame-height", "360", "--altitude", "80"]
    assert main(["simulate", "procedural", "-o", str(tmp_path / "sim"), "-q", *size]) == 0
    assert main(["map", str(tmp_path / "sim" / "photos"), "-o", str(tmp_path / "m"), "-q"]) == 0
    capsys.readouterr()
    photo = str(next((tmp_path / "sim" / "photos").glob("*.JPG")))
    every = ["plan", "--gaps", str(tmp_path / "m"), "--camera", photo, "--json", "-q"]
    assert main([*every, "--height", "40"]) == 0  # the whole map is too coarse for half its height
    finer = json.loads(capsys.readouterr().out)
    assert finer["covered_share"] > 0.999
    assert main([*every, "--height", "80", "--coarser-than", "2m", "--older-than", "2099-01-01"]) == 0
    assert json.loads(capsys.readouterr().out)["area_m2"] > 1000


def test_southern_and_western_places_are_no_options(tmp_path, capsys):
    area = "-35.3632,-70.1652;-35.3632,-70.1600;-35.3660,-70.1600"
    out = tmp_path / "south.plan"
    assert main(["plan", area, "--camera", "FC6310", "--gsd", "3cm", "--home", "-35.363,-70.166", "-o", str(out)]) == 0
    assert out.is_file()
    assert main(["plan", area, "-3", "-o", str(out)]) == 2


def test_altitudes_are_written_to_the_centimetre_and_the_nose_where_it_was_asked(tmp_path):
    files = {suffix: tmp_path / f"field.{suffix}" for suffix in ("plan", "waypoints", "kml", "csv", "geojson", "json")}
    for suffix, path in files.items():
        where = ["-o", str(path)] if suffix != "json" else ["--json"]
        with path.open("w") as out, contextlib.redirect_stdout(out) if suffix == "json" else contextlib.nullcontext():
            assert main(["plan", FIELD, "--gsd", "3cm", "--heading", "45", "--transit-height", "123.456789",
                         *where, "-q"]) == 0  # fmt: skip
    plan = json.loads(files["json"].read_text())
    altitudes = {w[2] for w in plan["waypoints"]}
    assert 123.46 in altitudes
    assert all(round(a, 2) == a for a in altitudes)
    items = [i for i in json.loads(files["plan"].read_text())["mission"]["items"] if i.get("command") in (16, 22)]
    assert {round(i["params"][6], 2) for i in items} == {i["params"][6] for i in items} == altitudes
    for suffix in ("kml", "csv", "geojson", "waypoints"):
        text = files[suffix].read_text()
        assert "123.46" in text
        assert "123.456" not in text


@pytest.mark.parametrize(
    "numbers",
    [
        ["--focal-mm", "8.8", "--sensor-width-mm", "13.2"],
        ["--fov-deg", "73.7398"],
        ["--focal-35mm", "24"],
        ["--focal-mm", "8.8", "--sensor-width-mm", "13.2", "--focal-35mm", "24"],
    ],
)
def test_a_camera_by_numbers_is_the_camera_they_mean(capsys, numbers):
    size = ["--image-width", "5472", "--image-height", "3648"]
    assert main(["plan", FIELD, "--gsd", "2cm", *numbers, *size, "--json", "-q"]) == 0
    camera = json.loads(capsys.readouterr().out)["camera"]
    assert camera["focal_px"] == pytest.approx(3648.0, rel=0.002)


@pytest.mark.parametrize("pattern", [[], ["--pattern", "parallel"]])
def test_energy_is_power_times_time_and_a_share_of_the_battery(capsys, pattern):
    command = ["plan", FIELD, "--height", "60", *pattern, "--json", "-q"]
    assert main([*command, "--battery-wh", "20", "--power-w", "360"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["energy_wh"] == pytest.approx(plan["duration_s"] / 10, abs=0.1)
    assert plan["sorties"][0]["battery_share"] == pytest.approx(plan["duration_s"] / 200, abs=0.001)
    assert any("of the battery" in w for w in plan["warnings"])
    assert main([*command, "--endurance-min", "30"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["energy_wh"] is None
    assert sum(s["battery_share"] for s in plan["sorties"]) == pytest.approx(plan["duration_s"] / 1800, abs=0.002)


def test_over_a_slope_the_proof_is_over_the_slope(tmp_path, capsys):
    x = np.arange(800)
    heights = (400.0 + 40.0 * np.sin(x / 60.0)[None, :] * np.ones((800, 1))).astype("float32")
    dem = tmp_path / "dem.tif"
    corner = from_origin(7.998, 47.005, 1e-5, 1e-5)
    with rasterio.open(dem, "w", driver="GTiff", width=800, height=800, count=1, dtype="float32", crs="EPSG:4326",
                       transform=corner) as raster:  # fmt: skip
        raster.write(heights, 1)
    command = ["plan", FIELD, "--height", "60", "--json", "-q", "--picture", str(tmp_path / "p.png")]
    assert main([*command, "--dem", str(dem), "--dem-vertical", "msl"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["covered_share"] > 0.999
    low, high = plan["gsd_range_m_per_px"]
    assert low < 0.95 * plan["gsd_m_per_px"] < high
    assert plan["overlap_over_terrain"]["side"] < 0.64
    assert any("overlaps sink to" in w for w in plan["warnings"])
    assert main(command) == 0
    plan = json.loads(capsys.readouterr().out)
    assert "gsd_range_m_per_px" not in plan
    assert any("flat ground" in w for w in plan["warnings"])
