"""What of its battery a flight takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from photomap_gis.core.errors import UsageError

_J_PER_WH = 3600.0


@dataclass(frozen=True, slots=True)
class Battery:
    """What one battery holds and the vehicle draws on average, hovering and flying alike."""

    energy_wh: float
    power_w: float

    @classmethod
    def of(cls, energy_wh: float | None, power_w: float | None) -> Battery | None:
        """Return the battery of both numbers, None of none. Raises ``UsageError`` where one is missing."""
        if energy_wh is None and power_w is None:
            return None
        if energy_wh is None or power_w is None:
            given, missing = ("--power-w", "--battery-wh WH") if energy_wh is None else ("--battery-wh", "--power-w W")
            raise UsageError(f"{given} needs {missing} too: energy is power times time")
        return cls(energy_wh, power_w)


def add_energy(facts: dict[str, Any], battery: Battery | None, endurance_s: float | None) -> None:
    """Add to a plan's facts what each sortie takes: watt-hours and share of its battery, where these are known.

    Without a battery the share is that of the endurance. A sortie that takes more than there is, is warned of.
    """
    for number, sortie in enumerate(facts["sorties"], 1):
        seconds = sortie["duration_s"]
        sortie["energy_wh"] = None if battery is None else round(battery.power_w * seconds / _J_PER_WH, 2)
        whole_s = endurance_s if battery is None else battery.energy_wh / battery.power_w * _J_PER_WH
        sortie["battery_share"] = None if whole_s is None else round(seconds / whole_s, 3)
        if battery is not None and whole_s is not None and seconds > whole_s:
            facts["warnings"].append(
                f"sortie {number} takes {100 * seconds / whole_s:.0f} % of the battery, which lasts "
                f"{whole_s / 60:.1f} min: --endurance-min splits the flight"
            )
    facts["energy_wh"] = None if battery is None else round(sum(s["energy_wh"] for s in facts["sorties"]), 2)
