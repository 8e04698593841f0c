"""Mission Planner's ``.waypoints``: a line an item, tab-separated, the first one home [MAVLink: mission file formats].

It holds the mission alone: fence and rally points have no place in it.
"""

from __future__ import annotations

import math

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import Home, Mission, MissionItem
from photomap_gis.mission_planner.commands import Cmd, Frame
from photomap_gis.mission_planner.files.checks import MOST_ITEMS, checked_item, number, place, whole

_HEADER = "QGC WPL 110"
_COLUMNS = 12


def waypoints_text(mission: Mission) -> str:
    """Return the text; home's height is 0 where it is not known, since a number must stand there."""
    home = mission.home or Home(0.0, 0.0)
    first = MissionItem(Cmd.NAV_WAYPOINT, Frame.GLOBAL, x=home.lat_deg, y=home.lon_deg, z=home.alt_amsl_m or 0.0)
    lines = [_line(0, True, first)]
    lines += [_line(i, False, item) for i, item in enumerate(mission.items, 1)]
    return "\n".join((_HEADER, *lines, ""))


def _line(index: int, current: bool, item: MissionItem) -> str:
    params = (_text(p, 8) for p in item.params)
    return "\t".join(
        (
            str(index),
            str(int(current)),
            str(int(item.frame)),
            str(int(item.command)),
            *params,
            _text(item.x, 10),
            _text(item.y, 10),
            _text(item.z, 6),
            str(int(item.autocontinue)),
        )
    )


def _text(value: float, decimals: int) -> str:
    return "NaN" if math.isnan(value) else f"{value + 0.0:.{decimals}f}"


def read_waypoints(text: str, name: str) -> Mission:
    """Read a ``.waypoints`` file of any version; ``name`` is for messages.

    The first item is home, as every ground station writes it, unless it is something that cannot be one (a take-off).
    Raises ``DataError`` where a line is not an item.
    """
    lines = [line.strip() for line in text.splitlines()]
    rows = [(number_, line) for number_, line in enumerate(lines, 1) if line and not line.startswith("#")]
    if not rows or not rows[0][1].startswith("QGC WPL"):
        raise DataError(f"{name} does not begin with 'QGC WPL 110': it is no .waypoints file")
    if len(rows) - 1 > MOST_ITEMS:
        raise DataError(f"{name} holds more than {MOST_ITEMS} items: no vehicle takes these")
    items = []
    for at, (line_number, line) in enumerate(rows[1:]):
        where = f"{name}, line {line_number}"
        fields = line.split()
        if len(fields) != _COLUMNS:
            raise DataError(f"{where}: an item has {_COLUMNS} columns, not {len(fields)}")
        index = whole(_parse(fields[0], where), f"{where}: index", MOST_ITEMS)
        if index != at:
            raise DataError(f"{where}: item {index} stands where {at} should: the file is not whole")
        items.append(_item(fields, where))
    if not items:
        raise DataError(f"{name} holds no items")
    home = None
    if items[0].command == Cmd.NAV_WAYPOINT:
        home = _home(items.pop(0), name)
    return Mission(items=tuple(items), home=home)


def _item(fields: list[str], where: str) -> MissionItem:
    p1, p2, p3, p4, x, y, z = (number(_parse(field, where), where, nan=True) for field in fields[4:11])
    item = MissionItem(
        command=whole(_parse(fields[3], where), f"{where}: command", 65535),
        frame=whole(_parse(fields[2], where), f"{where}: frame", 255),
        params=(p1, p2, p3, p4),
        x=x,
        y=y,
        z=z,
        autocontinue=whole(_parse(fields[11], where), f"{where}: autocontinue", 1) == 1,
    )
    return checked_item(item, where)


def _parse(field: str, where: str) -> float:
    try:
        # float() also takes "1_0" and digits of other scripts, which no ground station writes.
        return float(field if field.isascii() and "_" not in field else "")
    except ValueError:
        raise DataError(f"{where}: {field[:40]!r} is not a number") from None


def _home(item: MissionItem, name: str) -> Home | None:
    if math.isnan(item.x + item.y) or (item.x == 0.0 and item.y == 0.0):
        return None
    lat, lon = place(item.x, item.y, f"{name}: home")
    # 0 is what ground stations write for a height that they do not know.
    return Home(lat, lon, None if item.z == 0.0 or math.isnan(item.z) else item.z)
