"""The file that keeps what a vehicle held before it was changed: every item as it came over the wire.

A ``.plan`` or ``.waypoints`` file would lose what they cannot say (a fence's return point, an unknown command).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from photomap_gis.core.errors import DataError
from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink.state import VehicleState
from photomap_gis.mission_planner.mavlink.wire import Kind, Lists, WireItem
from photomap_gis.publish import write_file

FILE_TYPE = "photomap vehicle lists"
LARGEST_FILE_BYTES = 32 << 20
_Number = Annotated[float, Field(allow_inf_nan=False)] | None
_Int32 = Annotated[int, Field(ge=-(2**31), lt=2**31)]


class _Item(BaseModel):
    model_config = ConfigDict(extra="forbid")
    command: Annotated[int, Field(ge=0, lt=65_536)]
    frame: Annotated[int, Field(ge=0, lt=256)]
    params: tuple[_Number, _Number, _Number, _Number]
    x: _Int32
    y: _Int32
    z: _Number
    autocontinue: bool


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")
    fileType: Literal["photomap vehicle lists"]
    version: Literal[1]
    autopilot: Autopilot
    system: int
    mission: list[_Item] | None = None
    fence: list[_Item] | None = None
    rally: list[_Item] | None = None


def write_lists(path: Path, vehicle: VehicleState, lists: Lists) -> None:
    """Write lists whole or not at all; a list that was not read is not there, an empty one is empty."""
    document = {
        "fileType": FILE_TYPE,
        "version": 1,
        "autopilot": str(vehicle.autopilot),
        "system": vehicle.system,
        **{kind.name.lower(): _plain(items) for kind, items in sorted(lists.items())},
    }
    write_file(path, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def _plain(items: Sequence[WireItem]) -> list[dict[str, object]]:
    return [
        {
            "command": i.command, "frame": i.frame, "params": [_or_null(p) for p in i.params], "x": i.x, "y": i.y,
            "z": _or_null(i.z), "autocontinue": i.autocontinue,
        }
        for i in items
    ]  # fmt: skip


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None


def is_lists_file(path: Path) -> bool:
    """Whether a file looks like one of these."""
    try:
        with path.open("rb") as file:
            return FILE_TYPE.encode() in file.read(512)
    except OSError:
        return False


def read_lists(path: Path) -> tuple[Autopilot, dict[Kind, tuple[WireItem, ...]]]:
    """Read lists and whose they are. Raises ``DataError`` for what is no such file."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE_BYTES + 1)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    if len(content) > LARGEST_FILE_BYTES:
        raise DataError(f"{path} is too large for what a vehicle holds")
    try:
        document = _Document.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the document"
        raise DataError(f"{path} is not a file of saved vehicle lists: {where}: {first['msg']}") from error
    found = {Kind.MISSION: document.mission, Kind.FENCE: document.fence, Kind.RALLY: document.rally}
    return document.autopilot, {
        kind: tuple(_wire(i) for i in items) for kind, items in found.items() if items is not None
    }


def _wire(item: _Item) -> WireItem:
    p = [math.nan if v is None else v for v in item.params]
    z = math.nan if item.z is None else item.z
    return WireItem(item.command, item.frame, (p[0], p[1], p[2], p[3]), item.x, item.y, z, item.autocontinue)
