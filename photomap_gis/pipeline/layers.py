"""A mission's layers: what is known of each pixel of its map, worked out from its solution and written as rasters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from photomap_gis.core.posegraph import Trajectory
from photomap_gis.export import target_grid, write_layers
from photomap_gis.mosaic import TileStore, render_layers
from photomap_gis.mosaic.measured import load_measured
from photomap_gis.pipeline.master import frame_of_grid
from photomap_gis.pipeline.solved import PASTED, Solved


def write_map_layers(
    solved: Solved,
    trajectory: Trajectory,
    store: TileStore,
    folder: Path,
    *,
    crs: str | None = None,
    pixel_size: float | None = None,
    tags: Mapping[str, str],
    workers: int | None = None,
    on_progress: Callable[[int, int], None],
) -> list[Path]:
    """Write all layers of a drawn map into a folder and return the files.

    ``trajectory`` is that of the map's frames. ``crs`` and ``pixel_size`` are those of the written map where it is not
    written on its own grid. Raises ``DataError`` where the map was drawn by a version that did not note its sources.
    """
    frames = {p.frame for p in trajectory.placements if p.status in PASTED}
    times_s = {f.index: f.time_s for f in solved.frames if f.index in frames and f.time_s is not None}
    tiles = store.grid.tile_rows * store.grid.tile_cols  # written layers count as much as made ones

    def made(done: int, total: int) -> None:
        on_progress(round(done / total * tiles), 2 * tiles)

    def written(done: int, total: int) -> None:
        on_progress(tiles + round(done / total * tiles), 2 * tiles)

    layers = render_layers(
        store, trajectory, frame_of_grid(solved.map_frame, store.grid), times_s=times_s, workers=workers,
        on_progress=made,
    )  # fmt: skip
    own = crs is None and pixel_size is None
    grid = None if own else target_grid(store.grid, crs or str(store.grid.crs_wkt), pixel_size)
    measured = load_measured(store)
    blur_px = {} if measured is None else measured.blur_px
    known = sum(math.isfinite(b) for f, b in blur_px.items() if f in frames)
    about = dict(tags) | {
        "FRAMES": str(len(frames)),
        "FRAMES_WITH_TIME": str(len(times_s)),
        "FRAMES_WITH_BLUR": str(known),
        "RESAMPLING": "none" if grid is None or grid == store.grid else "nearest",
    }
    if times_s:
        newest = datetime.fromtimestamp(max(times_s.values()), UTC)
        about["NEWEST_FRAME"] = newest.strftime("%Y-%m-%dT%H:%M:%SZ")
    return write_layers(layers, folder, grid=grid, metadata=about, on_progress=written)
