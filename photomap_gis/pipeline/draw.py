"""Drawing a mission's maps: one where the mission knows its place on Earth, else one a connected segment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import FrameRef, ImageArray
from photomap_gis.core.grid import ground_pixel_m
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import Prefer, TileStore, plan_grid, render_mosaic
from photomap_gis.pipeline.master import master_frame
from photomap_gis.pipeline.prepare import read_pixels
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.store import Mission, MissionPaths


@dataclass(frozen=True, slots=True, eq=False)
class FramePixels:
    """Reads a frame's pixels by its number, on whichever machine it is called."""

    paths: MissionPaths
    refs: Mapping[int, FrameRef]

    def __call__(self, frame: int) -> ImageArray:
        """Return the frame's raster at full resolution."""
        return read_pixels(self.paths, self.refs[frame])


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMap:
    """A finished map: its tiles and the frames in it, its segment (``None``: all), and what it shows.

    ``area`` is in square metres on the ground (units of a relative map), ``gsd_m_per_px`` a pixel there.
    """

    store: TileStore
    trajectory: Trajectory
    segment: int | None
    area: float
    gsd_m_per_px: float


def draw_maps(mission: Mission, solved: Solved, settings: MapSettings, on_progress: Progress) -> list[DrawnMap]:
    """Render what was solved, the largest map first; raise ``DataError`` where nothing can be pasted."""
    refs = {f.index: f for f in solved.frames}
    frame = master_frame(solved.map_frame, settings.crs)
    times_s = _times(solved.frames)

    pixels = FramePixels(mission.paths, refs)

    def draw(number: int, trajectory: Trajectory, segment: int | None) -> DrawnMap:
        grid = plan_grid(trajectory, frame, pixel_size=settings.gsd_m_per_px)
        store = render_mosaic(
            trajectory,
            frame,
            grid,
            pixels,
            mission.mosaic_folder(number),
            revision=trajectory.revision,
            prefer=settings.prefer or Prefer.NADIR,
            times_s=times_s,
            workers=settings.workers,
            scheduler=settings.scheduler,
            memory_mb=settings.memory_mb,
            on_progress=partial(on_progress, "render"),
        )
        gsd = ground_pixel_m(grid, frame)
        return DrawnMap(store, trajectory, segment, seen_area(store) * (gsd / grid.pixel_size) ** 2, gsd)

    if not solved.segment_numbers:
        raise DataError(solved.why_nothing)
    if solved.georeferenced:
        return [draw(0, solved.trajectory, None)]
    return [draw(n, solved.trajectory.segment(s), s) for n, s in enumerate(solved.segment_numbers)]


def _times(frames: Sequence[FrameRef]) -> dict[int, float | None]:
    """Return the frames' times in seconds by one clock; of frames without any, those of a flight follow each other."""
    if any(f.time_s is not None for f in frames):
        return {f.index: f.time_s for f in frames}
    return {f.index: f.flight * 86400.0 + (f.pts_s if f.pts_s is not None else float(f.index)) for f in frames}


def seen_area(store: TileStore) -> float:
    """Return the area of the pixels that show ground, in square units of the map's CRS."""
    grid = store.grid
    seen = sum(int((store.read(grid.window(t))[..., 3] > 127).sum()) for t in grid.tiles())
    return seen * grid.pixel_size**2
