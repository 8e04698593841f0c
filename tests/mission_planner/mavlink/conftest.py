"""A ground station and a simulated vehicle under one simulated clock."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from photomap_gis.core.mission import (
    Autopilot,
    FencePolygon,
    Home,
    Mission,
    MissionItem,
    RallyPoint,
)
from photomap_gis.mission_planner.mavlink.compare import compare
from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, upload_mission
from photomap_gis.mission_planner.mavlink.report import Report
from photomap_gis.mission_planner.mavlink.talk import Address, Patience, Talk, converse
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, lists_of
from photomap_gis.simulate.vehicle import PX4, Airframe, ArduPilot, Misbehaviour, VirtualLink, Weather

VEHICLES = {Autopilot.ARDUPILOT: ArduPilot, Autopilot.PX4: PX4}


def survey(count: int, *, shift_deg: float = 0.0, home: Home | None = None) -> Mission:
    """A take-off and waypoints inside a fence, with a rally point; ``shift_deg`` makes another one of it."""
    waypoints = [
        MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 51.5 + shift_deg + n * 1e-5, 7.4, 50.123)
        for n in range(count - 1)
    ]
    takeoff = MissionItem(22, 3, (0.0, 0.0, 0.0, math.nan), 51.5, 7.4, 40.0)
    fence = FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.52, 7.41 + shift_deg), (51.52, 7.39)))
    return Mission(
        items=(takeoff, *waypoints),
        fence_polygons=(fence,),
        rally=(RallyPoint(51.5 + shift_deg, 7.4, 30.0),),
        home=home,
    )


@dataclass
class Run:
    """How an upload ended and what the vehicle truly holds."""

    report: Report
    vehicle: Airframe
    link: VirtualLink
    holds_new: bool
    holds_old: bool
    saved: list = field(default_factory=list)

    @property
    def claims_falsely(self) -> bool:
        """Whether the report claims what is not so."""
        r = self.report
        return (
            (r.outcome == "verified" and not self.holds_new)
            or (r.outcome == "restored" and not self.holds_old)
            or (r.holds == "new" and not self.holds_new)
            or (r.holds == "previous" and not self.holds_old)
        )


def holds(vehicle: Airframe, mission: Mission, autopilot: Autopilot) -> bool:
    """Whether a vehicle's true storage is a mission, as closely as the autopilot can keep it."""
    for kind in Kind:
        items = lists_of(mission, autopilot).get(kind, ())
        kept = tuple(WireItem(i.command, i.frame, i.params, i.x, i.y, i.z) for i in vehicle.lists[kind])
        if not compare(kind, items, kept, autopilot).is_same:
            return False
    return True


Upload = Callable[..., Run]


@pytest.fixture(params=list(Autopilot))
def autopilot(request: pytest.FixtureRequest) -> Autopilot:
    return request.param


@pytest.fixture(scope="session")
def make_survey() -> Callable[..., Mission]:
    return survey


@pytest.fixture(scope="session")
def upload() -> Upload:
    """Upload a mission to a vehicle that holds another one, with faults."""

    def run(
        autopilot: Autopilot,
        *,
        count: int = 60,
        old_count: int = 20,
        weather: Weather | None = None,
        seed: int = 0,
        faults: Misbehaviour | None = None,
        timeout_s: float = 60.0,
        at: Callable[[float, VirtualLink, Talk], None] | None = None,
        options: UploadOptions | None = None,
        mission: Mission | None = None,
        prepare: Callable[[Airframe], None] | None = None,
    ) -> Run:
        vehicle = VEHICLES[autopilot](home=(51.5, 7.4, 100.0))
        old, new = survey(old_count, shift_deg=0.001), mission or survey(count)
        saved: list = []
        if old_count:
            talk = Talk(Address(254, 190), Patience())
            first = converse(
                talk,
                upload_mission(talk, old, UploadOptions(), save=lambda s, lists: "", say=lambda words: None),
                VirtualLink(vehicle),
            )
            assert first.outcome == "verified", first
        else:
            old = replace(old, items=(), fence_polygons=(), rally=())
        assert holds(vehicle, old, autopilot)
        fresh = VEHICLES[autopilot](home=vehicle.home, lists=vehicle.lists, faults=faults or Misbehaviour())
        if prepare:
            prepare(fresh)
        talk = Talk(Address(254, 190), Patience(timeout_s=timeout_s))
        link = VirtualLink(
            fresh, weather or Weather(), seed=seed, at=(lambda now, link: at(now, link, talk)) if at else None
        )
        report = converse(
            talk,
            upload_mission(
                talk,
                new,
                options or UploadOptions(),
                save=lambda state, lists: saved.append(lists) or "saved.json",
                say=lambda words: None,
            ),
            link,
        )
        return Run(report, fresh, link, holds(fresh, new, autopilot), holds(fresh, old, autopilot), saved)

    return run
