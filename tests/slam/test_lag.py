"""Fixes older than their pictures."""

from dataclasses import replace

import flights as fl
import numpy as np
import pytest

from photomap_gis.slam import solve
from photomap_gis.slam.lag import lags_by_flight, without_lag


def late(flight, positions, lag_s):
    """The fixes as they were ``lag_s`` earlier on the true path."""
    path = flight.centres_m
    out = []
    for p in positions:
        then = [np.interp(p.time_s - lag_s, flight.times_s, path[:, k]) for k in (0, 1)]
        out.append(replace(p, xy_map_m=p.xy_map_m + then - path[p.frame]))
    return out


@pytest.mark.parametrize("lag_s", [1.2, -1.5])
def test_a_lag_is_found_and_taken_out(rng, lag_s):
    flight = fl.lawnmower(rng)
    edges, positions = fl.edges(rng, flight), fl.fixes(rng, flight, drift_m=1.0, bias_m=0.0)
    graph = fl.graph(flight, edges, late(flight, positions, lag_s))
    raw = solve(replace(graph, positions=tuple(positions)), backend="scipy")
    found = lags_by_flight(raw, graph.positions)
    assert found[0] == pytest.approx(lag_s, abs=0.25)
    mended = without_lag(raw, graph.positions, found)
    miss = [m.xy_map_m - p.xy_map_m for m, p in zip(mended, positions, strict=True)]
    assert np.median(np.linalg.norm(miss, axis=1)) < 1.5
    whole = solve(graph, backend="scipy")
    assert whole.fit_to_gps_rms_m < 2.0 * raw.fit_to_gps_rms_m


def test_a_punctual_flight_keeps_its_fixes(rng):
    for _ in range(4):
        flight = fl.lawnmower(rng)
        positions = fl.fixes(rng, flight, blunders=0.05)
        solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
        assert lags_by_flight(solution, positions) == {}


def test_few_fixes_have_no_lag(rng):
    flight = fl.lawnmower(rng, 1, 6)
    positions = fl.fixes(rng, flight)
    solution = solve(fl.graph(flight, fl.edges(rng, flight), positions), backend="scipy")
    assert lags_by_flight(solution, positions) == {} and lags_by_flight(solution, []) == {}
