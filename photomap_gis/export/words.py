"""What every format says of the map besides its pixels: title, dates, attribution, accuracy, and where it came from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class MapWords:
    """The words that travel in a format's metadata; empty or ``None`` where nothing is known.

    ``first_utc`` and ``last_utc`` are ISO 8601 of the oldest and newest frame. ``attribution`` names whom to credit.
    ``provenance`` is a JSON document: version, inputs with hashes, settings, accuracy.
    """

    title: str = "photomap"
    description: str = ""
    attribution: str = ""
    first_utc: str | None = None
    last_utc: str | None = None
    ce90_m: float | None = None
    software: str = "photomap"
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def paragraph(self) -> str:
        """Description, date and attribution as lines of text, for formats that have one field only."""
        lines = [self.description]
        if self.last_utc and self.last_utc not in self.description:
            lines.append(f"Imagery of {self.last_utc}")
        if self.attribution:
            lines.append(self.attribution)
        return "\n".join(line for line in lines if line)

    @property
    def provenance_json(self) -> str:
        """The provenance on one line; empty where there is none."""
        return json.dumps(self.provenance, ensure_ascii=False, sort_keys=True) if self.provenance else ""

    @property
    def pairs(self) -> dict[str, str]:
        """The words by key, without those that are not known, for formats that take keys of one's own."""
        known = {
            "date": self.last_utc,
            "date_first": self.first_utc,
            "predicted_ce90_m": None if self.ce90_m is None else f"{self.ce90_m:.2f}",
            "generator": self.software,
            "provenance": self.provenance_json,
        }
        return {k: v for k, v in known.items() if v}
