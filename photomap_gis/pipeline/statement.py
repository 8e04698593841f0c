"""What a finished mission has to say about itself, without solving or drawing anything."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.summary import accuracy_document, control_document, control_lines
from photomap_gis.store import Mission


def mission_statement(folder: Path) -> tuple[dict[str, Any], str]:
    """Return a mission's place, frames and accuracy: a JSON document, and the same in words."""
    with Mission.open(folder) as mission:
        solved, control = Solved.load(mission), mission.load_control()
        crs = solved.crs_name(mission.header.settings.get("crs"))
    document = {
        "mission": str(folder),
        "georeferenced": solved.georeferenced,
        "crs": crs,
        "frames": {"total": len(solved.frames), **solved.count_by_status()},
        "segments": solved.segments,
        "fit_to_gps_rms_m": solved.fit_to_gps_rms_m,
        "predicted_ce90_m": solved.predicted_ce90_m,
        "control_file": control.source or None,
        "control": control_document(solved.control),
        "accuracy": accuracy_document(solved.control),
        "nudges": [asdict(n) for n in control.nudges],
        "warnings": list(solved.warnings),
    }
    counts = ", ".join(f"{n} {status}" for status, n in solved.count_by_status().items() if n)
    lines = [
        f"mission    {folder}: {crs if solved.georeferenced else 'NOT GEOREFERENCED'}",
        f"frames     {counts}; {solved.segments} connected piece(s)",
    ]
    if solved.fit_to_gps_rms_m is not None:
        lines.append(f"fit to GPS {solved.fit_to_gps_rms_m:.2f} m RMS (not the accuracy)")
    lines += control_lines(solved.control)
    if solved.predicted_ce90_m is not None:
        lines.append(f"predicted  CE90 {solved.predicted_ce90_m:.2f} m by the solution's covariances")
    lines += [
        f"by hand    {n.east_m:+.2f} m east, {n.north_m:+.2f} m north, {n.clockwise_deg:+.2f} degrees"
        for n in control.nudges
    ]
    return document, "\n".join([*lines, *(f"warning    {w}" for w in solved.warnings)])
