"""Render a whole map: plan, level the exposure, then tile after tile into a store, in threads and bounded memory."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic.exposure import Exposure, find_exposure
from photomap_gis.mosaic.lowband import LowBand, LowBandStore
from photomap_gis.mosaic.order import in_best_order
from photomap_gis.mosaic.pixels import LruCache, SourceImage, check_pixels, prepare
from photomap_gis.mosaic.plan import TileJob, plan_jobs
from photomap_gis.mosaic.render import render_tile
from photomap_gis.mosaic.tiles import RgbaArray, TileStore, write_atomically
from photomap_gis.mosaic.views import View, views_of
from photomap_gis.parallel import map_jobs, usable_cpus

logger = logging.getLogger(__name__)

ReadPixels = Callable[[int], ImageArray]
Progress = Callable[[int, int], None]
Value = TypeVar("Value")

RECIPE = "1"
"""Changes whenever the same placements would give other pixels: tiles of an older recipe are rendered anew."""

_EXPOSURE_FILE = "exposure.json"
_TILE_WORK_BYTES = 80 << 20  # arrays of a tile, and what the allocator keeps of them for each thread
_LOW_BAND_BYTES = 48 << 20


def render_mosaic(
    trajectory: Trajectory,
    map_frame: MapFrame,
    grid: MapGrid,
    read_pixels: ReadPixels,
    folder: Path,
    *,
    revision: int,
    workers: int | None = None,
    memory_mb: int = 512,
    on_progress: Progress | None = None,
) -> TileStore:
    """Render the map of ``trajectory`` into ``folder`` and return its store.

    ``read_pixels(frame)`` returns a frame's BGR or grey raster and is called from several threads; a frame for which it
    raises ``FrameReadError`` is left out and logged. Tiles that a killed run of the same plan left are kept. About
    ``memory_mb`` are used whatever the map's size, more only where single frames are larger than that.
    ``on_progress(done, total)`` counts frames levelled and tiles rendered.
    """
    fingerprint = fingerprint_of(views_of(trajectory), map_frame)
    store = TileStore.create(folder, grid, revision=revision, fingerprint=fingerprint)
    scratch = _scratch_folder(store.folder, fingerprint)
    workers = workers or usable_cpus()
    frames = _Frames(trajectory, grid, read_pixels, scratch, _frame_bytes(memory_mb, workers, grid.tile_size))
    with _single_threaded_opencv():
        plan = _plan_readable(trajectory, map_frame, store, frames, workers, on_progress)
        todo = in_best_order(plan.todo, frames_in_memory=frames.capacity)
        done, total = plan.levelled + plan.finished, plan.levelled + plan.finished + len(todo)

        def render(job: TileJob) -> None:
            store.write(job.tile, _render_readable(job, plan, grid, map_frame, frames))

        for _ in map_jobs(render, todo, workers=workers):
            done += 1
            if on_progress is not None:
                on_progress(done, total)
    shutil.rmtree(scratch, ignore_errors=True)
    return store


def fingerprint_of(views: Sequence[View], map_frame: MapFrame) -> str:
    """Return a digest of all that decides what the tiles of a grid show, but the frames' pixels."""
    digest = hashlib.sha256(f"{RECIPE} {map_frame!r}".encode())
    for view in views:
        placement = view.placement
        size = np.array([placement.width_px, placement.height_px])
        probe_px = np.stack(np.meshgrid(*(np.linspace(0.0, side - 1.0, 4) for side in size)), axis=-1).reshape(-1, 2)
        xy_mm = np.rint(placement.camera_to_map.project(probe_px) * 1000.0 / max(view.gsd_m_per_px, 1e-9))
        digest.update(f"{view.frame} {view.tier} {size}".encode())
        digest.update(np.nan_to_num(xy_mm).tobytes())
    return digest.hexdigest()


class _Plan(NamedTuple):
    """What is left to do: ``finished`` tiles lie in the store already, ``levelled`` frames were opened for it."""

    views: dict[int, View]
    todo: list[TileJob]
    exposure: Exposure
    finished: int
    levelled: int


class _Frames:
    """The frames of a run, as ``render.FrameSource``; remembers those that cannot be read."""

    def __init__(
        self, trajectory: Trajectory, grid: MapGrid, read_pixels: ReadPixels, scratch: Path, limit_bytes: int
    ) -> None:
        self._placements = {p.frame: p for p in trajectory.placements}
        self._pixel_size, self._read = grid.pixel_size, read_pixels
        self._images: LruCache[int, SourceImage] = LruCache(self._load, lambda source: source.image.nbytes, limit_bytes)
        self._lows = LowBandStore(scratch, self._images.get, limit_bytes=_LOW_BAND_BYTES)
        self.unreadable: set[int] = set()
        sizes = [p.width_px * p.height_px * 3 for p in trajectory.placements]
        self.capacity = max(1, limit_bytes // max(1, *sizes, 1))

    def image(self, view: View) -> SourceImage:
        """Return the frame's pixels, prepared for the grid."""
        return self._noting_failure(self._images.get, view.frame)

    def low_band(self, view: View) -> LowBand:
        """Return the frame's low frequencies."""
        return self._noting_failure(self._lows.get, view.frame)

    def try_to_level(self, view: View) -> View:
        """Have the frame's low frequencies made; a failure is noted in ``unreadable``."""
        with contextlib.suppress(FrameReadError):
            self.low_band(view)
        return view

    def _noting_failure(self, get: Callable[[int], Value], frame: int) -> Value:
        try:
            return get(frame)
        except FrameReadError as error:
            if frame not in self.unreadable:
                logger.warning("frame %d is left out of the map: %s", frame, error)
                self.unreadable.add(frame)
            raise

    def _load(self, frame: int) -> SourceImage:
        placement = self._placements[frame]
        image = check_pixels(self._read(frame), placement)
        return prepare(image, self._pixel_size / placement.gsd_m_per_px)


def _plan_readable(
    trajectory: Trajectory,
    map_frame: MapFrame,
    store: TileStore,
    frames: _Frames,
    workers: int,
    on_progress: Progress | None,
) -> _Plan:
    """Plan the tiles that are missing, with readable frames only, and find the frames' exposure."""
    kept = _load_exposure(store)
    if kept is not None:
        frames.unreadable.update(kept[1])
    levelled: set[int] = set()
    while True:
        readable = Trajectory(
            tuple(p for p in trajectory.placements if p.frame not in frames.unreadable), trajectory.revision
        )
        views = {view.frame: view for view in views_of(readable)}
        jobs = list(plan_jobs(list(views.values()), store.grid, map_frame))
        todo = [job for job in jobs if not store.done(job.tile)]
        needed = sorted({frame for job in (jobs if kept is None else todo) for frame in job.neighbours} - levelled)
        if not todo or not needed:
            break
        total = len(levelled) + len(needed) + len(jobs)
        for view in map_jobs(frames.try_to_level, [views[frame] for frame in needed], workers=workers):
            levelled.add(view.frame)
            if on_progress is not None:
                on_progress(len(levelled), total)
        if not frames.unreadable.intersection(needed):
            break
    if not views:
        raise DataError(
            "none of the frames could be read: see the warnings above; are the photos still where they were?"
        )
    if not todo:
        exposure = Exposure({})
    elif kept is not None:
        exposure = kept[0]
    else:
        exposure = find_exposure(
            [views[frame] for frame in sorted(levelled & views.keys())], lambda f: frames.low_band(views[f])
        )
        _keep_exposure(store, exposure, frames.unreadable)
    return _Plan(views, todo, exposure, len(jobs) - len(todo), len(levelled))


def _render_readable(job: TileJob, plan: _Plan, grid: MapGrid, map_frame: MapFrame, frames: _Frames) -> RgbaArray:
    """Return the tile, without frames that turn out to be unreadable now."""
    while True:
        missing = set(frames.unreadable)
        try:
            return render_tile(
                grid.window(job.tile),
                grid,
                map_frame,
                givers=[plan.views[f] for f in job.frames if f not in missing],
                neighbours=[plan.views[f] for f in job.neighbours if f not in missing],
                source=frames,
                exposure=plan.exposure,
            )
        except FrameReadError:
            if not (frames.unreadable - missing) & set(job.neighbours):
                raise


def _keep_exposure(store: TileStore, exposure: Exposure, unreadable: set[int]) -> None:
    document = {
        "fingerprint": store.fingerprint,
        "vignette": exposure.vignette,
        "gains": {str(frame): gain.tolist() for frame, gain in exposure.gains.items()},
        "unreadable": sorted(unreadable),
    }
    write_atomically(store.folder / _EXPOSURE_FILE, json.dumps(document).encode())


def _load_exposure(store: TileStore) -> tuple[Exposure, set[int]] | None:
    """Return what an earlier run of the same plan found, so that its tiles and ours look alike."""
    try:
        document = json.loads((store.folder / _EXPOSURE_FILE).read_text(encoding="utf-8"))
        if document["fingerprint"] != store.fingerprint:
            return None
        gains = {int(frame): np.array(gain, dtype=np.float64) for frame, gain in document["gains"].items()}
        v0, v1 = document["vignette"]
        return Exposure(gains, (float(v0), float(v1))), set(document["unreadable"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _scratch_folder(folder: Path, fingerprint: str) -> Path:
    """Return where this plan's thumbnails lie; those of other plans are removed."""
    mine = folder / f"low-{fingerprint[:16]}"
    for other in folder.glob("low-*"):
        if other != mine:
            shutil.rmtree(other, ignore_errors=True)
    return mine


def _frame_bytes(memory_mb: int, workers: int, tile_size: int) -> int:
    """Return what is left for decoded frames when tiles in work and thumbnails have their share."""
    tiles = workers * _TILE_WORK_BYTES * max(1, (tile_size * tile_size) // 512**2)
    return max(memory_mb * 2**20 - tiles - _LOW_BAND_BYTES, memory_mb * 2**20 // 4)


@contextlib.contextmanager
def _single_threaded_opencv() -> Iterator[None]:
    """Keep OpenCV from starting threads of its own under ours: tiles are small, the threads would only wait."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
