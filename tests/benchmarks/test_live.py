"""The live benchmark's own parts: long flights out of short ones, breaks that are told, what a page has seen."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.live.breaks import Break
from benchmarks.live.browser import Seen
from benchmarks.live.patrol import ASIDE_M, GROUNDS, Lap
from benchmarks.live.realtime import EngineLog
from photomap_gis.core.frame import Attitude, FrameRef, GpsFix
from photomap_gis.live.loop import Interval

HOME = GpsFix(50.0, 8.0)
REF = FrameRef(0, "f", "v.mp4", 640, 360, fix=GpsFix(50.001, 8.002), attitude=Attitude(0.3, 0.1, 0.05))


def test_four_laps_are_four_grounds_and_then_they_come_again(rng: np.random.Generator) -> None:
    image = rng.integers(0, 256, (8, 10, 3), np.uint8)
    seen = [Lap.of(n, rounds=True).image(image) for n in range(2 * GROUNDS)]
    assert len({s.tobytes() for s in seen}) == GROUNDS
    for n in range(GROUNDS):
        np.testing.assert_array_equal(seen[n], seen[n + GROUNDS])
    np.testing.assert_array_equal(seen[1], image[:, ::-1])
    np.testing.assert_array_equal(seen[2], 255 - image)


def test_a_mirrored_lap_is_flown_mirrored() -> None:
    placed = Lap(True, False, 0.0).placed(REF, HOME)
    assert placed.fix is not None and placed.attitude is not None
    assert placed.fix.lon_deg == pytest.approx(7.998) and placed.fix.lat_deg == 50.001
    assert placed.attitude.yaw_rad == -0.3 and placed.attitude.pitch_rad == 0.1
    assert Lap(False, True, 0.0).placed(REF, HOME) == REF


def test_laps_lie_side_by_side_or_in_rounds() -> None:
    east_m = [Lap.of(n, rounds=r).aside_m / ASIDE_M for r in (False, True) for n in range(GROUNDS + 2)]
    assert east_m == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 0, 1]
    moved = Lap(False, False, 1000.0).placed(REF, HOME).fix
    assert moved is not None
    assert (moved.lon_deg - 8.002) * 111319.49 * np.cos(np.radians(50.0)) == pytest.approx(1000.0, rel=1e-6)


@pytest.mark.parametrize(
    ("told", "wanted"),
    [
        ([("error_frames", 10.0, 10.6)], True),
        ([("error_frames", 10.1, 10.3), ("not_recognised", 10.3, 10.9)], True),  # by two that follow each other
        ([("error_frames", 10.0, None)], False),  # never over
        ([("error_frames", 10.0, 14.0)], False),  # too long
        ([("error_frames", 3.0, 3.5)], False),
        ([("no_position", 10.0, 10.5)], False),
        ([], False),
    ],
)
def test_a_break_is_told_when_it_began_and_ended(told: list[tuple[str, float, float | None]], wanted: bool) -> None:
    one = Break("torn", 10.0, 10.5, ("error_frames", "not_recognised"))
    assert one.is_told([Interval(kind, since, until) for kind, since, until in told]) is wanted


def test_what_a_page_saw_is_timed_by_when_the_frames_came() -> None:
    log = EngineLog([100.0, 100.1], {7: (100.0, frozenset({(20, 30)})), 9: (100.1, frozenset({(21, 30)}))})
    tiles = [(3, 10, 15, '"1-0-6"', 100.05), (3, 10, 15, '"1-0-9"', 100.3), (3, 99, 99, '"1-0-9"', 100.2)]
    pose, ground = log.in_page(Seen([(0, 100.02), (1, 100.15), (5, 101.0)], tiles), zoom=4)
    assert pose == pytest.approx([20.0, 50.0])
    assert sorted(ground) == pytest.approx([200.0, 300.0])  # version 7 first came into sight with 9
    assert log.in_page(Seen([], [(3, 10, 15, '"1-0-9"', 109.0)]), zoom=4)[1] == []  # out of sight till then
