"""A drawing hand that falls behind holds the loop up: frames are dropped and counted, pictures do not pile up."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from photomap_gis.core.frame import Flight as FlightOf
from photomap_gis.core.frame import Footage
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.live import StreamEvent
from photomap_gis.live import session
from photomap_gis.live.flight import Flight
from photomap_gis.live.locate import FromTelemetry
from photomap_gis.live.opening import Ready
from photomap_gis.live.options import LiveOptions
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import Mission, MissionHeader
from tests.live.conftest import Flown, MadeSource, frame_of


def test_commands_do_not_pile_up_behind_a_slow_hand(
    flown: Flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "MOST_BEHIND", 2)
    header = MissionHeader(
        (str(tmp_path / "recording"),), TypeAdapter(MapSettings).dump_python(MapSettings(), mode="json"),
        MapFrame(None), "2026-01-01T00:00:00Z", "test",
    )  # fmt: skip
    mission = Mission.create(tmp_path / "m", header, Footage((), (FlightOf(0, "made", "", kind="video"),)))
    every_frame_has_come = threading.Event()

    def events() -> Iterator[StreamEvent]:
        yield from (frame_of(flown, k) for k in range(len(flown.refs)))
        every_frame_has_come.set()

    ready = Ready(mission, FromTelemetry(), LiveOptions(settings=MapSettings()))
    with Flight(ready, MadeSource(events()), realtime=True) as flight:
        hand, waiting = flight.session.hand, []
        do = hand.do

        def slowly(command: object) -> None:
            assert every_frame_has_come.wait(60.0)
            waiting.append(flight.session._commands.qsize())
            do(command)

        monkeypatch.setattr(hand, "do", slowly)
        flight.fly()
        tally = flight.session.loop.tally
        assert tally.frames + tally.dropped == len(flown.refs)
        assert tally.dropped > 0
        assert max(waiting) <= 2
        assert flight.session._commands.empty()
        assert sum(1 for _ in mission.frames) == len(flight.session.loop.chart) > 0
