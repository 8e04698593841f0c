"""What the planner's form means to ``photomap plan``: every request is one that the command takes; no QGIS here."""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import types
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.cli.plan_command import command
from photomap_gis.engine.arguments import argv_of
from photomap_gis.mission_planner.files import read_mission

ROOT = Path(__file__).parents[2]


def _module(name: str):
    """A module of the plugin without the plugin's ``__init__``, and without Qt."""
    for package in ("qgis_plugin", "qgis_plugin.planner"):
        if package not in sys.modules:
            module = types.ModuleType(package)
            module.__path__ = [str(ROOT / package.replace(".", "/"))]
            sys.modules[package] = module
    return importlib.import_module(name)


request = _module("qgis_plugin.planner.request")
stored = _module("qgis_plugin.planner.stored")

cameras = st.one_of(
    st.just(request.Camera()),
    st.just(request.Camera("FC6310")),
    st.builds(request.Camera, st.just(""), st.floats(1, 160), st.integers(1, 10_000), st.integers(1, 10_000)),
)
requests = st.builds(
    request.PlanRequest,
    pattern=st.sampled_from([request.SURVEY, request.CROSSHATCH, request.CORRIDOR, *request.SEARCHES]),
    area=st.just("area.geojson"),
    avoid=st.sampled_from(["", "avoid.geojson"]),
    camera=cameras,
    target=st.sampled_from(["card", "person", "0.4"]),
    gsd_m=st.none() | st.floats(0.001, 1),
    height_m=st.none() | st.floats(1, 1000),
    front_overlap_percent=st.floats(0, 97),
    speed_m_s=st.floats(0.1, 100),
    wind_m_s=st.floats(0, 20),
    wind_from_deg=st.floats(0, 359),
    endurance_min=st.none() | st.floats(0.5, 60),
    home_lat_lon=st.none() | st.tuples(st.floats(-90, 90), st.floats(-180, 180)),
    datum_lat_lon=st.tuples(st.floats(-90, 90), st.floats(-180, 180)),
    angle_deg=st.none() | st.floats(0, 359),
    inset=st.booleans(),
    lands=st.booleans(),
    dem=st.sampled_from(["", "dem.tif"]),
    dem_vertical=st.sampled_from(["", "ellipsoid"]),
    geoid_m=st.none() | st.floats(-150, 150),
)


@settings(max_examples=60, deadline=None)
@given(requests)
def test_every_request_is_a_command_line(asked):
    words = argv_of("plan", command, asked.arguments(output="x.plan", drawing="x.geojson"), ("as_json",))
    assert words[0] == "plan"
    fine = [w for w in words if w.split("=")[0] in ("--gsd", "--height", "--target")]
    assert len(fine) == 1
    assert ("area.geojson" in words) == (asked.pattern not in request.FROM_DATUM)


def test_what_is_missing_is_told():
    plan = request.PlanRequest
    assert plan().missing == "area"
    assert plan(area="x").missing == ""
    assert plan(pattern="corridor").missing == "line"
    assert plan(pattern="sector", area="x").missing == "datum"
    assert plan(pattern="sector", datum_lat_lon=(47.0, 8.0)).missing == ""


def test_a_plan_that_photomap_writes_is_shown_whole(tmp_path, capsys):
    from photomap_gis.cli import main

    field = "47,8;47,8.004;47.003,8.004;47.003,8.001"
    zone = "47.001,8.002;47.001,8.0025;47.0015,8.0025"
    path = tmp_path / "field.plan"
    assert main(["plan", field, "--avoid", zone, "--height", "60", "-o", str(path), "-q"]) == 0
    shown = stored.stored_features(path)
    mission = read_mission(path)
    placed = [i for i in mission.items if i.command in stored.PLACE_COMMANDS and i.x]
    assert [f["geometry"]["coordinates"] for f in shown["items"]] == [
        pytest.approx([i.y, i.x], abs=1e-9) for i in placed
    ]
    assert [f["properties"]["seq"] for f in shown["items"]] == [
        n for n, i in enumerate(mission.items, 1) if i in placed
    ]
    assert len(shown["route"][0]["geometry"]["coordinates"]) == len(placed)
    assert len(shown["fence"]) == len(mission.fence_polygons)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"mission": 3}', '{"mission": {"items": [3]}}', "\0"])
def test_what_is_no_mission_is_told(tmp_path, text):
    path = tmp_path / "x.plan"
    path.write_text(text)
    with pytest.raises(stored.UnreadableMissionError, match="cannot be read"):
        stored.stored_features(path)


WORDS = ("mission", "items", "params", "type", "SimpleItem", "command", "geoFence", "polygons", "polygon")
documents = st.recursive(
    st.none() | st.booleans() | st.floats() | st.sampled_from(WORDS),
    lambda child: st.lists(child) | st.dictionaries(st.sampled_from(WORDS), child),
)


@settings(max_examples=50, deadline=None)
@given(documents)
def test_no_file_breaks_it(tmp_path_factory, document):
    path = tmp_path_factory.mktemp("x") / "x.plan"
    path.write_text(json.dumps({"mission": {"items": document}, "geoFence": document}))
    with contextlib.suppress(stored.UnreadableMissionError):
        shown = stored.stored_features(path)
        assert set(shown) == {"items", "route", "fence"}
