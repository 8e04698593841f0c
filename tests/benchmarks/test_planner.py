"""The planner's benchmark on a few of its areas: everything is covered, and no rival that covers as much is faster."""

from benchmarks.planner.__main__ import measure
from benchmarks.planner.areas import areas


def test_the_corpus_is_the_same_every_time_and_half_convex():
    first, again = list(areas(20)), list(areas(20))
    assert [a.polygon.wkt for a in first] == [a.polygon.wkt for a in again]
    assert [a.convex for a in first] == [True, False] * 10
    assert all(a.polygon.convex_hull.area < 1.001 * a.polygon.area for a in first if a.convex)


def test_our_plans_cover_and_are_not_slower():
    found = measure(6)
    assert found["uncovered"] == 0
    assert found["compared"] >= 1
    assert found["ratio_best"] <= 1.0
