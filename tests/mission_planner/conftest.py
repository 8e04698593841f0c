"""Small plans that the tests of this room share."""

from collections.abc import Callable

import pytest

from photomap_gis.core.plan import (
    AltitudeFrame,
    CameraTrigger,
    GeoPolygon,
    Sortie,
    SurveyPlan,
    Waypoint,
    WaypointRole,
)

AREA = GeoPolygon(((((7.999, 47.001), (8.001, 47.001), (8.001, 47.003), (7.999, 47.003), (7.999, 47.001))),))
ZONE = GeoPolygon(((((8.002, 47.001), (8.003, 47.001), (8.003, 47.002), (8.002, 47.001))),))


def _two_lanes(
    frame: AltitudeFrame = AltitudeFrame.RELATIVE,
    trigger: CameraTrigger | None = None,
    *,
    heading_deg: float | None = None,
    land: bool = False,
) -> SurveyPlan:
    """Take-off, two lanes north and south with the camera off in the turn, and back."""
    on = trigger or CameraTrigger(distance_m=12.5)
    role = WaypointRole
    waypoints = [
        Waypoint(47.0, 8.0, 40.0, role.TAKEOFF, speed_m_s=10.0, gimbal_pitch_deg=-90.0),
        Waypoint(47.0009, 7.9995, 60.0, role.LEAD_IN, heading_deg=heading_deg),
        Waypoint(47.001, 7.9995, 60.0, role.SURVEY, on, 8.0, heading_deg=heading_deg),
        Waypoint(47.003, 7.9995, 60.0, role.SURVEY, on if on.hover else None, heading_deg=heading_deg),
        Waypoint(47.003, 8.0005, 60.0, role.SURVEY, on, heading_deg=heading_deg),
        Waypoint(47.001, 8.0005, 60.0, role.SURVEY, on if on.hover else None, heading_deg=heading_deg),
        Waypoint(47.0, 8.0, 60.0, role.RETURN, speed_m_s=10.0),
    ]
    if land:
        waypoints.append(Waypoint(47.0, 8.0, 0.0, role.LAND))
    sortie = Sortie(tuple(waypoints), photos=36, length_m=750.0, duration_s=110.0)
    return SurveyPlan(
        area=(AREA,),
        avoid=(ZONE,),
        frame=frame,
        sorties=(sortie,),
        covered_share=1.0,
        uncovered=(),
        gsd_m_per_px=0.02,
        pattern="survey",
        home=(47.0, 8.0),
        home_alt_amsl_m=412.0,
    )


@pytest.fixture(scope="session")
def two_lanes() -> Callable[..., SurveyPlan]:
    """A maker of plans: altitude frame, trigger, heading and ending are its arguments."""
    return _two_lanes
