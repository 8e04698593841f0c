"""A sortie for DJI's pilot programs: ``wpmz/template.kml`` and ``wpmz/waylines.wpml`` in a kmz [DJI: WPML 1.0.2].

The aircraft takes off and flies home by itself: take-off becomes the safe height on the way to the first waypoint,
the return becomes the finishing action.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree as ET

from photomap_gis.core.errors import UsageError
from photomap_gis.core.plan import SurveyPlan, Waypoint, WaypointRole
from photomap_gis.mission_planner.files.kml import zipped
from photomap_gis.mission_planner.heights import above_home_m

_KML = "http://www.opengis.net/kml/2.2"
_WPML = "http://www.dji.com/wpmz/1.0.2"
_DRONE, _PAYLOAD = (77, 0), (66, 0)  # Mavic 3E and its camera; DJI Pilot 2 asks where another one is flown
_DEFAULT_SPEED_M_S = 8.0
_FASTEST_M_S = 15.0
_SAFE_HEIGHTS_M = (1.2, 1500.0)
_MOST_WAYPOINTS = 65535


def plan_wpml_kmz(plan: SurveyPlan, sortie_index: int) -> bytes:
    """Return the archive.

    Raises ``UsageError`` where heights above the take-off place cannot be known, since DJI's other frames are the
    ellipsoid and its own terrain, neither of which a plan knows.
    """
    sortie = plan.sorties[sortie_index]
    flown = _flown(plan, sortie.waypoints)
    heights = [above_home_m(plan, w) for w in flown]
    if not flown or any(h is None for h in heights):
        raise UsageError(
            "a DJI file needs heights above the take-off place: plan with --altitude-frame relative (and --dem to "
            "follow the ground)"
        )
    known = [float(h) for h in heights if h is not None]
    takeoff = next((above_home_m(plan, w) for w in sortie.waypoints if w.role is WaypointRole.TAKEOFF), None)
    safe = min(max(takeoff or known[0], _SAFE_HEIGHTS_M[0]), _SAFE_HEIGHTS_M[1])
    lands = sortie.waypoints[-1].role is WaypointRole.LAND
    speed = min(next((w.speed_m_s for w in flown if w.speed_m_s), _DEFAULT_SPEED_M_S), _FASTEST_M_S)
    config = _Config(safe, speed, lands)
    return zipped(
        {
            "wpmz/template.kml": _template(flown, known, config),
            "wpmz/waylines.wpml": _waylines(flown, known, config, sortie.length_m, sortie.duration_s),
        }
    )


@dataclass(frozen=True, slots=True)
class _Config:
    safe_height_m: float
    speed_m_s: float
    lands: bool


def _flown(plan: SurveyPlan, waypoints: Sequence[Waypoint]) -> list[Waypoint]:
    """The waypoints that the aircraft does not fly by itself, each with its speed on the way on."""
    found = []
    speed = None
    for waypoint in waypoints:
        speed = speed if waypoint.speed_m_s is None else waypoint.speed_m_s
        if waypoint.role not in (WaypointRole.TAKEOFF, WaypointRole.LAND):
            found.append(replace(waypoint, speed_m_s=speed))
    if len(found) > 1 and found[-1].role is WaypointRole.RETURN and plan.home is not None:
        last = found[-1]
        if abs(last.lat_deg - plan.home[0]) < 1e-5 and abs(last.lon_deg - plan.home[1]) < 1e-5:
            found.pop()
    if len(found) > _MOST_WAYPOINTS:
        raise UsageError(f"a DJI file holds at most {_MOST_WAYPOINTS} waypoints: plan with --endurance-min")
    return found


def _waylines(flown: Sequence[Waypoint], heights: Sequence[float], config: _Config, length: float, time: float) -> str:
    """What the aircraft executes."""
    root, document = _document()
    _mission_config(document, config)
    folder = ET.SubElement(document, "Folder")
    _put(folder, templateId=0, executeHeightMode="relativeToStartPoint", waylineId=0)
    _put(folder, distance=f"{length:.1f}", duration=f"{time:.1f}", autoFlightSpeed=f"{config.speed_m_s:g}")
    for i, (waypoint, height) in enumerate(zip(flown, heights, strict=True)):
        placemark = _placemark(folder, i, waypoint)
        _put(placemark, executeHeight=f"{height:.3f}", waypointSpeed=f"{_speed(waypoint, config):g}")
        _heading(placemark, "waypointHeadingParam", waypoint)
        turn = _w(placemark, "waypointTurnParam")
        _put(turn, waypointTurnMode="toPointAndStopWithDiscontinuityCurvature", waypointTurnDampingDist=0)
        _put(placemark, useStraightLine=1)
        _action_groups(placemark, flown, i)
    return _xml(root)


def _template(flown: Sequence[Waypoint], heights: Sequence[float], config: _Config) -> str:
    """What the pilot's program shows and edits."""
    root, document = _document()
    _put(document, author="photomap")
    _mission_config(document, config)
    folder = ET.SubElement(document, "Folder")
    _put(folder, templateType="waypoint", templateId=0)
    system = _w(folder, "waylineCoordinateSysParam")
    _put(system, coordinateMode="WGS84", heightMode="relativeToStartPoint", positioningType="GPS")
    _put(folder, autoFlightSpeed=f"{config.speed_m_s:g}", globalHeight=f"{heights[0]:.3f}", caliFlightEnable=0)
    _put(folder, gimbalPitchMode="manual")
    _heading(folder, "globalWaypointHeadingParam", None)
    _put(folder, globalWaypointTurnMode="toPointAndStopWithDiscontinuityCurvature", globalUseStraightLine=1)
    for i, (waypoint, height) in enumerate(zip(flown, heights, strict=True)):
        placemark = _placemark(folder, i, waypoint)
        _put(placemark, ellipsoidHeight=f"{height:.3f}", height=f"{height:.3f}", useGlobalHeight=0)
        _put(placemark, useGlobalSpeed=0, waypointSpeed=f"{_speed(waypoint, config):g}", useGlobalHeadingParam=0)
        _heading(placemark, "waypointHeadingParam", waypoint)
        _put(placemark, useGlobalTurnParam=1, useStraightLine=1)
        _action_groups(placemark, flown, i)
    return _xml(root)


def _speed(waypoint: Waypoint, config: _Config) -> float:
    return config.speed_m_s if waypoint.speed_m_s is None else min(waypoint.speed_m_s, _FASTEST_M_S)


def _mission_config(document: ET.Element, config: _Config) -> None:
    mission = _w(document, "missionConfig")
    _put(mission, flyToWaylineMode="safely", finishAction="autoLand" if config.lands else "goHome")
    _put(mission, exitOnRCLost="executeLostAction", executeRCLostAction="goBack")
    _put(mission, takeOffSecurityHeight=f"{config.safe_height_m:.1f}", globalTransitionalSpeed=f"{config.speed_m_s:g}")
    drone = _w(mission, "droneInfo")
    _put(drone, droneEnumValue=_DRONE[0], droneSubEnumValue=_DRONE[1])
    payload = _w(mission, "payloadInfo")
    _put(payload, payloadEnumValue=_PAYLOAD[0], payloadSubEnumValue=_PAYLOAD[1], payloadPositionIndex=0)


def _placemark(folder: ET.Element, index: int, waypoint: Waypoint) -> ET.Element:
    placemark = ET.SubElement(folder, "Placemark")
    point = ET.SubElement(placemark, "Point")
    ET.SubElement(point, "coordinates").text = f"{waypoint.lon_deg:.9f},{waypoint.lat_deg:.9f}"
    _put(placemark, index=index)
    return placemark


def _heading(parent: ET.Element, tag: str, waypoint: Waypoint | None) -> None:
    heading = _w(parent, tag)
    if waypoint is None or waypoint.heading_deg is None:
        _put(heading, waypointHeadingMode="followWayline", waypointHeadingAngle=0, waypointHeadingAngleEnable=0)
    else:
        angle = (waypoint.heading_deg + 180.0) % 360.0 - 180.0  # WPML counts from -180 to 180
        mode = {"waypointHeadingMode": "smoothTransition", "waypointHeadingAngleEnable": 1}
        _put(heading, waypointHeadingAngle=f"{angle:.1f}", **mode)
    _put(heading, waypointPoiPoint="0.000000,0.000000,0.000000", waypointHeadingPathMode="followBadArc")


def _action_groups(placemark: ET.Element, flown: Sequence[Waypoint], index: int) -> None:
    """The gimbal, the hovering shot, and a lane's pictures from its first to its last waypoint."""
    here = flown[index]
    before = flown[index - 1] if index else None
    actions = list(_actions_at(here, before, flown, index))
    group = 2 * index
    if actions:
        _group(placemark, group, index, index, "reachPoint", None, actions)
    trigger = here.trigger
    if trigger is None or trigger.hover or (before is not None and before.trigger == trigger):
        return
    last = index
    while last + 1 < len(flown) and flown[last].trigger == trigger:
        last += 1
    if trigger.distance_m is not None:
        _group(placemark, group + 1, index, last, "multipleDistance", trigger.distance_m, [_photo()])
    elif trigger.interval_s is not None:
        _group(placemark, group + 1, index, last, "multipleTiming", trigger.interval_s, [_photo()])


def _actions_at(
    here: Waypoint, before: Waypoint | None, flown: Sequence[Waypoint], index: int
) -> Iterator[tuple[str, dict[str, object]]]:
    pitches = [w.gimbal_pitch_deg for w in flown[:index] if w.gimbal_pitch_deg is not None]
    pitch = here.gimbal_pitch_deg if here.gimbal_pitch_deg is not None else (-90.0 if before is None else None)
    if pitch is not None and (not pitches or pitches[-1] != pitch):
        yield (
            "gimbalRotate",
            {
                "gimbalHeadingYawBase": "aircraft",
                "gimbalRotateMode": "absoluteAngle",
                "gimbalPitchRotateEnable": 1,
                "gimbalPitchRotateAngle": f"{pitch:g}",
                "gimbalRollRotateEnable": 0,
                "gimbalRollRotateAngle": 0,
                "gimbalYawRotateEnable": 0,
                "gimbalYawRotateAngle": 0,
                "gimbalRotateTimeEnable": 0,
                "gimbalRotateTime": 0,
                "payloadPositionIndex": 0,
            },
        )
    if here.hold_s > 0:
        yield "hover", {"hoverTime": f"{here.hold_s:g}"}
    if here.trigger is not None and here.trigger.hover:
        yield _photo()


def _photo() -> tuple[str, dict[str, object]]:
    return "takePhoto", {"fileSuffix": "photomap", "payloadPositionIndex": 0, "useGlobalPayloadLensIndex": 1}


def _group(
    placemark: ET.Element,
    group_id: int,
    first: int,
    last: int,
    trigger: str,
    trigger_param: float | None,
    actions: Sequence[tuple[str, dict[str, object]]],
) -> None:
    group = _w(placemark, "actionGroup")
    _put(
        group, actionGroupId=group_id, actionGroupStartIndex=first, actionGroupEndIndex=last, actionGroupMode="sequence"
    )
    when = _w(group, "actionTrigger")
    _put(when, actionTriggerType=trigger)
    if trigger_param is not None:
        _put(when, actionTriggerParam=f"{trigger_param:g}")
    for i, (function, parameters) in enumerate(actions):
        action = _w(group, "action")
        _put(action, actionId=i, actionActuatorFunc=function)
        _put(_w(action, "actionActuatorFuncParam"), **parameters)


def _document() -> tuple[ET.Element, ET.Element]:
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:wpml": _WPML})
    return root, ET.SubElement(root, "Document")


def _w(parent: ET.Element, tag: str) -> ET.Element:
    return ET.SubElement(parent, f"wpml:{tag}")


def _put(parent: ET.Element, **values: object) -> None:
    for tag, value in values.items():
        _w(parent, tag).text = str(value)


def _xml(root: ET.Element) -> str:
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
