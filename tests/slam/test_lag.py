"""Fixes older than their pictures: the lag and its sigma, from the motion alone."""

from dataclasses import replace

import flights as fl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photomap_gis.core.posegraph import FixLag
from photomap_gis.slam import solve
from photomap_gis.slam.lag import ErrorModel, estimate_lag, lags_by_flight, without_lag

PLAIN = ErrorModel(0.5, 2.0, 60.0)


def late(flight, positions, lag_s):
    """The fixes as they were ``lag_s`` earlier on the true path."""
    path = flight.centres_m
    out = []
    for p in positions:
        then = [np.interp(p.time_s - lag_s, flight.times_s, path[:, k]) for k in (0, 1)]
        out.append(replace(p, xy_map_m=p.xy_map_m + then - path[p.frame]))
    return out


def serpentine(rng, seconds=480.0, dt_s=2.0, speed_m_s=8.0, strip_m=200.0, spacing_m=25.0):
    """Times of the frames, and the true place (x + iy) at any time: strips to and fro, half circles, gusts."""
    fine_s = np.arange(-30.0, seconds + 30.0, 0.1)
    gust = np.convolve(rng.normal(size=len(fine_s)), np.ones(100) / 10.0, mode="same")
    way = np.cumsum(speed_m_s * (1.0 + 0.15 * gust) * 0.1)
    arc = np.pi * spacing_m / 2.0
    lap, into = np.divmod(way - way[0], strip_m + arc)
    turn = np.clip((into - strip_m) / arc, 0.0, 1.0) * np.pi
    north = np.where(lap % 2 == 0, 1.0, -1.0)
    y = np.where(north > 0, 0.0, strip_m) + north * (np.minimum(into, strip_m) + spacing_m / 2.0 * np.sin(turn))
    x = lap * spacing_m + spacing_m / 2.0 * (1.0 - np.cos(turn))
    return np.arange(
        0.0, seconds, dt_s
    ), lambda when_s: np.interp(when_s, fine_s, x) - 1j * np.interp(when_s, fine_s, y)


def gps_error(rng, time_s, model=PLAIN):
    drift = fl.gauss_markov(rng, time_s, model.drift_m, model.drift_time_s)
    return (drift + rng.normal(0, model.white_m, drift.shape) + rng.normal(0, 1.0, 2)) @ (1, 1j)


def test_offsets_are_recovered_within_a_tenth_of_a_second_and_sigma_tells_by_how_much():
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        time_s, place = serpentine(rng)
        lag_s = rng.uniform(-3.0, 3.0)
        fixes = place(time_s - lag_s) + gps_error(rng, time_s)
        fixes[rng.random(len(fixes)) < 0.02] += 80.0
        # the path is solved in pixels of its first frame, turned and scaled
        found = estimate_lag(time_s, 9.0 * np.exp(1j * rng.uniform(0, 6)) * place(time_s) + 500.0, fixes, PLAIN,
                             reach_s=6.0)  # fmt: skip
        assert found.sigma_s < 0.05 and found.believed == (abs(found.lag_s) >= 0.1)
        off.append([found.lag_s - lag_s, found.sigma_s])
    error, sigma = np.transpose(off)
    assert np.abs(error).max() < 0.1
    assert 0.3 < np.mean((error / sigma) ** 2) < 2.5


@settings(max_examples=20, deadline=None)
@given(
    turn=st.floats(-np.pi, np.pi), scale=st.floats(0.01, 100.0), x=st.floats(-1e4, 1e4), y=st.floats(-1e4, 1e4),
    start_s=st.floats(0.0, 2e9),
)  # fmt: skip
def test_neither_the_paths_frame_nor_the_clocks_zero_matter(turn, scale, x, y, start_s):
    rng = np.random.default_rng(5)
    time_s, place = serpentine(rng, seconds=240.0)
    fixes = place(time_s - 0.8) + gps_error(rng, time_s)
    one = estimate_lag(time_s, place(time_s), fixes, PLAIN, reach_s=3.0)
    two = estimate_lag(
        time_s + start_s, scale * np.exp(1j * turn) * (place(time_s) + complex(x, y)), fixes, PLAIN, reach_s=3.0
    )
    assert two.lag_s == pytest.approx(one.lag_s, abs=1e-3) and two.sigma_s == pytest.approx(one.sigma_s, rel=0.01)


def test_a_straight_and_steady_flight_does_not_tell(rng):
    time_s = np.arange(0.0, 300.0, 2.0)
    path = 8.0 * time_s + 0j
    assert estimate_lag(time_s, path, path - 8.0 + gps_error(rng, time_s), PLAIN, reach_s=6.0) is None


def test_strips_flown_all_alike_do_not_tell_a_lap_from_none(rng):
    """What lies a lap away is only told apart by the flight's ends and its gusts: here there are none of either."""
    time_s = np.arange(0.0, 400.0, 1.0)
    place = lambda t: 40.0 * np.sin(2 * np.pi * t / 12.0) + 1j * t  # noqa: E731 - a lap of 12 s
    fixes = place(time_s) + gps_error(rng, time_s)
    assert estimate_lag(time_s, place(time_s), fixes, PLAIN, reach_s=14.0) is None
    assert abs(estimate_lag(time_s, place(time_s), fixes, PLAIN, reach_s=4.0).lag_s) < 0.1


def test_a_lag_beyond_reach_or_few_fixes_are_not_told(rng):
    time_s, place = serpentine(rng)
    fixes = place(time_s - 9.0) + gps_error(rng, time_s)
    assert estimate_lag(time_s, place(time_s), fixes, PLAIN, reach_s=4.0) is None
    assert estimate_lag(time_s[:10], place(time_s[:10]), fixes[:10], PLAIN, reach_s=2.0) is None


@pytest.mark.parametrize(
    ("lag_s", "sigma_s", "believed"), [(0.3, 0.05, True), (-0.3, 0.1, False), (0.05, 0.001, False)]
)
def test_a_lag_is_believed_beyond_its_sigma(lag_s, sigma_s, believed):
    assert FixLag(lag_s, sigma_s).believed is believed


@pytest.mark.parametrize("lag_s", [1.2, -1.5])
def test_a_lag_is_found_and_taken_out(rng, lag_s):
    flight = fl.lawnmower(rng)
    edges, positions = fl.edges(rng, flight), fl.fixes(rng, flight, drift_m=1.0, bias_m=0.0)
    graph = fl.graph(flight, edges, late(flight, positions, lag_s))
    raw = solve(replace(graph, positions=tuple(positions)), backend="scipy")
    found = lags_by_flight(raw, graph.positions)
    assert found[0].lag_s == pytest.approx(lag_s, abs=0.25)
    mended = without_lag(raw, graph.positions, {0: found[0].lag_s})
    miss = [m.xy_map_m - p.xy_map_m for m, p in zip(mended, positions, strict=True)]
    assert np.median(np.linalg.norm(miss, axis=1)) < 1.5
    whole = solve(graph, backend="scipy")
    assert whole.fit_to_gps_rms_m < 2.0 * raw.fit_to_gps_rms_m
    assert whole.fix_lags_s == {0: whole.fix_lags[0].lag_s}
    assert solve(graph, backend="scipy", find_lag=False).fix_lags == {}


def test_a_punctual_flight_keeps_its_fixes():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        flight = fl.lawnmower(rng)
        positions = fl.fixes(rng, flight, blunders=0.05)
        solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
        assert not any(lag.believed for lag in lags_by_flight(solution, positions).values())


def test_few_fixes_have_no_lag(rng):
    flight = fl.lawnmower(rng, 1, 6)
    positions = fl.fixes(rng, flight)
    solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
    assert lags_by_flight(solution, positions) == {} and lags_by_flight(solution, []) == {}
