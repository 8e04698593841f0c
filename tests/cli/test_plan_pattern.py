"""``photomap plan --pattern`` from the command line to the file, read again."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from shapely.geometry import LineString, Polygon

from photomap_gis.cli import main
from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.files import read_mission
from photomap_gis.mission_planner.local_frame import LocalFrame

CAMERA = ["--fov-deg", "73.7", "--image-width", "4000", "--image-height", "3000"]  # a swath of 1.5 times the height
AREA = "47,8;47.003,8;47.003,8.008;47,8.008"


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any], str]:
    code = main(["plan", *arguments, "--json"])
    out, err = capsys.readouterr()
    return code, json.loads(out) if out else {}, err


@pytest.mark.parametrize(
    ("pattern", "place"),
    [
        ("expanding-square", ["--datum", "47,8", "--radius", "300"]),
        ("sector", ["--datum", "47,8", "--radius", "300", "--passes", "2"]),
        ("spiral", [AREA]),
        ("orbit", ["--datum", "47,8", "--radius", "50"]),
        ("parallel", [AREA]),
        ("creeping", [AREA]),
        ("perimeter", [AREA]),
        ("trackline", ["LINESTRING (8 47, 8.01 47, 8.01 47.01)"]),
    ],
)
def test_every_pattern_becomes_a_plan_that_is_read_again(
    pattern: str, place: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    out = tmp_path / "s.plan"
    code, facts, err = run(capsys, *place, "--pattern", pattern, *CAMERA, "--height", "40", "-o", str(out))
    assert code == 0, err
    assert facts["files"] == [str(out)] and facts["pattern"] == pattern and facts["frame"] == "relative"
    assert facts["sweep_width_m"] == pytest.approx(60, abs=0.1) and facts["track_spacing_m"] == facts["sweep_width_m"]
    assert facts["gsd_m_per_px"] == pytest.approx(0.015, rel=1e-3)
    assert 0 < facts["pod"]["random_search"] < facts["pod"]["inverse_cube"] <= 1
    assert facts["photos"] > 0 and facts["length_m"] > 0 and facts["duration_s"] > 0
    assert any("flat ground" in w for w in facts["warnings"])
    mission = read_mission(out)
    flown = [[i.x, i.y, i.z] for i in mission.items if i.command in (16, 22)]
    assert np.allclose(flown, facts["waypoints"])
    assert mission.items[0].command == 22 and mission.items[-1].command == 20
    frame = LocalFrame.about(47, 8)
    fence = Polygon(frame.to_xy(mission.fence_polygons[0].vertices))
    assert fence.covers(LineString(frame.to_xy([(w[0], w[1]) for w in facts["waypoints"]])).buffer(49))
    if pattern in ("parallel", "creeping", "expanding-square", "spiral"):
        assert facts["covered_share"] > 0.995


def test_target_sets_the_height_and_coverage_factor_the_spacing(capsys: pytest.CaptureFixture[str]):
    code, facts, _ = run(
        capsys, AREA, "--pattern", "parallel", *CAMERA, "--target", "0.4x0.16", "--coverage-factor", "2"
    )
    assert code == 0
    assert facts["gsd_m_per_px"] == pytest.approx(0.02)
    assert facts["waypoints"][1][2] == pytest.approx(0.02 * 4000 / 1.5, rel=1e-3)
    assert facts["sweep_width_m"] == pytest.approx(80, abs=0.1) and facts["track_spacing_m"] == pytest.approx(
        40, abs=0.1
    )
    assert facts["coverage_factor"] == pytest.approx(2)
    assert facts["pod"]["random_search"] == pytest.approx(1 - np.exp(-2), abs=1e-3)


def test_zones_batteries_and_several_files(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    zone = "POLYGON ((8.003 47.001, 8.005 47.001, 8.005 47.002, 8.003 47.002, 8.003 47.001))"
    out = tmp_path / "s.waypoints"
    code, facts, err = run(
        capsys, AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "--avoid", zone,
        "--endurance-min", "6", "--home", "46.9995,8.001", "-o", str(out), "--end", "land",
    )  # fmt: skip
    assert code == 0, err
    assert len(facts["sorties"]) > 1 and all(s["duration_s"] <= 360 for s in facts["sorties"])
    assert facts["files"] == [str(tmp_path / f"s-{i + 1}.waypoints") for i in range(len(facts["sorties"]))]
    no_fly = Polygon([(8.003, 47.001), (8.005, 47.001), (8.005, 47.002), (8.003, 47.002)])
    for sortie, path in zip(facts["sorties"], facts["files"], strict=True):
        assert not LineString([(w[1], w[0]) for w in sortie["waypoints"]]).intersects(no_fly)
        assert [i.command for i in read_mission(path).items][-1] == 21


def dem(tmp_path: Path) -> Path:
    path = tmp_path / "dem.tif"
    rows, cols = np.mgrid[0:120, 0:240]
    values = (450 + 30 * np.sin(cols / 20) + 0.3 * rows).astype("float32")
    with rasterio.open(
        path, "w", driver="GTiff", width=240, height=120, count=1, dtype="float32", crs="EPSG:4326",
        transform=from_origin(7.998, 47.005, 0.00005, 0.00006),
    ) as raster:  # fmt: skip
        raster.write(values, 1)
    return path


def test_terrain_is_followed(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    common = [AREA, "--pattern", "parallel", *CAMERA, "--height", "60", "--dem", str(dem(tmp_path)), "--climb", "8",
              "--descent", "8", "--terrain-tolerance", "4"]  # fmt: skip
    code, facts, err = run(capsys, *common, "--altitude-frame", "amsl", "--dem-vertical", "egm96")
    assert code == 0, err
    assert facts["frame"] == "amsl" and facts["terrain"]["waypoints_added"] > 10
    assert facts["terrain"]["lowest_survey_m"] >= 56 - 0.5 and facts["terrain"]["highest_survey_m"] < 66
    with rasterio.open(tmp_path / "dem.tif") as raster:
        ground = np.array([v[0] for v in raster.sample([(w[1], w[0]) for w in facts["waypoints"]])])
    above = np.array([w[2] for w in facts["waypoints"]]) - ground
    assert above.min() > 54 and np.median(above) == pytest.approx(60, abs=3)
    assert not any("flat ground" in w for w in facts["warnings"])
    code, facts, _ = run(capsys, *common)
    assert facts["frame"] == "relative" and any("mean sea level is assumed" in w for w in facts["warnings"])
    # beyond the model: an error that says where, and no file
    out = tmp_path / "s.plan"
    code, _, err = run(capsys, *common, "--home", "46.9,8", "-o", str(out))
    assert code == 3 and "says nothing" in err and not out.exists()


def test_a_survey_follows_the_terrain_too(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    common = [AREA, *CAMERA, "--height", "60", "--climb", "8", "--descent", "8"]
    code, flat, err = run(capsys, *common)
    assert code == 0, err
    assert any("flat ground" in w for w in flat["warnings"])
    code, facts, err = run(capsys, *common, "--dem", str(dem(tmp_path)), "-o", str(tmp_path / "s.kml"))
    assert code == 0, err
    assert not any("flat ground" in w for w in facts["warnings"])
    assert facts["terrain"]["waypoints_added"] > 10 and facts["terrain"]["lowest_survey_m"] > 56
    low, high = facts["gsd_range_m_per_px"]
    # over the ground that pictures show, hills to the side of the flight too
    assert 0.75 * facts["gsd_m_per_px"] < low < facts["gsd_m_per_px"] < high
    assert facts["covered_share"] == flat["covered_share"] and facts["home_alt_amsl_m"] > 400


@pytest.mark.parametrize("pattern", [[], ["--pattern", "parallel"]])
def test_ardupilot_follows_its_own_terrain(pattern: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path):
    out = tmp_path / "s.plan"
    code, facts, err = run(
        capsys, AREA, *pattern, *CAMERA, "--height", "60", "--altitude-frame", "terrain", "-o", str(out)
    )
    assert code == 0, err
    assert facts["frame"] == "terrain" and "terrain" not in facts
    assert any("terrain data" in w for w in facts["warnings"])
    assert not any("flat ground" in w for w in facts["warnings"])
    assert {i.frame for i in read_mission(out).items if i.command == 16} == {10}


def test_dji_and_px4(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    common = [AREA, "--pattern", "creeping", *CAMERA, "--height", "60"]
    code, facts, _ = run(capsys, *common, "-o", str(tmp_path / "s.wpml.kmz"))
    assert code == 0 and "wpmz/waylines.wpml" in zipfile.ZipFile(facts["files"][0]).namelist()
    out = str(tmp_path / "p.plan")
    code, facts, _ = run(capsys, *common, "-o", out, "--autopilot", "px4", "--rally", "47.001,8.001,40")
    mission = read_mission(out)
    assert code == 0 and mission.autopilot is Autopilot.PX4 and mission.rally[0].alt_m == 40
    code, _, err = run(
        capsys, *common, "-o", out, "--autopilot", "px4", "--altitude-frame", "terrain", "--dem", str(dem(tmp_path))
    )
    assert code == 2 and "PX4 takes no altitudes above terrain" in err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([AREA, "--datum", "47,8"], 2, "needs a --pattern"),
        ([AREA, "--pattern", "parallel", "--crosshatch"], 2, "means nothing to --pattern parallel"),
        (["--pattern", "parallel", *CAMERA, "--height", "40"], 2, "needs a place"),
        (["--pattern", "sector", *CAMERA, "--height", "40", "--datum", "47,8"], 2, "--radius"),
        (["--pattern", "sector", *CAMERA, "--height", "40", "--datum", "147,8"], 2, "no place on Earth"),
        (["--pattern", "sector", *CAMERA, "--height", "40", "--datum", "47"], 2, "2 numbers"),
        ([AREA, "--pattern", "trackline", *CAMERA, "--height", "40"], 2, "LineString"),
        (["LINESTRING (8 47, 8.1 47)", "--pattern", "parallel", *CAMERA, "--height", "40"], 2, "polygon"),
        (["nowhere.geojson", "--pattern", "parallel", *CAMERA, "--height", "40"], 3, "no file"),
        ([AREA, "--pattern", "parallel", "--camera", "no such", "--height", "40"], 2, "no camera"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "-4"], 2, "--height"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "--track-spacing", "-1"], 2, "track-spacing"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "--wind", "20,0"], 2, "weather"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "--altitude-frame", "amsl"], 2, "needs --dem"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "--target", "0.1"], 2, "one of"),
        ([AREA, *CAMERA, "--height", "40", "--dem", "x.tif", "--terrain-tolerance", "30"], 2, "half the height"),
        ([AREA, *CAMERA, "--height", "40", "--dem", "x.tif"], 3, "cannot be read"),
        ([AREA, "--height", "nan"], 2, "not a finite number"),
        ([AREA, "--pattern", "parallel", "--first-leg", "inf"], 2, "--first-leg"),
        ([AREA, "--height", "40", "--climb", "0"], 2, "--climb"),
        ([AREA, "--height", "40", "--fence-margin", "nan"], 2, "--fence-margin"),
        ([AREA, "--height", "40", "--wind", "nan,0"], 2, "--wind"),
        ([AREA, *CAMERA, "--height", "40", "--rally", "1,2", "-o", "x.plan"], 2, "3 numbers"),
        ([AREA, "--pattern", "parallel", *CAMERA, "--height", "40", "-o", "x.docx"], 2, "--format"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_says_what_to_do(
    arguments: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]
):
    found, _, err = run(capsys, *arguments)
    assert found == code and words in err, err
