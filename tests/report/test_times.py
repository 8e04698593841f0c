"""Table 1: how long the autopilot flew, how long the pilot did."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.ingest.telemetry.modes import flies_by_itself, px4_mode
from photomap_gis.report import Moment, flight_times


def _flight(seconds, height=20.0):
    return [Moment(float(s), height) for s in range(seconds + 1)]


@given(changes=st.lists(st.tuples(st.floats(-10, 130), st.booleans()), min_size=1, max_size=8))
def test_every_second_in_the_air_is_flown_by_one_of_them(changes):
    told = flight_times("f", _flight(100), changes, overall_s=150.0)
    assert told.autonomous_s + told.manual_s == pytest.approx(100.0)
    assert told.overall_s == 150.0


def test_time_on_the_ground_and_silence_of_the_log_are_not_flown():
    ground = [Moment(float(s), 0.2) for s in range(30)]
    air = [Moment(float(s), 10.0) for s in range(30, 61)]
    later = [Moment(float(s), 10.0) for s in range(200, 211)]
    told = flight_times("f", [*ground, *air, *later], [(0.0, False), (40.0, True)], overall_s=210.0)
    assert (told.manual_s, told.autonomous_s) == (10.0, 30.0)


def test_without_heights_all_of_it_counts_and_that_is_said():
    told = flight_times("f", [Moment(0.0, None), Moment(5.0, None)], [(0.0, True)], overall_s=5.0)
    assert told.autonomous_s == 5.0 and not told.airborne_known


def test_without_modes_nothing_is_known():
    assert flight_times("f", _flight(10), [], overall_s=10.0) is None


@pytest.mark.parametrize(
    ("mode", "alone"),
    [("AUTO", True), ("RTL", True), ("AUTO_MISSION", True), ("GUIDED", True), ("LOITER", False), ("STABILIZE", False),
     ("POSCTL", False), ("mode 77", False)],
)  # fmt: skip
def test_which_modes_fly_by_themselves(mode, alone):
    assert flies_by_itself(mode) is alone


def test_modes_of_px4_are_told_by_two_bytes():
    assert px4_mode(0x04040000) == "AUTO_MISSION"
    assert px4_mode(0x00030000) == "POSCTL"


def test_a_real_survey_was_flown_by_the_autopilot(shared_data):
    """The log of a simulated ArduCopter: armed, taken off by GUIDED, then its mission in AUTO."""
    from photomap_gis.ingest.telemetry import read_track

    for name in ("copter_survey.BIN", "copter_survey.tlog"):
        track = read_track(shared_data / "flightlogs" / name)
        moments = [Moment(p.time_s, p.height_m) for p in track.points]
        changes = [(m.time_s, flies_by_itself(m.name)) for m in track.modes]
        told = flight_times(name, moments, changes, overall_s=track.duration_s)
        assert told.airborne_known and 240 < told.autonomous_s < told.overall_s
        assert told.manual_s < 5.0
