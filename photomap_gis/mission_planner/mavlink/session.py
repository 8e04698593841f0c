"""A conversation with a real vehicle: the link opened, the steps run, the link closed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from photomap_gis.mission_planner.mavlink.link import MavlinkLink
from photomap_gis.mission_planner.mavlink.talk import Address, Patience, Steps, Talk, converse
from photomap_gis.vehicle_link import open_transport, parse_url

T = TypeVar("T")

GROUND_STATION = Address(system=254, component=190)
"""Not 255, which ArduPilot's failsafe listens for: a vehicle in the air must not miss us when an upload is over."""


@dataclass(frozen=True, slots=True)
class Connection:
    """How to reach a vehicle."""

    url: str
    timeout_s: float = 60.0
    tlog: Path | None = None
    key: bytes | None = None
    me: Address = GROUND_STATION


def run(
    connection: Connection,
    make_steps: Callable[[Talk], Steps[T]],
    *,
    on_progress: Callable[[str, int, int], None] | None = None,
    on_open: Callable[[Talk], None] | None = None,
) -> T:
    """Open the link, run the steps to their end, and return what they return.

    ``on_open`` is given the talk, by which a signal's handler asks to stop. Raises ``UsageError`` for an address
    that is none, ``LinkError`` where it cannot be opened.
    """
    talk = Talk(
        connection.me,
        Patience(timeout_s=connection.timeout_s),
        on_progress=on_progress,
        signs=connection.key is not None,
    )
    transport = open_transport(parse_url(connection.url))
    with MavlinkLink(transport, connection.me, tlog=connection.tlog, key=connection.key) as link:
        if on_open is not None:
            on_open(talk)
        result = converse(talk, make_steps(talk), link)
        return result
