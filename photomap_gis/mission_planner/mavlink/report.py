"""How an upload ended, as one frozen value and as the JSON that scripts read."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from photomap_gis.mission_planner.mavlink.compare import Difference
from photomap_gis.mission_planner.mavlink.state import VehicleState


class Outcome(StrEnum):
    """What a run may claim.

    ``verified``: what was asked for was read back from the vehicle. ``restored``: it was not; what the vehicle held
    before was put back and read back. ``refused``: it was not done, by a rule or by the vehicle; ``holds`` says what is
    there. ``unknown``: the vehicle did not answer for the whole stated time.
    """

    VERIFIED = "verified"
    RESTORED = "restored"
    REFUSED = "refused"
    UNKNOWN = "unknown"


class Holds(StrEnum):
    """What the vehicle holds at the end, as it was read back: the new lists, those of before, or a mixture."""

    NEW = "new"
    PREVIOUS = "previous"
    MIXED = "mixed"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Report:
    """The end of an upload, a restore or a clearing; ``items`` is how many were to be there, home not counted."""

    outcome: Outcome
    holds: Holds
    message: str
    items: int = 0
    seconds: float = 0.0
    differences: tuple[Difference, ...] = ()
    warnings: tuple[str, ...] = ()
    saved_previous: str | None = None
    start_item: int | None = None
    vehicle: VehicleState | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the document for scripts."""
        return {
            "outcome": str(self.outcome),
            "items": self.items,
            "seconds": round(self.seconds, 2),
            "differences": [
                {"list": d.kind.name.lower(), "seq": d.seq, "field": d.field,
                 "sent": _plain(d.sent), "read": _plain(d.read)}
                for d in self.differences
            ],
            "saved_previous": self.saved_previous,
            "holds": str(self.holds),
            "message": self.message,
            "warnings": list(self.warnings),
            "start_item": self.start_item,
            "vehicle": self.vehicle.as_json() if self.vehicle else None,
        }  # fmt: skip


def _plain(value: float) -> float | None:
    return value if value == value and abs(value) != float("inf") else None
