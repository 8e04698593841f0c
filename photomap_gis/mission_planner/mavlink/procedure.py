"""What ``photomap upload``, ``download`` and ``clear`` do with a vehicle, from the first heartbeat to the last word.

All of it is steps (``talk``): no socket, no clock, no file. Nothing here arms, changes a mode or starts a mission.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace

from photomap_gis.core.errors import LinkError
from photomap_gis.core.mission import Autopilot, Home, Mission, MissionItem
from photomap_gis.mission_planner.mavlink import dialect as cmd
from photomap_gis.mission_planner.mavlink.ask import Wanted, ask_params, ask_state, find_vehicle, set_current
from photomap_gis.mission_planner.mavlink.compare import compare
from photomap_gis.mission_planner.mavlink.replace import ORDER, Replaced, replace_lists
from photomap_gis.mission_planner.mavlink.report import Holds, Outcome, Report
from photomap_gis.mission_planner.mavlink.rules import Limits, Situation, first_survey_item, judge, nearest_start
from photomap_gis.mission_planner.mavlink.state import VehicleState
from photomap_gis.mission_planner.mavlink.talk import MissionModeEntered, Steps, Stopped, Talk, Unreachable
from photomap_gis.mission_planner.mavlink.transfer import End, Transfer, download
from photomap_gis.mission_planner.mavlink.wire import (
    Kind,
    Lists,
    WireItem,
    first_seq,
    kinds_of,
    lists_of,
    mission_of,
    without_home,
)

_STATE_S, _PARAMS_S, _OPTIONAL_LIST_S, _CURRENT_S = 4.0, 3.0, 10.0, 15.0
_MOST_READINGS = 5
_PARAMS = ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_ALT_MAX", "FENCE_RADIUS", "MIS_RESTART")
_LONGEST_WAIT_FOR_MODE_S = 1800.0

Save = Callable[[VehicleState, Lists], str]
"""Keeps what a vehicle holds before anything is changed and returns where."""


@dataclass(frozen=True, slots=True)
class UploadOptions:
    """What the user asks of an upload. ``start_at`` is an item's number from 1, ``nearest``, or None: what is right."""

    wanted: Wanted = field(default_factory=Wanted)
    limits: Limits = field(default_factory=Limits)
    waits_for_mode: bool = False
    replaces_active: bool = False
    start_at: int | str | None = None


def upload_mission(
    talk: Talk, mission: Mission, options: UploadOptions, *, save: Save, say: Callable[[str], None]
) -> Steps[Report]:
    """Upload a mission with its fence and rally points, verify it, and put the old back where it did not verify."""
    begun_s = talk.now_s
    try:
        vehicle = yield from find_vehicle(talk, options.wanted, talk.patience.timeout_s)
    except Stopped as event:
        return _before_anything(talk, event, 0, begun_s)
    if vehicle is None:
        return _nobody(talk, begun_s)
    autopilot = _known(vehicle)
    saved: str | None = None

    def ended(replaced: Replaced, count: int, warnings: tuple[str, ...] = ()) -> Report:
        return _ended(talk, replaced, count, begun_s, warnings=warnings, saved=saved)

    count = len(mission.items)
    try:
        yield from ask_state(talk, _STATE_S)
        why_not = yield from _await_mode(talk, options, say)
        if why_not:
            return ended(_untouched(why_not), count)
        talk.forbids_mission_mode = not (options.replaces_active and autopilot is Autopilot.PX4)
        params = {} if autopilot is Autopilot.PX4 else (yield from ask_params(talk, _PARAMS, _PARAMS_S))
        previous, why_not, warnings = yield from _previous(talk, kinds_of(mission), reads_fence=bool(mission.items))
        if why_not:
            return ended(_untouched(why_not), count)
        situation = _situation(talk, mission, previous, params)
        verdict = judge(mission, situation, options.limits)
        warnings += verdict.warnings
        if mission.items and talk.vehicle.home is None and talk.vehicle.lat_deg is None:
            warnings += ("the vehicle does not know where it is: heights and distances are judged by the plan's home",)
        if mission.autopilot not in (None, autopilot):
            warnings += (f"the plan was made for {mission.autopilot}, the vehicle is {autopilot}",)
        if verdict.refusals:
            return ended(_untouched("; ".join(verdict.refusals)), count, warnings)
        start, why_not = _start(mission, options, talk.vehicle)
        if why_not:
            return ended(_untouched(why_not), count, warnings)
        new = lists_of(mission, autopilot, situation.home)
        saved = save(talk.vehicle, {kind: items for kind, items in previous.items() if kind in new})
    except Unreachable:
        silent = f"{talk.silence}; nothing was changed"
        return ended(Replaced(Outcome.UNKNOWN, Holds.UNKNOWN, silent), count)
    except MissionModeEntered:
        return ended(_untouched(f"the vehicle went to {talk.vehicle.mode} in the meantime"), count)
    except Stopped:
        return ended(_untouched("stopped by the user"), count)
    replaced = yield from replace_lists(talk, new, previous)
    report = ended(replaced, count, warnings)
    if replaced.outcome is Outcome.VERIFIED and start is not None:
        return (yield from _set_start(talk, report, start, mission.items, params))
    return report


def restore_lists(
    talk: Talk,
    lists: Lists,
    options: UploadOptions,
    *,
    save: Save,
    say: Callable[[str], None],
    autopilot: Autopilot | None = None,
) -> Steps[Report]:
    """Put lists of a saved file on a vehicle; rules on flying do not apply, those on AUTO do.

    ``autopilot`` is whose lists they are; another's are refused, since its item 0 is another thing.
    """
    begun_s = talk.now_s
    try:
        vehicle = yield from find_vehicle(talk, options.wanted, talk.patience.timeout_s)
    except Stopped as event:
        return _before_anything(talk, event, 0, begun_s)
    if vehicle is None:
        return _nobody(talk, begun_s)
    if autopilot not in (None, _known(vehicle)):
        why = f"the file is {autopilot}'s, the vehicle is {vehicle.autopilot}; nothing was sent"
        return Report(Outcome.REFUSED, Holds.PREVIOUS, why, 0, talk.now_s - begun_s, vehicle=talk.state)
    autopilot = _known(vehicle)
    count = len(without_home(lists.get(Kind.MISSION, ()), autopilot)[0])
    saved: str | None = None
    try:
        why_not = yield from _await_mode(talk, options, say)
        if why_not:
            return Report(Outcome.REFUSED, Holds.PREVIOUS, why_not, count, talk.now_s - begun_s, vehicle=talk.state)
        talk.forbids_mission_mode = not (options.replaces_active and autopilot is Autopilot.PX4)
        previous, why_not, warnings = yield from _previous(talk, lists, reads_fence=False)
        if why_not:
            return Report(Outcome.REFUSED, Holds.PREVIOUS, why_not, count, talk.now_s - begun_s, vehicle=talk.state)
        saved = save(talk.vehicle, previous)
    except (Unreachable, MissionModeEntered, Stopped) as event:
        return _before_anything(talk, event, count, begun_s)
    replaced = yield from replace_lists(talk, lists, previous, puts_back=False)
    return _ended(talk, replaced, count, begun_s, warnings=warnings, saved=saved)


def clear_lists(talk: Talk, kinds: tuple[Kind, ...], options: UploadOptions, *, save: Save, say: Callable[[str], None]
) -> Steps[Report]:  # fmt: skip
    """Clear lists of a vehicle and read back that they are empty."""
    report = yield from restore_lists(talk, dict.fromkeys(kinds, ()), options, save=save, say=say)
    if report.outcome is Outcome.VERIFIED:
        report = replace(report, message=f"{', '.join(k.name.lower() for k in kinds)} cleared, and read back as empty")
    return replace(report, items=0)


@dataclass(frozen=True, slots=True)
class Downloaded:
    """What a vehicle holds: the lists as they came, and the mission that they make."""

    vehicle: VehicleState
    lists: dict[Kind, tuple[WireItem, ...]]
    mission: Mission
    warnings: tuple[str, ...]


def download_lists(talk: Talk, kinds: tuple[Kind, ...], options: UploadOptions) -> Steps[Downloaded]:
    """Read lists of a vehicle. Raises ``LinkError`` where there is none, or it does not give them."""
    try:
        vehicle = yield from find_vehicle(talk, options.wanted, talk.patience.timeout_s)
    except Stopped as error:
        raise KeyboardInterrupt from error
    if vehicle is None:
        raise LinkError(_nobody(talk, talk.now_s).message)
    autopilot = _known(vehicle)
    lists: dict[Kind, tuple[WireItem, ...]] = {}
    warnings: list[str] = []
    try:
        yield from ask_state(talk, _STATE_S)
        for kind in kinds:
            read = yield from download(talk, kind, stage=kind.name.lower())
            if read.end is End.DONE:
                lists[kind] = read.items
            elif kind is Kind.MISSION or read.end is not End.REFUSED:
                raise LinkError(f"the {kind.name.lower()} cannot be read: {read.reason()}")
            else:
                warnings.append(f"the vehicle has no {kind.name.lower()} list ({read.reason()})")
    except Unreachable as error:
        raise LinkError(
            f"{talk.silence}: bring the antennas closer and try again, or give a longer --timeout"
        ) from error
    except Stopped as error:
        raise KeyboardInterrupt from error
    mission, left_out = mission_of(lists, autopilot)
    if mission.home is None and talk.vehicle.home is not None:
        mission = replace(mission, home=talk.vehicle.home)
    return Downloaded(talk.vehicle, lists, mission, (*warnings, *left_out))


def _ended(
    talk: Talk, replaced: Replaced, count: int, begun_s: float, *, warnings: tuple[str, ...], saved: str | None
) -> Report:
    differences = tuple(d for c in replaced.comparisons.values() for d in c.differences)
    notes = tuple(n for c in replaced.comparisons.values() for n in c.notes)
    return Report(
        outcome=replaced.outcome,
        holds=replaced.holds,
        message=replaced.message,
        items=count,
        seconds=talk.now_s - begun_s,
        differences=() if replaced.outcome is Outcome.VERIFIED else differences,
        warnings=(*warnings, *notes),
        saved_previous=saved,
        vehicle=talk.state,
    )


def _known(vehicle: VehicleState) -> Autopilot:
    if vehicle.autopilot is None:
        raise LinkError(f"vehicle {vehicle.system} is neither ArduPilot nor PX4: its missions are not known here")
    return vehicle.autopilot


def _nobody(talk: Talk, begun_s: float) -> Report:
    seconds = talk.patience.timeout_s
    return Report(
        Outcome.UNKNOWN,
        Holds.UNKNOWN,
        f"no vehicle was heard for {seconds:g} s; nothing was sent, so it holds what it held: check --connect, the "
        "radio and that no other program has the port",
        seconds=talk.now_s - begun_s,
    )


def _untouched(why: str) -> Replaced:
    return Replaced(Outcome.REFUSED, Holds.PREVIOUS, f"{why}; nothing was sent, the vehicle holds what it held")


def _before_anything(talk: Talk, event: Exception, count: int, begun_s: float) -> Report:
    outcome, holds = Outcome.REFUSED, Holds.PREVIOUS
    if isinstance(event, Unreachable):
        outcome, holds = Outcome.UNKNOWN, Holds.UNKNOWN
        why = talk.silence
    elif isinstance(event, MissionModeEntered):
        why = f"the vehicle went to {talk.vehicle.mode}"
    else:
        why = "stopped by the user"
    return Report(outcome, holds, f"{why}; nothing was changed", count, talk.now_s - begun_s, vehicle=talk.state)


def _await_mode(talk: Talk, options: UploadOptions, say: Callable[[str], None]) -> Steps[str]:
    """Return why the mission cannot be replaced in the vehicle's mode, nothing where it can."""
    if not talk.vehicle.flies_mission:
        return ""
    if talk.vehicle.autopilot is Autopilot.PX4:
        if options.replaces_active:
            say("the active mission is replaced: PX4 goes on with the new one at once")
            return ""
        other, hint = "Hold", " or give --replace-active: PX4 replaces the mission as a whole"
    else:
        other, hint = "LOITER, GUIDED or BRAKE", ""
    if not options.waits_for_mode:
        return (
            f"the vehicle is in {talk.vehicle.mode}, it flies the mission that would be replaced: switch it to {other} "
            f"(--wait-mode waits for that){hint}"
        )
    say(f"the vehicle is in {talk.vehicle.mode}: waiting until the pilot switches it to {other}")
    end_s = talk.now_s + _LONGEST_WAIT_FOR_MODE_S
    while talk.vehicle.flies_mission and talk.now_s < end_s:
        # Nothing is asked meanwhile; the heartbeats say whether it is there.
        if talk.now_s - talk.vehicle.heard_s > talk.patience.timeout_s:
            return f"the vehicle fell silent for {talk.patience.timeout_s:g} s while its mode was waited for"
        yield from talk.wait(talk.now_s + 1.0)
    talk.last_answer_s = talk.now_s
    return f"the vehicle stayed in {talk.vehicle.mode}" if talk.vehicle.flies_mission else ""


def _previous(
    talk: Talk, new: Container[Kind], *, reads_fence: bool
) -> Steps[tuple[dict[Kind, tuple[WireItem, ...]], str, tuple[str, ...]]]:
    """Return what the vehicle holds now, why that cannot be read, and warnings.

    The lists that will be replaced must be read; ``reads_fence`` besides, by which a mission is judged.
    """
    lists: dict[Kind, tuple[WireItem, ...]] = {}
    warnings: list[str] = []
    for kind in ORDER:
        if kind in new:
            read = yield from _read_surely(talk, kind)
            if read.end is not End.DONE:
                return {}, f"the vehicle's present {kind.name.lower()} cannot be read and saved: {read.reason()}", ()
        elif kind is Kind.FENCE and reads_fence:
            seconds = min(_OPTIONAL_LIST_S, talk.patience.timeout_s / 2)  # silence on this is no silence
            read = yield from download(talk, kind, stage="read fence", give_up_s=talk.now_s + seconds)
            talk.last_answer_s = talk.now_s
            if read.end is not End.DONE:
                warnings.append("the vehicle's fence cannot be read: the mission was not checked against it")
                continue
        else:
            continue
        lists[kind] = read.items
    return lists, "", tuple(warnings)


def _read_surely(talk: Talk, kind: Kind) -> Steps[Transfer]:
    """Read a list until two readings agree: what is saved may be all that there is to put back."""
    before: Transfer | None = None
    for _ in range(_MOST_READINGS):
        read = yield from download(talk, kind, stage=f"save {kind.name.lower()}")
        if read.end is not End.DONE or not read.items:
            return read
        # Not by ==, for which a NaN is never the same.
        if before is not None and compare(kind, before.items, read.items, _known(talk.vehicle)).is_same:
            return read
        before = read
    return Transfer(End.FAILED)


def _situation(talk: Talk, mission: Mission, previous: Lists, params: dict[str, float]) -> Situation:
    vehicle = talk.vehicle
    autopilot = _known(vehicle)
    here = None
    if vehicle.lat_deg is not None and vehicle.lon_deg is not None:
        here = (vehicle.lat_deg, vehicle.lon_deg)
    standing = None
    if here is not None and not vehicle.is_in_air:
        standing = Home(*here, vehicle.alt_amsl_m)
    fence_is_plans = bool(mission.fence_polygons or mission.fence_circles)
    if fence_is_plans:
        polygons, circles = mission.fence_polygons, mission.fence_circles
    else:
        kept = mission_of({Kind.FENCE: previous.get(Kind.FENCE, ())}, autopilot)[0]
        polygons, circles = kept.fence_polygons, kept.fence_circles
    return Situation(
        autopilot=autopilot,
        # Not ArduPilot's item 0: until there is a fix it is the home of another day.
        home=vehicle.home or standing or mission.home,
        needs_takeoff=vehicle.takes_off and not vehicle.is_in_air,
        place=here,
        is_in_air=vehicle.is_in_air,
        fence_polygons=polygons,
        fence_circles=circles,
        fence_is_plans=fence_is_plans,
        params=params,
    )


def _start(mission: Mission, options: UploadOptions, vehicle: VehicleState) -> tuple[int | None, str]:
    """Return the number (from 1) of the item to make current, None to leave it, and why the wish cannot be granted."""
    items = mission.items
    if options.start_at == "nearest":
        if vehicle.lat_deg is None or vehicle.lon_deg is None:
            return None, "--start-at nearest needs the vehicle's position, which it does not send"
        nearest = nearest_start(items, vehicle.lat_deg, vehicle.lon_deg)
        return nearest, "" if nearest else "--start-at nearest: the mission has no waypoint with a place"
    if isinstance(options.start_at, int):
        if 1 <= options.start_at <= len(items):
            return options.start_at, ""
        return None, f"--start-at {options.start_at}: the mission has items 1 to {len(items)}"
    return (first_survey_item(items) if vehicle.is_in_air else None), ""


def _set_start(
    talk: Talk, report: Report, start: int, items: Sequence[MissionItem], params: Mapping[str, float]
) -> Steps[Report]:
    warnings = list(report.warnings)
    if params.get("MIS_RESTART"):
        warnings.append("MIS_RESTART is 1: the vehicle begins at its first item again whenever it is switched to AUTO")
    talk.forbids_mission_mode = False
    done = False
    with contextlib.suppress(Unreachable, Stopped):
        seq = start - 1 + first_seq(_known(talk.vehicle))
        # Of a camera or speed command a vehicle tells the next item that it flies to.
        ahead = next((n for n, i in enumerate(items[start - 1 :]) if i.command in cmd.LEG_ENDS), 0)
        done = yield from set_current(talk, seq, seq + ahead, _CURRENT_S)
    if not done:
        warnings.append(f"item {start} could not be made the current one: check it before switching to AUTO")
        return replace(report, warnings=tuple(warnings), vehicle=talk.state)
    message = f"{report.message}; item {start} is the current one: switch to AUTO when ready"
    return replace(report, message=message, start_item=start, warnings=tuple(warnings), vehicle=talk.state)
