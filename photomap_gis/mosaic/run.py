"""Render a whole map: plan, level the exposure, then tile after tile into a store, in threads and bounded memory."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import math
import pickle
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import CrsFrame, MapGrid, ground_pixel_m
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic.exposure import Exposure, find_exposure
from photomap_gis.mosaic.lowband import LowBand, LowBandStore
from photomap_gis.mosaic.measured import Measured, keep_measured, load_measured
from photomap_gis.mosaic.order import in_best_order
from photomap_gis.mosaic.pixels import LruCache, SourceImage, check_pixels, prepare
from photomap_gis.mosaic.plan import TileJob, plan_jobs
from photomap_gis.mosaic.preference import Prefer, costs_of_age, costs_of_detail, detail_m
from photomap_gis.mosaic.render import RenderedTile, render_tile_and_sources
from photomap_gis.mosaic.sharpness import blur_of
from photomap_gis.mosaic.tiles import TileStore, write_atomically
from photomap_gis.mosaic.views import View, all_views_of, views_of
from photomap_gis.parallel import give_back_memory, map_jobs, usable_cpus

logger = logging.getLogger(__name__)

ReadPixels = Callable[[int], ImageArray]
Progress = Callable[[int, int], None]
Value = TypeVar("Value")

RECIPE = "4"
"""Changes whenever the same placements would give other pixels: tiles of an older recipe are rendered anew."""

_TILE_WORK_BYTES = 80 << 20  # arrays of a tile, and what the allocator keeps of them for each thread
_TILES_BETWEEN_TRIMS = 16
_LOW_BAND_BYTES = 24 << 20  # some 400 frames': far more than have to do with a tile


def render_mosaic(
    trajectory: Trajectory,
    map_frame: CrsFrame,
    grid: MapGrid,
    read_pixels: ReadPixels,
    folder: Path,
    *,
    revision: int,
    prefer: Prefer = Prefer.NADIR,
    times_s: Mapping[int, float | None] = MappingProxyType({}),
    workers: int | None = None,
    scheduler: str | None = None,
    memory_mb: int = 512,
    on_progress: Progress | None = None,
) -> TileStore:
    """Render the map of ``trajectory`` into ``folder`` and return its store.

    ``prefer`` says which of several frames is shown; ``times_s`` are the frames' times, which ``NEWEST`` goes by.

    ``read_pixels(frame)`` returns a frame's BGR or grey raster and is called from several threads; a frame for which it
    raises ``FrameReadError`` is left out and logged. Tiles that a killed run of the same plan left are kept. About
    ``memory_mb`` are used whatever the map's size, more only where single frames are larger than that.
    ``on_progress(done, total)`` counts frames levelled and tiles rendered.

    With a ``scheduler`` the tiles are rendered by its workers, which open the frames and write the tiles themselves:
    ``folder`` and what ``read_pixels`` reads must be the same paths there, and ``read_pixels`` picklable.
    """
    wish = _Wish(prefer, costs_of_age({p.frame: times_s.get(p.frame) for p in trajectory.placements}))
    fingerprint = fingerprint_of(views_of(trajectory, wish.known_costs), map_frame, prefer)
    store = TileStore.create(folder, grid, revision=revision, fingerprint=fingerprint)
    scratch = _scratch_folder(store.folder, fingerprint)
    workers = workers or usable_cpus()
    limit_bytes = _frame_bytes(memory_mb, workers, grid.tile_size)
    frames = _Frames(trajectory, ground_pixel_m(grid, map_frame), read_pixels, scratch, limit_bytes)
    with _single_threaded_opencv():
        plan = _plan_readable(trajectory, map_frame, store, frames, wish, workers=workers, on_progress=on_progress)
        todo = in_best_order(plan.todo, frames_in_memory=frames.capacity)
        done, total = plan.levelled + plan.finished, plan.levelled + plan.finished + len(todo)

        def render(job: TileJob) -> None:
            tile = _render_readable(job, plan, grid, map_frame, frames)
            store.write(job.tile, tile.rgba, tile.source)

        if scheduler is None:
            rendered = map_jobs(render, todo, workers=workers)
        else:
            work = TileWork(trajectory, map_frame, store.folder, plan, read_pixels, scratch, limit_bytes,
                            frozenset(frames.unreadable))  # fmt: skip
            rendered = map_jobs(partial(render_there, *work.keep(scratch)), todo, scheduler=scheduler)
        give_back_memory()
        for _ in rendered:
            done += 1
            if done % _TILES_BETWEEN_TRIMS == 0:
                give_back_memory()  # frames come and go in all threads: what they leave free does not fit the next
            if on_progress is not None:
                on_progress(done, total)
    shutil.rmtree(scratch, ignore_errors=True)
    frames.clear()
    give_back_memory()
    return store


@dataclass(frozen=True, slots=True, eq=False)
class TileWork:
    """All that a worker on another machine needs to render tiles of a plan, but the frames' pixels."""

    trajectory: Trajectory
    map_frame: CrsFrame
    folder: Path
    plan: _Plan
    read_pixels: ReadPixels
    scratch: Path
    limit_bytes: int
    unreadable: frozenset[int]

    def keep(self, folder: Path) -> tuple[Path, str]:
        """Write it beside the tiles, once for all jobs; return its path and its digest."""
        data = pickle.dumps(self)
        path = folder / "work.pickle"
        write_atomically(path, data)
        return path.absolute(), hashlib.sha256(data).hexdigest()


def render_there(path: Path, digest: str, job: TileJob) -> None:
    """Render a tile on the machine where this is called, and write it into the store whole or not at all."""
    work, store, frames = _workshop(path, digest)
    with _single_threaded_opencv():
        tile = _render_readable(job, work.plan, store.grid, work.map_frame, frames)
    store.write(job.tile, tile.rgba, tile.source)


@lru_cache(maxsize=1)
def _workshop(path: Path, digest: str) -> tuple[TileWork, TileStore, _Frames]:
    """Open what ``TileWork.keep`` wrote; the frames that a worker has decoded stay with it from job to job."""
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:  # never unpickle what the job does not vouch for
        raise DataError(f"{path} is not what the job was made with: do the machines share the mission's folder?")
    work: TileWork = pickle.loads(data)
    store = TileStore(work.folder)
    pixel_m = ground_pixel_m(store.grid, work.map_frame)
    frames = _Frames(work.trajectory, pixel_m, work.read_pixels, work.scratch, work.limit_bytes)
    frames.unreadable.update(work.unreadable)
    return work, store, frames


def fingerprint_of(views: Sequence[View], map_frame: CrsFrame, prefer: Prefer = Prefer.NADIR) -> str:
    """Return a digest of all that decides what the tiles of a grid show, but the frames' pixels."""
    digest = hashlib.sha256(f"{RECIPE} {prefer} {map_frame!r}".encode())
    for view in views:
        placement = view.placement
        size = np.array([placement.width_px, placement.height_px])
        probe_px = np.stack(np.meshgrid(*(np.linspace(0.0, side - 1.0, 4) for side in size)), axis=-1).reshape(-1, 2)
        xy_mm = np.rint(placement.camera_to_map.project(probe_px) * 1000.0 / max(view.gsd_m_per_px, 1e-9))
        digest.update(f"{view.frame} {view.tier} {size} {view.preference_cost:.4f}".encode())
        digest.update(np.nan_to_num(xy_mm).tobytes())
    return digest.hexdigest()


class _Wish(NamedTuple):
    """What the user prefers, and what each frame's age costs if that is the newest."""

    prefer: Prefer
    age_costs: Mapping[int, float]

    @property
    def known_costs(self) -> Mapping[int, float]:
        """What is known of the frames' costs before any is opened."""
        return self.age_costs if self.prefer is Prefer.NEWEST else {}

    def costs(self, views: Sequence[View], blur_px: Mapping[int, float]) -> Mapping[int, float]:
        """Return the frames' costs, their blur known."""
        if self.prefer is not Prefer.SHARP:
            return self.known_costs
        return costs_of_detail({v.frame: detail_m(v.gsd_m_per_px, blur_px.get(v.frame, math.nan)) for v in views})


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
        self, trajectory: Trajectory, pixel_m: float, read_pixels: ReadPixels, scratch: Path, limit_bytes: int
    ) -> None:
        self._placements = {p.frame: p for p in trajectory.placements}
        self._pixel_m, self._read = pixel_m, read_pixels
        self._images: LruCache[int, SourceImage] = LruCache(self._load, lambda source: source.image.nbytes, limit_bytes)
        self._lows = LowBandStore(
            scratch, self._images.get, limit_bytes=_LOW_BAND_BYTES, blur_of_opened=lambda frame: self.blur_px[frame]
        )
        self.blur_px: dict[int, float] = {}
        self.unreadable: set[int] = set()
        sizes = [p.width_px * p.height_px * 3 for p in trajectory.placements]
        self.capacity = max(1, limit_bytes // max(1, *sizes, 1))

    def clear(self) -> None:
        """Drop all pixels."""
        self._images.clear()
        self._lows.clear()

    def image(self, view: View) -> SourceImage:
        """Return the frame's pixels, prepared for the grid."""
        return self._noting_failure(self._images.get, view.frame)

    def low_band(self, view: View) -> LowBand:
        """Return the frame's low frequencies."""
        return self._noting_failure(self._lows.get, view.frame)

    def try_to_level(self, view: View) -> View:
        """Have the frame's low frequencies made and its blur known; a failure is noted in ``unreadable``."""
        with contextlib.suppress(FrameReadError):
            self.blur_px[view.frame] = self.low_band(view).blur_px
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
        if frame not in self.blur_px:
            self.blur_px[frame] = blur_of(image)
        return prepare(image, self._pixel_m / placement.gsd_m_per_px)


def _plan_readable(
    trajectory: Trajectory,
    map_frame: CrsFrame,
    store: TileStore,
    frames: _Frames,
    wish: _Wish,
    *,
    workers: int,
    on_progress: Progress | None,
) -> _Plan:
    """Plan the tiles that are missing, with readable frames only, and find the frames' exposure."""
    kept = load_measured(store)
    if kept is not None:
        frames.unreadable.update(kept.unreadable)
        frames.blur_px.update(kept.blur_px)
    levelled: set[int] = set()

    def level(missing: Sequence[View], jobs: int) -> None:
        total = len(levelled) + len(missing) + jobs
        for view in map_jobs(frames.try_to_level, missing, workers=workers):
            levelled.add(view.frame)
            if on_progress is not None:
                on_progress(len(levelled), total)

    while True:
        readable = Trajectory(
            tuple(p for p in trajectory.placements if p.frame not in frames.unreadable), trajectory.revision
        )
        seeing = all_views_of(readable)
        if wish.prefer is Prefer.SHARP and kept is None:  # which frames are needed hangs on how sharp each is
            level([v for v in seeing if v.frame not in levelled], sum(1 for _ in store.grid.tiles()))
            seeing = [v for v in seeing if v.frame not in frames.unreadable]
        views = {view.frame: view for view in views_of(readable, wish.costs(seeing, frames.blur_px))}
        views = {f: v for f, v in views.items() if f not in frames.unreadable}
        jobs = list(plan_jobs(list(views.values()), store.grid, map_frame))
        todo = [job for job in jobs if not store.done(job.tile)]
        needed = sorted({frame for job in (jobs if kept is None else todo) for frame in job.neighbours} - levelled)
        if not todo or not needed:
            break
        level([views[frame] for frame in needed], len(jobs))
        if not frames.unreadable.intersection(needed):
            break
    if not views:
        raise DataError(
            "none of the frames could be read: see the warnings above; are the photos still where they were?"
        )
    if not todo:
        exposure = Exposure({})
    elif kept is not None:
        exposure = kept.exposure
    else:
        exposure = find_exposure(
            [views[frame] for frame in sorted(levelled & views.keys())], lambda f: frames.low_band(views[f])
        )
        keep_measured(store, Measured(exposure, dict(frames.blur_px), frozenset(frames.unreadable)))
    return _Plan(views, todo, exposure, len(jobs) - len(todo), len(levelled))


def _render_readable(job: TileJob, plan: _Plan, grid: MapGrid, map_frame: CrsFrame, frames: _Frames) -> RenderedTile:
    """Return the tile, without frames that turn out to be unreadable now."""
    while True:
        missing = set(frames.unreadable)
        try:
            return render_tile_and_sources(
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
