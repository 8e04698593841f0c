"""Bad links: error frames in bursts, a link that was lost, a GPS that was lost; at the end one map, nothing hidden."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from photomap_gis.core.live import GapKind, StreamEvent
from photomap_gis.simulate.breakage import Breakage, break_frame
from tests.live.conftest import Flown, frame_of, gap_of, worst_error_m


def test_bursts_of_error_frames_are_waited_out(fly, flown: Flown) -> None:
    rng = np.random.default_rng(7)
    kinds = [Breakage.GREY, Breakage.MACROBLOCKS, Breakage.BLACK, Breakage.TEARING, Breakage.FROZEN]
    broken = {start + i: kinds[n % len(kinds)] for n, start in enumerate((20, 50, 85, 115)) for i in range(3)}

    def events() -> Iterator[StreamEvent]:
        last = None
        for k in range(len(flown.refs)):
            image = flown.images[k]
            if k in broken:
                yield frame_of(flown, k, break_frame(image, last, broken[k], rng))
            else:
                last = image
                yield frame_of(flown, k)

    flight = fly(events())
    tally, tracker = flight.session.loop.tally, flight.session.loop.tracker
    used = {int(r.frame_number or 0) for r in tracker.chart.refs}
    assert not used & set(broken)  # none of them is in the map
    assert tracker.pieces == 1
    reported = [i for i in tally.intervals if i.kind in ("error_frames", "not_recognised", "segment")]
    assert len({round(i.since_s) for i in reported}) >= 4 and all(i.until_s is not None for i in reported)
    assert worst_error_m(flight, flown) < 3.0 * flown.truth.gsd_m_per_px


def test_a_lost_link_becomes_a_segment_that_is_recognised_without_gps(fly, flown: Flown) -> None:
    """Seven seconds are missing; there is no GPS: the ground of an earlier strip tells where the new piece lies."""
    first, rate = 24, 8.0
    lost = range(first, first + 56)

    def events() -> Iterator[StreamEvent]:
        for k in range(len(flown.refs)):
            if k == lost.start:
                yield gap_of(GapKind.LINK_LOST, (k - 1) / rate)
            if k in lost:
                continue
            if k == lost.stop:
                yield gap_of(GapKind.RECONNECTED, (lost.start - 1) / rate, len(lost) / rate)
            yield frame_of(flown, k, fix=None, attitude=None, height_m=None)

    flight = fly(events())
    tally, tracker = flight.session.loop.tally, flight.session.loop.tracker
    assert tally.segments_begun >= 1
    assert tracker.pieces == 1
    kinds = [i.kind for i in tally.intervals]
    assert "link_lost" in kinds and "segment" in kinds
    link = next(i for i in tally.intervals if i.kind == "link_lost")
    assert link.until_s is not None and link.until_s - link.since_s == 7.0
    assert worst_error_m(flight, flown) < 6.0 * flown.truth.gsd_m_per_px


def test_gps_that_is_lost_leaves_one_map(fly, flown: Flown) -> None:
    lost = range(40, 110)
    flight = fly(
        frame_of(flown, k, fix=None, attitude=None, height_m=None) if k in lost else frame_of(flown, k)
        for k in range(len(flown.refs))
    )
    tally, tracker = flight.session.loop.tally, flight.session.loop.tracker
    assert tracker.pieces == 1 and tracker.chart.map_frame.crs_wkt is not None
    gone = [i for i in tally.intervals if i.kind == "no_position"]
    assert [i.frames for i in gone] == [len(lost)]
    assert worst_error_m(flight, flown) < 4.0 * flown.truth.gsd_m_per_px
