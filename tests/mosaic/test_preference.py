"""What the user prefers is what the map shows: the newest frame, the sharpest one, the one that looks down."""

import itertools
import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import Prefer, plan_grid, render_mosaic
from photomap_gis.mosaic.preference import MAX_COST, costs_of_age, costs_of_detail, detail_m
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME, Flight, lawnmower, place

TIMES = st.dictionaries(
    st.integers(0, 50), st.one_of(st.none(), st.floats(0, 2e9)), min_size=1, max_size=30
)  # fmt: skip


@given(TIMES)
def test_newer_never_costs_more(times):
    costs = costs_of_age(times)
    assert costs.keys() == times.keys() and all(0.0 <= c <= MAX_COST + 1e-6 for c in costs.values())
    for a, b in itertools.combinations(times, 2):
        ta, tb = (-math.inf if times[f] is None else times[f] for f in (a, b))
        if ta > tb:
            assert costs[a] <= costs[b] + 1e-9
    assert min(costs.values()) == 0.0 or all(t is None for t in times.values())


def test_half_a_minute_outweighs_a_frame_and_days_do_not_drown_minutes():
    costs = costs_of_age({0: 0.0, 1: 30.0, 2: 86400.0, 3: 86430.0})
    assert costs[0] - costs[1] == pytest.approx(1.0) and costs[2] - costs[3] == pytest.approx(1.0)
    assert 1.0 < costs[1] - costs[2] <= 10.0


@given(st.dictionaries(st.integers(0, 9), st.floats(1e-3, 1e3), min_size=2))
def test_finer_detail_never_costs_more(details):
    costs = costs_of_detail(details)
    order = sorted(details, key=details.__getitem__)
    assert [costs[f] for f in order] == sorted(costs[f] for f in order)


def test_an_unknown_blur_is_taken_for_none():
    assert detail_m(0.1, math.nan) == detail_m(0.1, 0.2) == 0.1
    assert detail_m(0.1, 2.0) == pytest.approx(0.471, abs=1e-3)


def flown_twice(ground) -> Flight:
    """A lawnmower flown twice: frames 0-17, then 100-117 a bit aside."""
    flights = [lawnmower(ground, np.random.default_rng(seed)) for seed in (1, 2)]
    both = Flight(ground, [], {})
    for k, flight in enumerate(flights):
        for p in flight.placements:
            moved = type(p)(100 * k + p.frame, *(getattr(p, n) for n in p.__slots__[1:]))
            both.placements.append(moved)
            both.images[moved.frame] = flight.images[p.frame]
    return both


def sources(flight, folder, **kw):
    grid = plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M, tile_size=256)
    store = render_mosaic(flight.trajectory, MAP_FRAME, grid, flight.read, folder, revision=1, **kw)
    return np.concatenate([store.read_source(t).ravel() for t in grid.tiles()])


def test_the_newest_flight_is_shown(ground, tmp_path):
    flight = flown_twice(ground)
    times = {f: 1000.0 + f % 100 * 2.0 + (86400.0 if f < 100 else 0.0) for f in flight.images}
    shown = sources(flight, tmp_path, prefer=Prefer.NEWEST, times_s=times)
    seen = shown >= 0
    assert (shown[seen] < 100).mean() > 0.95  # all but the rim that only the older flight saw
    other = sources(flight, tmp_path, prefer=Prefer.NEWEST, times_s={f: -t for f, t in times.items()})
    assert (other[other >= 0] >= 100).mean() > 0.95, "another wish draws the map anew"


def test_blurred_frames_are_left_to_others(ground, tmp_path):
    flight = flown_twice(ground)
    for f in list(flight.images)[::3]:
        flight.images[f] = cv2.GaussianBlur(flight.images[f], (0, 0), 3.0)
    blurred = set(list(flight.images)[::3])
    share = {}
    for prefer in (Prefer.NADIR, Prefer.SHARP):
        shown = sources(flight, tmp_path / prefer, prefer=prefer)
        share[prefer] = np.isin(shown[shown >= 0], list(blurred)).mean()
    assert share[Prefer.NADIR] > 0.2 and share[Prefer.SHARP] < 0.4 * share[Prefer.NADIR]


def test_of_a_hovering_crowd_the_newest_gets_the_cell(ground):
    crowd = Trajectory(tuple(place(i, 100.0, 80.0) for i in range(4)), 1)
    assert [v.frame for v in views_of(crowd)] == [0]
    assert [v.frame for v in views_of(crowd, costs_of_age({i: float(i) for i in range(4)}))] == [3]


def test_a_leaning_camera_is_preferred_where_it_looks_straight_down():
    camera = Camera(240, 180, focal_px=220.0)
    level, ahead = (views_of(Trajectory((place(0, 0, 0, camera=camera, tilt_rad=(t, 0.0)),)))[0] for t in (0.0, 0.15))
    assert level.middle_xy_px == pytest.approx((119.5, 89.5))
    below = ahead.placement.camera_to_map.unproject(ahead.placement.plumb_xy_map_m[None])[0]
    assert ahead.middle_xy_px == pytest.approx(below) and abs(below[1] - 89.5) > 20
    far = views_of(Trajectory((place(0, 0, 0, camera=camera, tilt_rad=(0.6, 0.0)),)))[0]
    assert np.hypot(*(far.middle_xy_px - (119.5, 89.5))) <= 0.35 * 180 + 1e-6
