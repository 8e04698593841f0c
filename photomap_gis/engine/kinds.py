"""The commands that may be jobs, and how patient one must be with each."""

from __future__ import annotations

from dataclasses import dataclass

_WORK_GRACE_S = 10.0
_LINK_GRACE_S = 90.0
"""A vehicle in mid upload is first brought to a known state, over a link that may be slow."""
_FLIGHT_GRACE_S = 1800.0
"""A live flight that is asked to stop lands: its final map is solved and drawn, and that is its result."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A command of ``photomap`` as a job; ``grace_s`` is how long it may take to stop before it is killed."""

    name: str
    grace_s: float = _WORK_GRACE_S
    forced: tuple[str, ...] = ("as_json",)
    """Flags that every job of this kind is given, by click's names; ``--json`` makes its result a document."""


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("map"),
        Kind("solve"),
        Kind("georeference"),
        Kind("reference"),
        Kind("export"),
        Kind("compare"),
        Kind("package"),
        Kind("cameras"),
        Kind("plan"),
        Kind("convert"),
        Kind("upload", _LINK_GRACE_S),
        Kind("download", _LINK_GRACE_S),
        Kind("clear", _LINK_GRACE_S),
        Kind("vehicle"),
        Kind("simulate"),
        Kind("info"),
        Kind("finds"),
        Kind("live", _FLIGHT_GRACE_S),
        Kind("replay"),
    )
}
