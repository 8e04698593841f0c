"""What a vehicle held, in a file."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink.saved import is_lists_file, read_lists, write_lists
from photomap_gis.mission_planner.mavlink.state import VehicleState
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem

STATE = VehicleState(3, 1, Autopilot.ARDUPILOT, "quadrotor", "LOITER", False, "standby", 0.0)
_number = st.floats(allow_nan=False, allow_infinity=False, width=32)
_int = st.integers(-(2**31), 2**31 - 1)
_items = st.lists(
    st.builds(WireItem, st.integers(0, 65535), st.integers(0, 255), st.tuples(*[_number] * 4), _int, _int, _number),
    max_size=5,
).map(tuple)


@given(lists=st.dictionaries(st.sampled_from(list(Kind)), _items))
def test_lists_come_back_as_they_were(tmp_path_factory, lists):
    path = tmp_path_factory.mktemp("saved") / "a.json"
    write_lists(path, STATE, lists)
    assert is_lists_file(path)
    assert read_lists(path) == (Autopilot.ARDUPILOT, lists)


def test_nan_is_null(tmp_path):
    path = tmp_path / "a.json"
    write_lists(path, STATE, {Kind.MISSION: (WireItem(16, 3, (0.0, 0.0, 0.0, math.nan)),)})
    assert json.loads(path.read_text())["mission"][0]["params"][3] is None
    assert math.isnan(read_lists(path)[1][Kind.MISSION][0].params[3])


@pytest.mark.parametrize(
    "change",
    [
        {"version": 2},
        {"autopilot": "other"},
        {"mission": [{"command": 16}]},
        {
            "mission": [
                {"command": 70000, "frame": 3, "params": [0, 0, 0, 0], "x": 0, "y": 0, "z": 0, "autocontinue": True}
            ]
        },
        {"mission": [{"command": 16, "frame": 3, "params": [0, 0, 0], "x": 0, "y": 0, "z": 0, "autocontinue": True}]},
        {
            "mission": [
                {"command": 16, "frame": 3, "params": [0, 0, 0, 0], "x": 2**40, "y": 0, "z": 0, "autocontinue": True}
            ]
        },
        {"more": 1},
    ],
)
def test_what_is_no_such_file_is_told(tmp_path, change):
    path = tmp_path / "a.json"
    path.write_text(
        json.dumps({"fileType": "photomap vehicle lists", "version": 1, "autopilot": "px4", "system": 1} | change)
    )
    with pytest.raises(DataError, match="not a file of saved"):
        read_lists(path)


def test_garbage_and_absence(tmp_path):
    path = tmp_path / "a.json"
    path.write_bytes(b"\xff\x00")
    assert not is_lists_file(path) and not is_lists_file(tmp_path / "b.json")
    for bad in (path, tmp_path / "b.json"):
        with pytest.raises(DataError):
            read_lists(bad)
