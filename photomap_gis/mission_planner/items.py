"""A sortie of a plan as what an autopilot flies: mission items, fence and rally points.

A command without a place takes effect where the waypoint before it is reached, on ArduPilot as on PX4, which is what
``trigger`` and ``speed_m_s`` of a ``Waypoint`` mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from photomap_gis.core.errors import UsageError
from photomap_gis.core.mission import Autopilot, Home, Mission, MissionItem, RallyPoint
from photomap_gis.core.plan import AltitudeFrame, CameraTrigger, Sortie, SurveyPlan, Waypoint, WaypointRole
from photomap_gis.mission_planner import commands
from photomap_gis.mission_planner.commands import Cmd, Frame
from photomap_gis.mission_planner.fence import fence_around

FENCE_MARGIN_M = 50.0
"""Room between the flight and its fence: turns, gusts and the fix's error must not breach it."""

MOST_ITEMS = 650
"""What a common flight controller stores of a mission, measured on ArduPilot Copter 4.7; small ones store fewer."""

_SETTLE_S = 1.0  # a vehicle that does not hold flies through its waypoint and photographs in motion
_MOUNT_MODE_TARGETING = 2.0  # MAV_MOUNT_MODE_MAVLINK_TARGETING


def to_mission(
    plan: SurveyPlan,
    sortie_index: int,
    autopilot: Autopilot,
    *,
    rally: Sequence[RallyPoint] = (),
    fence_margin_m: float = FENCE_MARGIN_M,
) -> Mission:
    """Return the mission of one sortie for an autopilot.

    The fence is one polygon about the area and the whole flight, ``fence_margin_m`` wide, and every zone to avoid.
    Raises ``UsageError`` where the autopilot cannot fly the plan's altitude frame, ``ValueError`` for an index or a
    margin that makes no sense.
    """
    if not 0 <= sortie_index < len(plan.sorties):
        raise ValueError(f"sortie_index must be below {len(plan.sorties)}, got {sortie_index}")
    if autopilot is Autopilot.PX4 and plan.frame is AltitudeFrame.TERRAIN:
        raise UsageError(
            "PX4 takes no altitudes above terrain in a mission: plan with --altitude-frame amsl or relative, "
            "and --dem to follow the ground"
        )
    sortie = plan.sorties[sortie_index]
    inclusion, exclusions = fence_around(plan, sortie, margin_m=fence_margin_m)
    return Mission(
        items=tuple(_items(sortie, plan.frame, autopilot)),
        fence_polygons=(inclusion, *exclusions),
        rally=tuple(rally),
        home=_home(plan, sortie),
        autopilot=autopilot,
        cruise_speed_m_s=_fastest(sortie),
    )


def storage_warnings(plan: SurveyPlan, autopilot: Autopilot) -> list[str]:
    """Say which sorties are longer than what a common flight controller stores."""
    counts = [sum(1 for _ in _items(sortie, plan.frame, autopilot)) for sortie in plan.sorties]
    return [
        f"sortie {number} has {count} mission items, and common autopilots store {MOST_ITEMS}: split it by "
        "--endurance-min, or trigger by distance instead of hovering"
        for number, count in enumerate(counts, 1)
        if count > MOST_ITEMS
    ]


def _items(sortie: Sortie, frame: AltitudeFrame, autopilot: Autopilot) -> Iterator[MissionItem]:
    trigger: CameraTrigger | None = None
    speed: float | None = None
    pitch: float | None = None
    landed = False
    for waypoint in sortie.waypoints:
        yield _navigate(waypoint, frame, autopilot)
        landed = waypoint.role is WaypointRole.LAND
        if waypoint.trigger != trigger:
            yield from _switch(trigger, waypoint.trigger)
            trigger = waypoint.trigger
        if trigger is not None and trigger.hover:
            yield commands.shoot() if autopilot is Autopilot.ARDUPILOT else commands.capture_one()
        if waypoint.speed_m_s is not None and waypoint.speed_m_s != speed:
            speed = waypoint.speed_m_s
            yield commands.change_speed(speed)
        if waypoint.gimbal_pitch_deg is not None and waypoint.gimbal_pitch_deg != pitch:
            pitch = waypoint.gimbal_pitch_deg
            # ArduPilot does not store the mode, so that a read-back would differ in it.
            yield commands.gimbal_pitch(pitch, 0.0 if autopilot is Autopilot.ARDUPILOT else _MOUNT_MODE_TARGETING)
        # Last: ArduPilot starts no other command until the nose has turned. It forgets the heading at the next place.
        if waypoint.heading_deg is not None and autopilot is Autopilot.ARDUPILOT and not landed:
            yield commands.face(waypoint.heading_deg)
    yield from _switch(trigger, None)
    if not landed:
        yield commands.return_to_launch()


def _navigate(waypoint: Waypoint, frame: AltitudeFrame, autopilot: Autopilot) -> MissionItem:
    # ArduPilot has no use for a waypoint's heading and reads NaN back as 0; PX4 takes 0 as "face north".
    free = 0.0 if autopilot is Autopilot.ARDUPILOT else math.nan
    heading = free
    if autopilot is Autopilot.PX4 and waypoint.heading_deg is not None:
        heading = waypoint.heading_deg % 360.0
    place = (waypoint.lat_deg, waypoint.lon_deg)
    if waypoint.role is WaypointRole.TAKEOFF:
        # Above the ground at the take-off place is above home, and needs no terrain data to leave the ground.
        over = AltitudeFrame.RELATIVE if frame is AltitudeFrame.TERRAIN else frame
        return MissionItem(Cmd.NAV_TAKEOFF, _MAV_FRAME[over], (0.0, 0.0, 0.0, heading), *place, waypoint.alt_m)
    if waypoint.role is WaypointRole.LAND:
        return MissionItem(Cmd.NAV_LAND, Frame.GLOBAL_RELATIVE_ALT, (0.0, 0.0, 0.0, heading), *place, 0.0)
    return MissionItem(
        Cmd.NAV_WAYPOINT, _MAV_FRAME[frame], (_hold_s(waypoint, autopilot), 0.0, 0.0, heading), *place, waypoint.alt_m
    )


_MAV_FRAME = {
    AltitudeFrame.RELATIVE: Frame.GLOBAL_RELATIVE_ALT,
    AltitudeFrame.AMSL: Frame.GLOBAL,
    AltitudeFrame.TERRAIN: Frame.GLOBAL_TERRAIN_ALT,
}


def _hold_s(waypoint: Waypoint, autopilot: Autopilot) -> float:
    hold = waypoint.hold_s
    if waypoint.trigger is not None and waypoint.trigger.hover:
        hold = max(hold, _SETTLE_S)
    # ArduPilot keeps whole seconds.
    return float(math.ceil(hold)) if autopilot is Autopilot.ARDUPILOT else float(hold)


def _switch(before: CameraTrigger | None, after: CameraTrigger | None) -> Iterator[MissionItem]:
    """What turns the one way of taking pictures off and the other on."""
    if before is not None and before.distance_m is not None and (after is None or after.distance_m is None):
        yield commands.trigger_off()
    if before is not None and before.interval_s is not None and (after is None or after.interval_s is None):
        yield commands.capture_off()
    if after is None or after.hover:
        return
    if after.distance_m is not None and (before is None or before.distance_m != after.distance_m):
        yield commands.trigger_every(after.distance_m)
    if after.interval_s is not None and (before is None or before.interval_s != after.interval_s):
        yield commands.capture_every(after.interval_s)


def _home(plan: SurveyPlan, sortie: Sortie) -> Home | None:
    if plan.home is not None:
        return Home(plan.home[0], plan.home[1], plan.home_alt_amsl_m)
    for waypoint in sortie.waypoints:
        if waypoint.role is WaypointRole.TAKEOFF:
            return Home(waypoint.lat_deg, waypoint.lon_deg, plan.home_alt_amsl_m)
    return None


def _fastest(sortie: Sortie) -> float | None:
    return max((w.speed_m_s for w in sortie.waypoints if w.speed_m_s is not None), default=None)
