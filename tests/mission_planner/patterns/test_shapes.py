"""The patterns are what IAMSAR says that they are."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from shapely.geometry import LineString, Polygon, box

from photomap_gis.core.errors import UsageError
from photomap_gis.mission_planner.patterns import Pattern, detection, from_area, from_datum, from_line, sweep_width_m
from photomap_gis.mission_planner.patterns.detection import spacing_m


def headings_and_lengths(xy: np.ndarray) -> tuple[list[float], list[float]]:
    steps = np.diff(xy, axis=0)
    return [math.degrees(math.atan2(x, y)) % 360 for x, y in steps], list(np.hypot(*steps.T))


@pytest.mark.parametrize("first", [0.0, 57.0])
def test_expanding_square(first: float):
    """Legs 1, 1, 2, 2, 3, 3, ... spacings, each turned right by 90 degrees, the first one down-drift."""
    (leg,) = from_datum(Pattern.EXPANDING_SQUARE, spacing_m=20, radius_m=60, heading_deg=first).legs
    headings, lengths = headings_and_lengths(leg)
    assert np.allclose((np.array(headings) - first - 90 * np.arange(len(headings)) + 180) % 360, 180)
    assert np.allclose(lengths, 20.0 * np.array([1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 6]))
    assert np.allclose(leg[0], 0) and np.abs(np.hypot(*leg.T).max() - 60 * math.sqrt(2)) < 1e-9


@pytest.mark.parametrize("first", [0.0, 200.0])
def test_sector(first: float):
    """Nine legs of one length, three triangles through the datum, all turns 120 degrees to the right or none."""
    (leg,) = from_datum(Pattern.SECTOR, spacing_m=1, radius_m=500, heading_deg=first, passes=2).legs
    headings, lengths = headings_and_lengths(leg)
    assert np.allclose(lengths, 500)
    assert np.allclose(leg[[0, 3, 6, 9, 12, 15, 18]], 0.0)
    turns = (np.round(np.diff(headings)) % 360).tolist()
    one = [120, 120, 0, 120, 120, 0, 120, 120]
    assert turns == [*one, 30.0, *one]
    assert headings[0] == pytest.approx(first)


def test_sector_has_at_most_two_passes():
    with pytest.raises(UsageError, match="1 or 2 passes"):
        from_datum(Pattern.SECTOR, spacing_m=1, radius_m=500, passes=3)


def test_parallel_goes_along_the_long_side_and_creeping_along_the_short_one():
    area = shapely.affinity.rotate(box(0, 0, 400, 100), 30)  # long side at heading 60
    for pattern, heading, count in ((Pattern.PARALLEL, 60, 3), (Pattern.CREEPING, 150, 10)):
        legs = from_area(pattern, area, spacing_m=40).legs
        assert len(legs) == count
        for leg in legs:
            (h,), _ = headings_and_lengths(leg)
            assert min(abs((h - heading) % 180), 180 - abs((h - heading) % 180)) < 1e-6
    legs = from_area(Pattern.PARALLEL, box(0, 0, 400, 100), spacing_m=50).legs
    # half a track spacing inside the corner; the next leg a spacing on and flown the other way
    assert np.allclose(np.sort(np.concatenate(legs), axis=0), [[25, 25], [25, 25], [375, 75], [375, 75]])
    assert np.allclose(legs[0][-1][0], legs[1][0][0])


@st.composite
def areas(draw: st.DrawFn) -> Polygon:
    angles = np.sort(np.array(draw(st.lists(st.floats(0, 2 * math.pi), min_size=3, max_size=9, unique=True))))
    radii = np.array(draw(st.lists(st.floats(60, 400), min_size=len(angles), max_size=len(angles))))
    ring = Polygon(np.column_stack((radii * np.cos(angles), radii * np.sin(angles))))
    return shapely.make_valid(ring)


@settings(max_examples=60, deadline=None)
@given(areas(), st.floats(15, 80), st.sampled_from([Pattern.PARALLEL, Pattern.CREEPING]))
def test_a_square_swath_as_wide_as_the_spacing_covers_any_area(area: Polygon, spacing: float, pattern: Pattern):
    if area.area < 100 or area.geom_type != "Polygon":
        return
    legs = from_area(pattern, area, spacing_m=spacing).legs
    swath = shapely.union_all([LineString(leg).buffer(spacing / 2 + 1e-3, cap_style="square") for leg in legs])
    assert area.difference(swath).area < 1e-3 * area.area


@settings(max_examples=40, deadline=None)
@given(st.floats(5, 50), st.floats(60, 500), st.sampled_from([Pattern.EXPANDING_SQUARE, Pattern.SPIRAL]))
def test_datum_patterns_cover_to_their_radius(spacing: float, radius: float, pattern: Pattern):
    (leg,) = from_datum(pattern, spacing_m=spacing, radius_m=radius).legs
    swath = LineString(leg).buffer(spacing * 0.501, cap_style="square", join_style="mitre")
    assert shapely.Point(0, 0).buffer(radius).difference(swath).area < 1e-5 * radius**2


def test_a_spiral_is_round_to_a_twentieth_of_its_spacing():
    (leg,) = from_datum(Pattern.SPIRAL, spacing_m=20, radius_m=200).legs
    dense = shapely.get_coordinates(shapely.segmentize(LineString(leg), 0.5))
    r, angle = np.hypot(*dense.T), np.unwrap(np.arctan2(dense[:, 0], dense[:, 1]))
    ideal = np.minimum(19 * (angle - angle[1]) / (2 * math.pi), 191)
    far = (r > 20) & (r < 185)
    assert np.abs(r - ideal)[far].max() < 4.0
    assert len(leg) < 260


def test_an_orbit_is_a_circle_to_the_right():
    (leg,) = from_datum(Pattern.ORBIT, spacing_m=1, radius_m=80, passes=2).legs
    assert np.allclose(np.hypot(*leg.T), 80) and np.allclose(leg[0], leg[-1])
    turned = np.unwrap(np.arctan2(leg[:, 0], leg[:, 1]))
    assert turned[-1] - turned[0] == pytest.approx(4 * math.pi) and (np.diff(turned) > 0).all()


def test_a_perimeter_stays_half_a_spacing_inside():
    area = Polygon(box(0, 0, 300, 200).exterior, [box(100, 80, 150, 120).exterior])
    rings = from_area(Pattern.PERIMETER, area, spacing_m=20, passes=2).legs
    assert len(rings) == 4
    for ring, inside in zip(rings, (10, 10, 30, 30), strict=True):
        assert LineString(ring).distance(area.boundary) == pytest.approx(inside)
        assert area.covers(LineString(ring))
    assert not Polygon(rings[0]).exterior.is_ccw  # to the right
    with pytest.raises(UsageError, match="smaller --track-spacing"):
        from_area(Pattern.PERIMETER, area, spacing_m=500)


def test_track_line_and_return():
    legs = from_line(LineString([(0, 0), (0, 300), (200, 300)]), spacing_m=40, passes=1).legs
    out, back = legs
    assert np.allclose(out[0], [20, 0]) and np.allclose(back[-1], [-20, 0])
    assert LineString(out).distance(LineString(back)) == pytest.approx(40)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_numbers_that_make_no_pattern_are_refused(bad: float):
    with pytest.raises(UsageError, match="track-spacing"):
        from_datum(Pattern.SPIRAL, spacing_m=bad, radius_m=100)
    with pytest.raises(UsageError, match="reach"):
        from_datum(Pattern.SPIRAL, spacing_m=10, radius_m=bad)
    with pytest.raises(UsageError, match="sweep-width"):
        detection(bad, 10)


def test_a_pattern_without_end_is_refused():
    for pattern in (Pattern.SPIRAL, Pattern.EXPANDING_SQUARE):
        with pytest.raises(UsageError, match="more than 20000 points"):
            from_datum(pattern, spacing_m=0.01, radius_m=1000)
    with pytest.raises(UsageError, match="more than 20000 points"):
        from_area(Pattern.PARALLEL, box(0, 0, 1000, 1000), spacing_m=0.01)


def test_probability_of_detection():
    """Koopman's curves at the points that search manuals print."""
    found = detection(20, 20)
    assert found.coverage_factor == 1.0
    assert found.pod_random == pytest.approx(1 - math.exp(-1)) and found.pod_inverse_cube == pytest.approx(
        0.79, abs=0.005
    )
    assert detection(20, 40).pod_inverse_cube == pytest.approx(0.47, abs=0.005)
    by_area = detection(20, 99, length_m=1000, area_m2=40_000)
    assert by_area.coverage_factor == 0.5
    assert spacing_m(30, 1.5) == 20


@given(st.floats(0.01, 5))
def test_the_careful_model_never_promises_more(factor: float):
    found = detection(factor, 1.0)
    assert 0 < found.pod_random < found.pod_inverse_cube <= 1


def test_sweep_width_is_the_swath_where_the_target_is_resolved():
    assert sweep_width_m(100.0, 2000.0, 4000, 0.5) == pytest.approx(200.0)
    with pytest.raises(UsageError, match="fly at 125 m or lower"):
        sweep_width_m(130.0, 2000.0, 4000, 0.5)
