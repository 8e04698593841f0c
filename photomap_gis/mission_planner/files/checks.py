"""What a mission from a file must be before anything is done with it: finite, on Earth, and not endless."""

from __future__ import annotations

import math

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import PLACED_COMMANDS, MissionItem

MOST_ITEMS = 20_000
"""More than any autopilot stores (the count is 16 bits wide on the wire)."""

MOST_VERTICES = 20_000
"""Of a fence, in all its polygons."""


def number(value: object, where: str, *, nan: bool = False) -> float:
    """Return a finite number; None and NaN are NaN where ``nan`` allows it."""
    if value is None and nan:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f"{where}: a number is needed, not {_short(value)}")
    try:
        found = float(value)
    except OverflowError:
        raise DataError(f"{where}: {_short(value)} is too large") from None
    if math.isinf(found) or (math.isnan(found) and not nan):
        raise DataError(f"{where}: a finite number is needed, not {found}")
    return found


def whole(value: object, where: str, most: int) -> int:
    """Return a whole number from 0 to ``most``."""
    found = number(value, where)
    if found != math.floor(found) or not 0 <= found <= most:
        raise DataError(f"{where}: a whole number from 0 to {most} is needed, not {_short(value)}")
    return int(found)


def place(lat_deg: float, lon_deg: float, where: str) -> tuple[float, float]:
    """Return a latitude and longitude that are on Earth."""
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise DataError(
            f"{where}: latitude {lat_deg:g}, longitude {lon_deg:g} is no place on Earth (are they the other way round?)"
        )
    return lat_deg, lon_deg


def checked_item(item: MissionItem, where: str) -> MissionItem:
    """Return the item if its place is on Earth (NaN: the vehicle decides)."""
    if item.command in PLACED_COMMANDS and not (math.isnan(item.x) or math.isnan(item.y)):
        place(item.x, item.y, where)
    return item


def _short(value: object) -> str:
    words = repr(value) if not isinstance(value, int) or abs(value) < 10**20 else "a number of many digits"
    return words if len(words) <= 40 else f"{words[:37]}..."
