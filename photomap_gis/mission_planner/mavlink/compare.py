"""Whether a list that was read back is the list that was sent, by what each autopilot is known to keep.

Only losses that were measured on the autopilots are forgiven; whatever else differs is a difference and the upload did
not verify. What was forgiven but changes the flight (a yaw, a fraction of a hold) is told as a note.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink import dialect as cmd
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, as_float32, first_seq, to_degrees

_ALTITUDE_STEP_M = 0.01  # ArduPilot keeps centimetres, cut off
_RALLY_STEP_M = 1.0  # and whole metres for rally points
_ROUNDING = 1e-4
_TURN_DEG = 360.0

# What ArduPilot keeps of the parameters of a command, by index; what is not kept comes back as a constant of its own.
# Of a command that is not listed every parameter counts.
_KEPT_BY_ARDUPILOT: dict[int, frozenset[int]] = {
    cmd.WAYPOINT: frozenset({0}),
    cmd.LOITER_UNLIM: frozenset({2}),
    cmd.LOITER_TURNS: frozenset({0, 2}),
    cmd.LOITER_TIME: frozenset({0}),
    cmd.RETURN_TO_LAUNCH: frozenset(),
    cmd.LAND: frozenset({0}),
    cmd.TAKEOFF: frozenset({0}),
    cmd.SPLINE_WAYPOINT: frozenset({0}),
    cmd.VTOL_TAKEOFF: frozenset(),
    cmd.VTOL_LAND: frozenset({0}),
    cmd.DO_JUMP: frozenset({0, 1}),
    cmd.DO_LAND_START: frozenset(),
    178: frozenset({0, 1, 2}),  # DO_CHANGE_SPEED
    195: frozenset(),  # DO_SET_ROI_LOCATION: its place says all
    197: frozenset(),  # DO_SET_ROI_NONE
    cmd.TRIGGER_DISTANCE: frozenset({0, 2}),
}
_WHOLE_IN_ARDUPILOT = {cmd.WAYPOINT: {0}, cmd.LOITER_TIME: {0}, cmd.SPLINE_WAYPOINT: {0}, cmd.TAKEOFF: {0},
                       cmd.LAND: {0}, cmd.LOITER_UNLIM: {2}, cmd.LOITER_TURNS: {0, 2}}  # fmt: skip
_FLIES_OTHERWISE = {(cmd.WAYPOINT, 3): "yaw", (cmd.WAYPOINT, 0): "hold time", (cmd.LOITER_TIME, 0): "loiter time"}

# PX4 keeps what it has a meaning for; the others come back as 0.
_KEPT_BY_PX4: dict[int, frozenset[int]] = {
    cmd.WAYPOINT: frozenset({0, 1, 3}),
    cmd.LOITER_UNLIM: frozenset({2, 3}),
    cmd.LOITER_TIME: frozenset({0, 2}),
    cmd.LAND: frozenset({1, 3}),
    cmd.TAKEOFF: frozenset({3}),
    31: frozenset({1}),
    195: frozenset(),
    cmd.VTOL_TAKEOFF: frozenset({3}),
    cmd.VTOL_LAND: frozenset({3}),
    cmd.RALLY_POINT: frozenset(),
    **{command: frozenset({0}) for command in range(5001, 5005)},
    cmd.FENCE_RETURN_POINT: frozenset(),
}


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that did not come back as it was sent; ``seq`` is the number on the wire, -1 for the whole list."""

    kind: Kind
    seq: int
    field: str
    sent: float
    read: float

    def __str__(self) -> str:
        where = self.kind.name.lower() + (f" item {self.seq}" if self.seq >= 0 else "")
        return f"{where}: {self.field} was sent as {self.sent:g}, read back as {self.read:g}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """What differs, and what was forgiven although it changes the flight."""

    differences: tuple[Difference, ...]
    notes: tuple[str, ...] = ()

    @property
    def is_same(self) -> bool:
        """Whether the vehicle holds what was sent."""
        return not self.differences


def compare(kind: Kind, sent: Sequence[WireItem], read: Sequence[WireItem], autopilot: Autopilot) -> Comparison:
    """Compare a list with its read-back; ArduPilot's home item is its own business and not compared."""
    skip = first_seq(autopilot) if kind is Kind.MISSION else 0
    if len(sent) != len(read) and not (len(sent) <= skip and len(read) <= skip):
        return Comparison((Difference(kind, -1, "number of items", len(sent), len(read)),))
    differences: list[Difference] = []
    forgiven: dict[str, list[int]] = {}
    for seq in range(skip, min(len(sent), len(read))):
        for name, a, b, note in _fields(kind, sent[seq], read[seq], autopilot):
            if note:
                forgiven.setdefault(note, []).append(seq)
            else:
                differences.append(Difference(kind, seq, name, a, b))
    notes = tuple(
        f"the vehicle does not keep the {what} of {len(seqs)} item{'s' if len(seqs) > 1 else ''} (first: {seqs[0]})"
        for what, seqs in forgiven.items()
    )
    return Comparison(tuple(differences), notes)


def _fields(
    kind: Kind, a: WireItem, b: WireItem, autopilot: Autopilot
) -> Iterator[tuple[str, float, float, str | None]]:
    if a.command != b.command:
        yield "command", a.command, b.command, None
        return
    placed = cmd.has_place(a.command) and a.frame != cmd.FRAME_MISSION
    if placed and _frame_group(a.frame) != _frame_group(b.frame) and kind is Kind.MISSION:
        yield "frame", a.frame, b.frame, None
    if placed:
        for name, sent, read in (("latitude", a.x, b.x), ("longitude", a.y, b.y)):
            if abs(sent - read) > _place_step(sent, b):
                yield name, to_degrees(sent), to_degrees(read), None
        if kind is not Kind.FENCE:  # a fence's vertices have no height
            step = _RALLY_STEP_M if kind is Kind.RALLY and autopilot is Autopilot.ARDUPILOT else _ALTITUDE_STEP_M
            if not _is_near(a.z, b.z, step + abs(a.z) * 1e-6):
                yield "altitude", a.z, b.z, None
    else:
        for name, x, back in (("param5", a.x, b.x), ("param6", a.y, b.y)):
            if x != back:
                yield name, x, back, name if back == 0 else None
        if b.z != 0.0 and not _is_near(a.z, b.z, _ALTITUDE_STEP_M):  # what is not kept comes back as 0
            yield "param7", a.z, b.z, None
    for n, (value, returned) in enumerate(zip(a.params, b.params, strict=True)):
        if _is_near(value, returned, _ROUNDING * max(1.0, abs(value))):
            continue
        if not _forgiven(a.command, n, value, returned, autopilot):
            yield f"param{n + 1}", value, returned, None
        elif (a.command, n) in _FLIES_OTHERWISE and math.isfinite(value):
            yield f"param{n + 1}", value, returned, _FLIES_OTHERWISE[a.command, n]


def _forgiven(command: int, n: int, sent: float, read: float, autopilot: Autopilot) -> bool:
    """Whether an autopilot is known to lose just this."""
    if autopilot is Autopilot.PX4:
        kept = _KEPT_BY_PX4.get(command)
        if kept is None:
            return math.isnan(sent) and read == 0.0
        if n == 3 and n in kept and math.isfinite(sent) and math.isfinite(read):  # PX4 turns a yaw into 0 to 360
            return abs(math.remainder(sent - read, _TURN_DEG)) <= 1e-2
        return n not in kept and read in (0.0, 1.0)
    kept = _KEPT_BY_ARDUPILOT.get(command)
    if kept is not None and n not in kept:
        return read in (-1.0, 0.0, 1.0)
    if n in _WHOLE_IN_ARDUPILOT.get(command, ()):
        return not math.isnan(sent) and read == math.trunc(sent)
    if command in (cmd.CIRCLE_INCLUSION, cmd.CIRCLE_EXCLUSION) and n == 0:
        return read == math.trunc(sent)  # versions before 4.6 keep whole metres
    return math.isnan(sent) and read == 0.0


def _is_near(sent: float, read: float, step: float) -> bool:
    if math.isnan(sent) or math.isnan(read):
        return math.isnan(sent) and math.isnan(read)
    return abs(as_float32(sent) - read) <= step


def _place_step(sent: int, read: WireItem) -> float:
    """How far a latitude or longitude may be off, in degrees x 1e7: nothing, but for 32-bit degrees (one step)."""
    if not read.from_float:
        return 0.0
    degrees = abs(to_degrees(sent))
    return 1e7 * (2.0 ** (math.floor(math.log2(degrees)) - 23) if degrees > 1e-9 else 0.0) + 1.0


def _frame_group(frame: int) -> int:
    for number, group in enumerate((cmd.ABSOLUTE_FRAMES, cmd.RELATIVE_FRAMES, cmd.TERRAIN_FRAMES)):
        if frame in group:
            return number
    return frame + 100
