"""What a mission's outputs say of themselves: title, description, GeoTIFF tags, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from photomap_gis import __version__
from photomap_gis.export.words import MapWords
from photomap_gis.pipeline.control import checked, residual_rms_m
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.summary import accuracy_document


def map_words(
    solved: Solved, settings: Mapping[str, Any], inputs: Mapping[str, Any], *, attribution: str = ""
) -> MapWords:
    """Return the words of a mission's map; ``settings`` are the mission's and the export's, ``inputs`` its files."""
    provenance = {
        "software": "photomap",
        "version": __version__,
        "inputs": dict(inputs),
        "settings": {k: v for k, v in settings.items() if v not in (None, "", [], ())},
        "frames": solved.count_by_status(),
        "accuracy": {
            "predicted_ce90_m": solved.predicted_ce90_m,
            "fit_to_gps_rms_m": solved.fit_to_gps_rms_m,
            "check_points": accuracy_document(solved.control),
        },
    }
    first, last = _times(solved)
    return MapWords(
        title=_title(last), description=_description(solved, last), attribution=attribution, first_utc=first,
        last_utc=last, ce90_m=solved.predicted_ce90_m, software=f"photomap {__version__}", provenance=provenance,
    )  # fmt: skip


def _times(solved: Solved) -> tuple[str | None, str | None]:
    """Return the times of the oldest and the newest frame, ISO 8601, or ``None``."""
    times = [f.time_s for f in solved.frames if f.time_s is not None]
    if not times:
        return None, None
    first, last = (datetime.fromtimestamp(t, UTC).strftime("%Y-%m-%dT%H:%M:%SZ") for t in (min(times), max(times)))
    return first, last


def _title(last: str | None) -> str:
    return f"photomap {last[:10]}" if last else "photomap"


def _description(solved: Solved, last: str | None) -> str:
    parts = [f"Photo map of {len(solved.trajectory.placements)} frames"]
    if last:
        parts.append(f"newest frame {last}")
    if solved.predicted_ce90_m is not None:
        parts.append(f"predicted CE90 {solved.predicted_ce90_m:.1f} m")
    if (found := checked(solved.control)) is not None:
        parts.append(f"NSSDA {found.nssda_95_m:.2f} m at 95 % by {found.method}")
    if not solved.georeferenced:
        parts.append("NOT GEOREFERENCED: local units")
    return "; ".join(parts)


def geotiff_tags(solved: Solved, words: MapWords) -> dict[str, str]:
    """Return the tags of a GeoTIFF."""
    tags = {"TIFFTAG_SOFTWARE": words.software, "TIFFTAG_IMAGEDESCRIPTION": words.description}
    if words.last_utc:
        tags["TIFFTAG_DATETIME"] = words.last_utc[:19].replace("-", ":").replace("T", " ")
    if words.attribution:
        tags |= {"TIFFTAG_COPYRIGHT": words.attribution, "ATTRIBUTION": words.attribution}
    if words.provenance_json:
        tags["PROVENANCE"] = words.provenance_json
    if solved.predicted_ce90_m is not None:
        tags["PREDICTED_CE90_M"] = f"{solved.predicted_ce90_m:.2f}"
    if solved.fit_to_gps_rms_m is not None:
        tags["FIT_TO_GPS_RMS_M"] = f"{solved.fit_to_gps_rms_m:.2f}"
    if (rms := residual_rms_m(solved.control)) is not None:
        tags["CONTROL_POINTS"] = str(sum(r.used and not r.check for r in solved.control))
        tags["CONTROL_RESIDUAL_RMS_M"] = f"{rms:.3f}"
    if (found := checked(solved.control)) is not None:
        tags |= {
            "CHECK_POINTS": str(found.n),
            "CHECK_RMSE_X_M": f"{found.rmse_x_m:.3f}",
            "CHECK_RMSE_Y_M": f"{found.rmse_y_m:.3f}",
            "CHECK_RMSE_R_M": f"{found.rmse_r_m:.3f}",
            "CHECK_CE90_M": f"{found.ce90_m:.3f}",
            "CHECK_NSSDA_95_M": f"{found.nssda_95_m:.3f}",
            "CHECK_METHOD": found.method,
        }
    return tags
