"""The graph in a process of its own: told in order, it solves; ended in a hurry, it keeps what it was told."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import TypeAdapter

from photomap_gis.core.frame import Flight as FlightOf
from photomap_gis.core.frame import Footage
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.live.graph import KeyNews
from photomap_gis.live.graph_desk import GraphProcess
from photomap_gis.live.steps import Tie
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import Mission, MissionHeader
from tests.live.conftest import Flown


@pytest.mark.slow
def test_a_process_works_the_graph_off(flown: Flown, tmp_path: Path) -> None:
    settings = MapSettings()
    header = MissionHeader(
        ("made",), TypeAdapter(MapSettings).dump_python(settings, mode="json"), MapFrame(None), "2026", "test"
    )
    with Mission.create(tmp_path / "m", header, Footage((), (FlightOf(0, "made", ""),))):
        pass
    desk = GraphProcess(tmp_path / "m", settings, 4)
    for k in range(9):
        n = 5 * k
        grey = np.asarray(cv2.cvtColor(flown.images[n], cv2.COLOR_BGR2GRAY), np.uint8)
        ref = flown.refs[n].__class__(
            **{f: getattr(flown.refs[n], f) for f in flown.refs[n].__slots__ if f != "index"}, index=k
        )
        tie = None if k == 0 else Tie(k - 1, k, Similarity2D())
        desk.tell(KeyNews(ref, grey, Similarity2D(float(40 * k)), tie))
    desk.close()
    with Mission.open(tmp_path / "m") as mission:
        assert [p.frame for p in mission.prepared] == list(range(9))
        accepted = {(r.a, r.b) for r in mission.registrations if r.accepted}
        assert {(k, k + 1) for k in range(8)} <= accepted
        kept = mission.load_solution()
        assert sum(p.T_map_plane is not None for p in kept.placements) == 9
        assert mission.header.map_frame.crs_wkt is not None
