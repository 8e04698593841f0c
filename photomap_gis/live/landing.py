"""After landing: the mission is solved, drawn and exported exactly as ``photomap map`` does with the recording.

What the flight has registered is taken over; key frames are the frames of the map.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import DataError
from photomap_gis.georef import choose_map_frame
from photomap_gis.live.journal import load_session, save_session
from photomap_gis.live.loop import Tally
from photomap_gis.pipeline import MapSummary, map_flight
from photomap_gis.pipeline.opening import kept_settings
from photomap_gis.pipeline.settings import Progress
from photomap_gis.server.live_view import LiveEnd, LivePhase
from photomap_gis.store import Mission

STAGES = ("read", "register", "solve", "loops", "join", "render", "export")


@dataclass(frozen=True, slots=True, eq=False)
class LiveSummary:
    """What there is to tell of a flight: how it went, and (``None``: it was not finalised) the map that came of it."""

    mission: str
    tally: Tally
    keyframes: int
    pieces: int
    replay_of: str | None
    map: MapSummary | None = None
    warnings: tuple[str, ...] = ()

    def as_document(self) -> dict[str, Any]:
        """Return all of it as JSON takes it."""
        t = self.tally
        return {
            "mission": self.mission,
            "frames": t.frames,
            "tracked": t.tracked,
            "dropped": t.dropped,
            "error_frames": t.error_frames,
            "waiting_frames": t.waiting,
            "keyframes": self.keyframes,
            "segments": {"begun": t.segments_begun + 1, "recognised": t.joined, "pieces_at_landing": self.pieces},
            "solutions": t.solutions,
            "georeferenced_at_s": t.snapped_at_s,
            "intervals": [asdict(i) for i in t.intervals],
            "map": None if self.map is None else self.map.as_document(),
            "warnings": list(self.warnings),
        }


def land(folder: Path, on_progress: Progress, on_end: Callable[[LiveEnd], None] = lambda end: None) -> MapSummary:
    """Make the final map of a flight and return what there is to tell about it; ``PhotomapError`` where none comes."""
    with Mission.open(folder) as mission:
        sources, settings = mission.header.sources, kept_settings(mission)
        fixes = [f.fix for f in mission.frames if f.fix is not None]
        if not any(True for _ in mission.frames):
            raise DataError(f"{folder}: no frame could be used, so there is no map; was the lens cap on?")
        if mission.header.map_frame.crs_wkt is None and fixes:
            mission.save_header(replace(mission.header, map_frame=choose_map_frame(fixes, settings.crs)))

    def progress(stage: str, done: int, total: int) -> None:
        on_progress(stage, done, total)
        step = STAGES.index(stage) if stage in STAGES else len(STAGES) - 1
        on_end(LiveEnd(LivePhase.FINALISING, (step + done / max(total, 1)) / len(STAGES), stage))

    summary = map_flight(list(sources), folder, settings, on_progress=progress)
    shutil.rmtree(folder / "cache" / "live", ignore_errors=True)
    save_session(folder, {**load_session(folder), "landed": True})
    return summary
