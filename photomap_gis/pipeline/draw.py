"""Drawing a mission's maps: one where the mission knows its place on Earth, else one a connected segment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import TileStore, plan_grid, render_mosaic
from photomap_gis.pipeline.prepare import read_pixels
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMap:
    """A finished map: its tiles, its segment (``None``: all), and the area that it shows, in units of its CRS."""

    store: TileStore
    segment: int | None
    area: float


def draw_maps(mission: Mission, solved: Solved, settings: MapSettings, on_progress: Progress) -> list[DrawnMap]:
    """Render what was solved, the largest map first; raise ``DataError`` where nothing can be pasted."""
    refs = {f.index: f for f in solved.frames}

    def pixels(frame: int) -> ImageArray:
        return read_pixels(mission, refs[frame])

    def draw(number: int, trajectory: Trajectory, segment: int | None) -> DrawnMap:
        grid = plan_grid(trajectory, solved.map_frame, pixel_size=settings.gsd_m_per_px)
        store = render_mosaic(
            trajectory,
            solved.map_frame,
            grid,
            pixels,
            mission.mosaic_folder(number),
            revision=trajectory.revision,
            workers=settings.workers,
            memory_mb=settings.memory_mb,
            on_progress=partial(on_progress, "render"),
        )
        return DrawnMap(store, segment, seen_area(store))

    if not solved.segment_numbers:
        raise DataError(solved.why_nothing)
    if solved.georeferenced:
        return [draw(0, solved.trajectory, None)]
    return [draw(n, solved.trajectory.segment(s), s) for n, s in enumerate(solved.segment_numbers)]


def seen_area(store: TileStore) -> float:
    """Return the area of the pixels that show ground, in square units of the map's CRS."""
    grid = store.grid
    seen = sum(int((store.read(grid.window(t))[..., 3] > 127).sum()) for t in grid.tiles())
    return seen * grid.pixel_size**2
