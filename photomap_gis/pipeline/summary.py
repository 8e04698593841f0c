"""What a mapping run tells: the document that scripts read, and nothing that it does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from photomap_gis.core.tie import ReferenceTies


@dataclass(frozen=True, slots=True)
class ReferenceSummary:
    """What came of a reference: places compared, frames tied to it, its pixel and its own constant error."""

    path: str
    gsd_m_per_px: float
    sigma_m: float
    places: int
    ties: int
    word: str

    @classmethod
    def of(cls, r: ReferenceTies) -> ReferenceSummary:
        """Return the summary of what a mission keeps of a reference."""
        return cls(r.path, r.gsd_m_per_px, r.sigma_m, r.tried, len(r.kept), r.word)


@dataclass(frozen=True, slots=True)
class MapSummary:
    """The result of a mapping run; ``None`` where a value is unknown.

    ``fit_to_gps_rms_m`` is a residual of the fit, not an accuracy; ``predicted_ce90_m`` is the accuracy that the
    solver's covariances predict, the GPS's own bias included.
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
    references: tuple[ReferenceSummary, ...] = ()

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
            "references": [asdict(r) for r in self.references],
        }
