"""A mission folder as ``photomap serve`` shows it, read through the corridor."""

from __future__ import annotations

from pathlib import Path

from photomap_gis.core.errors import DataError
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.statement import mission_statement
from photomap_gis.server.view import MissionView
from photomap_gis.store import Mission


def open_view(folder: Path) -> MissionView:
    """Return a mission at this moment; ``PhotomapError`` where there is none, or it was never solved or drawn."""
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        segments = [] if solved.georeferenced else solved.segment_numbers
        drawn = [mission.mosaic_folder(n) for n in range(max(1, len(segments)))]
    shown = [n for n, path in enumerate(drawn) if (path / "grid.json").is_file()]
    mosaics = [drawn[n] for n in shown]
    if not mosaics:
        raise DataError(f"{folder} has no drawn map: run 'photomap map' on its sources again to finish it")
    document, _ = mission_statement(folder)
    return MissionView(
        folder,
        folder.resolve().name,
        solved.map_frame,
        solved.frames,
        solved.trajectory.placements,
        solved.statuses,
        solved.reasons,
        solved.trajectory.revision,
        tuple(mosaics),
        tuple(segments[n] for n in shown if segments),
        document["crs"],
        {key: document[key] for key in ("fit_to_gps_rms_m", "predicted_ce90_m", "accuracy", "segments")},
        solved.warnings,
    )
