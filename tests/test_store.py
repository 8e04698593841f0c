"""The mission folder: what goes in comes out, and a killed run leaves nothing broken."""

import math

import numpy as np
import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.core.control import ControlPoint, Nudge, Sighting
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import Attitude, Flight, Footage, FrameRef, FrameStatus, GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.store import (
    ControlRecord,
    Mission,
    MissionHeader,
    PlacementRecord,
    PreparedFrame,
    RegistrationRecord,
    SolutionRecord,
)

HEADER = MissionHeader(("photos",), {"crs": None}, MapFrame("WKT", 5e5, 4e6), "2026-11-22T00:00:00Z", "photomap 0")
FULL = FrameRef(
    1, "b.jpg", "/x/b.jpg", 800, 600, 1, 7, 0.5, 1e9, GpsFix(45.0, -120.0, 300.0, 1.5),
    Attitude(0.1, -math.pi / 2), 80.0, Camera(800, 600, 700.0, k1=-0.01), None,
)  # fmt: skip
FOOTAGE = Footage((FrameRef(0, "a.jpg", "/x/a.jpg", 800, 600), FULL), (Flight(0, "x", "cam"), Flight(1, "y", "cam")))
RECORD = RegistrationRecord.of(
    Registration(
        Similarity2D(1, 2, 0.3, 0.1), np.eye(4), 0.9, (512, 384), 0.4, True, a=0, b=1, alternatives=(Similarity2D(),)
    ),
    EdgeKind.SEQUENTIAL,
)


def test_round_trip(tmp_path):
    solution = SolutionRecord(
        3,
        (
            PlacementRecord(0, FrameStatus.UNPLACED, "no GPS"),
            PlacementRecord(1, FrameStatus.REGISTERED, "", 0, "ifmi", Similarity2D(1, 2), tuple(range(16))),
        ),
        {"crs": None, "gsd_m_per_px": 0.04},
    )
    with Mission.create(tmp_path / "m", HEADER, FOOTAGE) as mission:
        mission.prepared.append(PreparedFrame(0, True, None, Similarity2D(3, 4, 0, 1)))
        mission.registrations.append(RECORD)
        mission.save_solution(solution)
    again = Mission.open(tmp_path / "m")
    assert again.header == HEADER
    assert tuple(again.frames) == FOOTAGE.frames
    assert tuple(again.flights) == FOOTAGE.flights
    assert list(again.prepared) == [PreparedFrame(0, True, None, Similarity2D(3, 4, 0, 1))]
    assert list(again.registrations) == [RECORD]
    assert again.load_solution() == solution
    back = RECORD.registration
    assert back.T_a_b == Similarity2D(1, 2, 0.3, 0.1)
    np.testing.assert_array_equal(back.covariance, np.eye(4))


@pytest.mark.parametrize("cut", [1, 10, 50])
def test_a_cut_last_line_is_dropped_and_the_journal_goes_on(tmp_path, cut):
    with Mission.create(tmp_path, HEADER, FOOTAGE) as mission:
        mission.registrations.extend([RECORD, RECORD])
    path = tmp_path / "registrations.jsonl"
    path.write_bytes(path.read_bytes()[:-cut])
    with Mission.open(tmp_path) as mission:
        assert len(list(mission.registrations)) == 1
        mission.registrations.append(RECORD)
        assert len(list(mission.registrations)) == 2


def test_damage_in_the_middle_is_told(tmp_path):
    with Mission.create(tmp_path, HEADER, FOOTAGE) as mission:
        mission.registrations.extend([RECORD, RECORD])
    path = tmp_path / "registrations.jsonl"
    path.write_bytes(b"{nonsense}\n" + path.read_bytes())
    with pytest.raises(DataError, match="line 1"):
        list(Mission.open(tmp_path).registrations)


def test_no_mission_and_one_too_many(tmp_path):
    with pytest.raises(DataError, match="no mission folder"):
        Mission.open(tmp_path)
    with Mission.create(tmp_path, HEADER, FOOTAGE):
        pass
    with pytest.raises(UsageError, match="--add"):
        Mission.create(tmp_path, HEADER, FOOTAGE)
    with pytest.raises(DataError, match="no solution"):
        Mission.open(tmp_path).load_solution()


def test_another_layout_is_refused(tmp_path):
    with Mission.create(tmp_path, HEADER, FOOTAGE):
        pass
    path = tmp_path / "mission.json"
    path.write_text(path.read_text().replace('"schema": 1', '"schema": 99'))
    with pytest.raises(DataError, match="layout 99"):
        Mission.open(tmp_path)


def test_ground_control_comes_back_and_damage_is_told(tmp_path):
    sightings = (Sighting("100/A.JPG", (3.5, 4.0), 0.5), Sighting("#12", (1.0, 2.0)))
    point = ControlPoint("P1", "EPSG:25832", 5e5, 5.7e6, None, 0.02, sightings)
    control = ControlRecord((point,), "gcp_list.txt", ("every-third",), (point,), (Nudge(1.0, -2.0, 3.0, 51.0, 7.0),))
    with Mission.create(tmp_path, HEADER, FOOTAGE) as mission:
        assert mission.load_control() == ControlRecord()
        mission.save_control(control, "EPSG:25832\n...")
    assert Mission.open(tmp_path).load_control() == control
    assert (tmp_path / "control-points.txt").read_text() == "EPSG:25832\n..."
    (tmp_path / "control.json").write_text("{")
    with pytest.raises(DataError, match=r"control\.json is damaged"):
        Mission.open(tmp_path).load_control()
