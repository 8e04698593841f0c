"""A plan in every format: what other readers find in it."""

import csv
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pyogrio
import pytest
import shapely

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.core.mission import Autopilot
from photomap_gis.core.plan import AltitudeFrame, CameraTrigger, SurveyPlan
from photomap_gis.mission_planner.files import plan_format, read_mission, write_plan
from photomap_gis.mission_planner.files.lanes import cut_at_antimeridian

Plans = Callable[..., SurveyPlan]
K = "{http://www.opengis.net/kml/2.2}"
W = "{http://www.dji.com/wpmz/1.0.2}"


def waypoints(plan: SurveyPlan) -> list[tuple[float, float]]:
    return [(w.lon_deg, w.lat_deg) for s in plan.sorties for w in s.waypoints]


def lines(path: Path, layer: str | None = None) -> list[shapely.Geometry]:
    _, _, geometry, _ = pyogrio.raw.read(path, layer=layer)
    return list(shapely.from_wkb(geometry))


def test_gdal_reads_the_path_from_kml_kmz_and_gpx(two_lanes: Plans, tmp_path: Path):
    plan = two_lanes()
    want = np.array(waypoints(plan))
    for name in ("a.kml", "a.kmz"):
        assert write_plan(tmp_path / name, plan) == [tmp_path / name]
    archive = zipfile.ZipFile(tmp_path / "a.kmz")
    assert archive.namelist()[0] == "doc.kml"
    assert archive.read("doc.kml").decode() == (tmp_path / "a.kml").read_text()
    layers = [str(name) for name, _ in pyogrio.list_layers(tmp_path / "a.kml")]
    found = [g for layer in layers for g in lines(tmp_path / "a.kml", layer) if g.geom_type == "LineString"]
    path = max(found, key=lambda g: g.length)
    assert np.allclose(shapely.get_coordinates(path), want, atol=1e-9)
    # 412 m is the take-off place's height
    assert np.allclose(shapely.get_coordinates(path, include_z=True)[:, 2], [452] + [472] * 6)
    write_plan(tmp_path / "a.gpx", plan)
    (route,) = lines(tmp_path / "a.gpx", "routes")
    assert np.allclose(shapely.get_coordinates(route), want, atol=1e-9)
    assert len(lines(tmp_path / "a.gpx", "route_points")) == len(want)


@pytest.mark.parametrize(
    ("frame", "home_m", "mode", "height"),
    [
        (AltitudeFrame.RELATIVE, 412.0, "absolute", 472.0),
        (AltitudeFrame.RELATIVE, None, "relativeToGround", 60.0),
        (AltitudeFrame.AMSL, None, "absolute", 60.0),
        (AltitudeFrame.TERRAIN, 412.0, "relativeToGround", 60.0),
    ],
)
def test_kml_says_what_its_heights_are_above(
    frame: AltitudeFrame, home_m: float | None, mode: str, height: float, two_lanes: Plans, tmp_path: Path
):
    write_plan(tmp_path / "a.kml", replace(two_lanes(frame), home_alt_amsl_m=home_m))
    document = ET.parse(tmp_path / "a.kml")
    assert {e.text for e in document.iter(f"{K}altitudeMode")} == {mode}
    points = [p.findtext(f"{K}coordinates") or "" for p in document.iter(f"{K}Point")]
    assert float(points[1].split(",")[2]) == height
    flat = "flat ground" in (document.findtext(f".//{K}description") or "")
    assert flat == (frame is AltitudeFrame.RELATIVE and home_m is None)


def test_gpx_tells_no_height_above_the_sea_that_is_not_known(two_lanes: Plans, tmp_path: Path):
    write_plan(tmp_path / "a.gpx", replace(two_lanes(), home_alt_amsl_m=None))
    assert "<ele>" not in (tmp_path / "a.gpx").read_text()
    write_plan(tmp_path / "a.gpx", two_lanes())
    assert "<ele>472.00</ele>" in (tmp_path / "a.gpx").read_text()


def test_geojson_and_csv_hold_all_waypoints_and_lanes(two_lanes: Plans, tmp_path: Path):
    plan = two_lanes()
    write_plan(tmp_path / "a.geojson", plan)
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    kinds = [f["properties"]["kind"] for f in features]
    assert {k: kinds.count(k) for k in set(kinds)} == {
        "area": 1, "avoid": 1, "home": 1, "path": 1, "lane": 2, "waypoint": 7,
    }  # fmt: skip
    points = [tuple(f["geometry"]["coordinates"]) for f in features if f["properties"]["kind"] == "waypoint"]
    assert points == waypoints(plan)
    lane = next(f for f in features if f["properties"]["kind"] == "lane")
    assert lane["geometry"]["coordinates"] == [[7.9995, 47.001], [7.9995, 47.003]]
    assert len(lines(tmp_path / "a.geojson")) == len(features)  # GDAL reads it
    write_plan(tmp_path / "a.csv", plan)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    assert [(float(r["lon_deg"]), float(r["lat_deg"])) for r in rows] == waypoints(plan)
    assert rows[2]["trigger"] == "distance" and rows[2]["trigger_distance_m"] == "12.5"
    assert rows[1]["alt_amsl_m"] == "472.0" and rows[1]["trigger"] == ""


def wpml(path: Path, name: str = "wpmz/waylines.wpml") -> ET.Element:
    return ET.fromstring(zipfile.ZipFile(path).read(name))


def test_dji_flies_the_lanes_with_pictures_by_distance(two_lanes: Plans, tmp_path: Path):
    plan = two_lanes()
    (path,) = write_plan(tmp_path / "a.wpml.kmz", plan)
    assert zipfile.ZipFile(path).namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
    for name in ("wpmz/template.kml", "wpmz/waylines.wpml"):
        root = wpml(path, name)
        marks = list(root.iter(f"{K}Placemark"))
        # take-off and the way home are the aircraft's own business
        flown = [tuple(map(float, (m.findtext(f".//{K}coordinates") or "").split(","))) for m in marks]
        assert np.allclose(flown, waypoints(plan)[1:-1])
        assert [m.findtext(f"{W}index") for m in marks] == [str(i) for i in range(5)]
        groups = [
            g for g in root.iter(f"{W}actionGroup") if g.findtext(f".//{W}actionTriggerType") == "multipleDistance"
        ]
        spans = [(g.findtext(f"{W}actionGroupStartIndex"), g.findtext(f"{W}actionGroupEndIndex")) for g in groups]
        assert spans == [("1", "2"), ("3", "4")]
        assert {g.findtext(f".//{W}actionTriggerParam") for g in groups} == {"12.5"}
        assert len({g.findtext(f"{W}actionGroupId") for g in root.iter(f"{W}actionGroup")}) == 3
    root = wpml(path)
    assert {h.text for h in root.iter(f"{W}executeHeight")} == {"60.000"}
    assert [s.text for s in root.iter(f"{W}waypointSpeed")] == ["10", "8", "8", "8", "8"]
    assert root.findtext(f".//{W}takeOffSecurityHeight") == "40.0"
    assert root.findtext(f".//{W}finishAction") == "goHome"
    assert [e.text for e in root.iter(f"{W}gimbalPitchRotateAngle")] == ["-90"]


def test_dji_hovers_and_holds_headings(two_lanes: Plans, tmp_path: Path):
    (path,) = write_plan(
        tmp_path / "a.kmz", two_lanes(trigger=CameraTrigger(hover=True), heading_deg=270.0), file_format="wpml"
    )
    root = wpml(path)
    shots = [a for a in root.iter(f"{W}action") if a.findtext(f"{W}actionActuatorFunc") == "takePhoto"]
    assert len(shots) == 4
    assert {e.text for e in root.iter(f"{W}waypointHeadingAngle")} == {"-90.0"}


def test_dji_needs_heights_above_home(two_lanes: Plans, tmp_path: Path):
    amsl = two_lanes(AltitudeFrame.AMSL)
    write_plan(tmp_path / "a.wpml.kmz", amsl)
    assert (
        wpml(tmp_path / "a.wpml.kmz").findtext(f".//{W}executeHeight") == "-352.000"
    )  # 60 m above the sea, 412 m home
    for plan in (replace(amsl, home_alt_amsl_m=None), two_lanes(AltitudeFrame.TERRAIN)):
        with pytest.raises(UsageError, match="relative"):
            write_plan(tmp_path / "b.wpml.kmz", plan)
    assert not (tmp_path / "b.wpml.kmz").exists()


def test_several_sorties_are_several_files_where_one_holds_one(two_lanes: Plans, tmp_path: Path):
    one = two_lanes()
    plan = replace(one, sorties=one.sorties * 3)
    paths = write_plan(tmp_path / "far.plan", plan, autopilot=Autopilot.PX4)
    assert [p.name for p in paths] == ["far-1.plan", "far-2.plan", "far-3.plan"]
    assert all(read_mission(p).items for p in paths) and not (tmp_path / "far.plan").exists()
    assert [p.name for p in write_plan(tmp_path / "far.wpml.kmz", plan)] == [f"far-{i}.wpml.kmz" for i in (1, 2, 3)]
    (path,) = write_plan(tmp_path / "far.geojson", plan)
    features = json.loads(path.read_text())["features"]
    assert {f["properties"]["sortie"] for f in features if "sortie" in f["properties"]} == {1, 2, 3}


def test_formats_go_by_suffix_or_name_and_others_are_refused(two_lanes: Plans, tmp_path: Path):
    assert (
        plan_format("a.PLAN") == "plan" and plan_format("a.txt") == "waypoints" and plan_format("a.json") == "geojson"
    )
    assert (
        plan_format("a.b.kmz") == "kmz" and plan_format("a.wpml.kmz") == "wpml" and plan_format("a.x", "kml") == "kml"
    )
    for name in ("a", "a.docx", "a.wpml"):
        with pytest.raises(UsageError, match="--format"):
            write_plan(tmp_path / name, two_lanes())
    with pytest.raises(OutputError):
        write_plan(tmp_path / "nowhere" / "a.kml", two_lanes())


def test_lines_are_cut_at_the_antimeridian():
    parts = cut_at_antimeridian([(179.0, 0.0), (-179.0, 2.0), (-178.0, 2.0)])
    assert parts == [[[179.0, 0.0], [180.0, 1.0]], [[-180.0, 1.0], [-179.0, 2.0], [-178.0, 2.0]]]
    assert cut_at_antimeridian([(-179.5, 0.0), (179.5, 1.0)])[1][0] == [180.0, 0.5]
