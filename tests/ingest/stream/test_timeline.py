"""The stream's time: laws for any time stamps, and what a jump does."""

import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.ingest.stream.timeline import Timeline

stamps = st.lists(
    st.tuples(st.one_of(st.none(), st.floats(-1e6, 1e6), st.just(math.nan)), st.floats(0.0, 10.0)), min_size=2
)


@given(stamps, st.booleans())
def test_whatever_the_stamps_time_begins_at_zero_and_rises(stamps: list, by_arrival: bool) -> None:
    timeline = Timeline(by_arrival=by_arrival)
    arrival_s = 100.0
    told = []
    for pts_s, waited_s in stamps:
        arrival_s += waited_s
        told.append(timeline.place(pts_s, arrival_s).stream_time_s)
    assert told[0] == 0.0
    assert all(b > a for a, b in itertools.pairwise(told))


@given(st.lists(st.floats(0.001, 4.9), min_size=1, max_size=50), st.floats(-1e5, 1e5))
def test_stamps_that_rise_are_believed(steps: list[float], first_s: float) -> None:
    timeline = Timeline(by_arrival=True)
    timeline.place(first_s, 0.0)
    at_s = 0.0
    for step in steps:
        at_s += step
        moment = timeline.place(first_s + at_s, 0.0)  # arrivals in one burst do not matter
        assert math.isclose(moment.stream_time_s, at_s, abs_tol=1e-6) and moment.jump_s is None


def test_a_jump_goes_on_by_the_clock_of_arrival() -> None:
    timeline = Timeline(by_arrival=True)
    timeline.place(10.0, 1000.0)
    back = timeline.place(0.5, 1000.2)
    assert back.jump_s == -9.5 and math.isclose(back.stream_time_s, 0.2, abs_tol=1e-9)
    ahead = timeline.place(95_443.7, 1000.3)  # the 33 bits of a transport stream begin anew
    assert ahead.jump_s is not None and math.isclose(ahead.stream_time_s, 0.3, abs_tol=1e-9)


def test_a_long_silence_is_believed_where_as_much_time_went_by() -> None:
    timeline = Timeline(by_arrival=True)
    timeline.place(10.0, 1000.0)
    moment = timeline.place(22.0, 1011.5)
    assert moment.jump_s is None and moment.stream_time_s == 12.0


def test_a_new_connection_goes_on_by_the_clock_of_arrival() -> None:
    timeline = Timeline(by_arrival=True)
    timeline.place(500.0, 20.0)
    timeline.restart()
    moment = timeline.place(500.1, 27.0)
    assert moment.stream_time_s == 7.0 and moment.jump_s is None
