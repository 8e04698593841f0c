"""What a mapping run tells: the document that scripts read, and nothing that it does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from photomap_gis.core.control import Nudge
from photomap_gis.core.tie import ReferenceTies
from photomap_gis.pipeline.control import ControlResult, checked, residual_rms_m
from photomap_gis.store import LensRecord


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
    solver's covariances predict, the GPS's own bias included. ``lenses`` say what the flight told of its lenses, where
    cameras could be posed in space. ``track_lags`` tells by flight how much older its positions were than its pictures
    (``lag_s``, ``sigma_s``, ``corrected``); flights whose motion does not tell are not in it. ``bounds`` are in the
    map's CRS, ``size_m`` is its width and height on the ground.
    """

    mission: str
    map: str
    crs: str | None
    georeferenced: bool
    gsd_m_per_px: float
    area_m2: float | None
    bounds: tuple[float, float, float, float]
    size_m: tuple[float, float]
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
    control: tuple[ControlResult, ...] = ()
    nudges: tuple[Nudge, ...] = ()
    track_lags: Mapping[str, Mapping[str, float | bool]] = field(default_factory=dict)
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
            "size_m": list(self.size_m),
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
            "control": control_document(self.control),
            "accuracy": accuracy_document(self.control),
            "nudges": [asdict(n) for n in self.nudges],
            "track_lags": {flight: dict(lag) for flight, lag in self.track_lags.items()},
            "references": [asdict(r) for r in self.references],
        }


def control_document(results: Sequence[ControlResult]) -> dict[str, Any] | None:
    """Return the control points' residuals and the check points' misses; ``None`` where there is no such point.

    Misses are the map minus the given place; ``predicted_sigma_m`` holds map, survey and click.
    """
    if not results:
        return None
    return {
        "residual_rms_m": residual_rms_m(results),
        "points": [
            {
                "name": r.miss.name,
                "role": "check" if r.check else "control",
                "used": r.used,
                "dx_m": r.miss.east_m,
                "dy_m": r.miss.north_m,
                "miss_m": r.miss.miss_m,
                "predicted_sigma_m": r.miss.sigma_m,
                "pictures": r.miss.sightings,
            }
            for r in results
        ],
    }


def accuracy_document(results: Sequence[ControlResult]) -> dict[str, Any] | None:
    """Return the accuracy that the check points tell; ``None`` without check points."""
    found = checked(results)
    return None if found is None else {**asdict(found), "meets_standard": found.meets_standard, "method": found.method}


def control_lines(results: Sequence[ControlResult]) -> list[str]:
    """Return the statement on control and check points as a person reads it."""
    lines = []
    rms, found = residual_rms_m(results), checked(results)
    aside = sum(not r.used and not r.check for r in results)
    if any(not r.check for r in results):
        fitted = sum(r.used and not r.check for r in results)
        lines.append(f"control    {fitted} point(s) in the fit" + (f", {aside} put aside" if aside else "")
                     + (f"; residual {rms:.2f} m RMS (not the accuracy)" if rms is not None else ""))  # fmt: skip
    if found is not None:
        lines.append(
            f"accuracy   RMSE x {found.rmse_x_m:.2f} m, y {found.rmse_y_m:.2f} m, r {found.rmse_r_m:.2f} m; "
            f"CE90 {found.ce90_m:.2f} m; NSSDA {found.nssda_95_m:.2f} m at 95 %"
        )
        lines.append(f"           by {found.method}; NEES/dof {found.nees_per_dof:.2f} (n = {found.n})")
        lines += [
            f"           {r.miss.name}: dx {r.miss.east_m:+.2f} m, dy {r.miss.north_m:+.2f} m "
            f"(predicted sigma {r.miss.sigma_m:.2f} m)"
            for r in results
            if r.check
        ]
    return lines
