"""What a mapping run tells: the document that scripts read, and nothing that it does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from photomap_gis.store import LensRecord


@dataclass(frozen=True, slots=True)
class MapSummary:
    """The result of a mapping run; ``None`` where a value is unknown.

    ``fit_to_gps_rms_m`` is a residual of the fit, not an accuracy; ``predicted_ce90_m`` is the accuracy that the
    solver's covariances predict, the GPS's own bias included. ``lenses`` say what the flight told of its lenses, where
    cameras could be posed in space. ``track_lags`` tells by flight how much older its positions were than its pictures
    (``lag_s``, ``sigma_s``, ``corrected``); flights whose motion does not tell are not in it.
    """

    mission: str
    map: str
    crs: str | None
    georeferenced: bool
    gsd_m_per_px: float
    area_m2: float | None
    bounds: tuple[float, float, float, float]
    frames: Mapping[str, int]
    registrations: Mapping[str, int]
    segments: int
    fit_to_gps_rms_m: float | None
    predicted_ce90_m: float | None
    seconds: Mapping[str, float]
    warnings: tuple[str, ...]
    reasons: Mapping[str, Mapping[str, int]]
    outputs: tuple[str, ...]
    lenses: tuple[LensRecord, ...] = ()
    track_lags: Mapping[str, Mapping[str, float | bool]] = field(default_factory=dict)

    def as_document(self) -> dict[str, Any]:
        """Return the JSON document of ``photomap map --json``."""
        return {
            "mission": self.mission,
            "map": self.map,
            "crs": self.crs,
            "georeferenced": self.georeferenced,
            "gsd_m_per_px": self.gsd_m_per_px,
            "area_m2": self.area_m2,
            "bounds": list(self.bounds),
            "frames": dict(self.frames),
            "registrations": dict(self.registrations),
            "segments": self.segments,
            "fit_to_gps_rms_m": self.fit_to_gps_rms_m,
            "predicted_ce90_m": self.predicted_ce90_m,
            "seconds": {stage: round(s, 3) for stage, s in self.seconds.items()},
            "warnings": list(self.warnings),
            "reasons": {status: dict(r) for status, r in self.reasons.items()},
            "outputs": list(self.outputs),
            "lenses": [asdict(lens) for lens in self.lenses],
            "track_lags": {flight: dict(lag) for flight, lag in self.track_lags.items()},
        }
