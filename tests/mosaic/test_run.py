"""A whole map: made in threads and bounded memory, resumed after a kill, whole without the frames that are missing."""

import logging
import threading

import numpy as np
import pytest

from photomap_gis.core.errors import DataError, FrameReadError
from photomap_gis.core.grid import Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import TileStore, plan_grid, plan_tiles, render_mosaic
from photomap_gis.mosaic.pixels import LruCache
from tests.mosaic.flight import GSD_M, MAP_FRAME, lawnmower, place


@pytest.fixture(scope="module")
def flight(ground):
    return lawnmower(ground, np.random.default_rng(11), gain_sigma=0.1)


@pytest.fixture(scope="module")
def grid(flight):
    return plan_grid(flight.trajectory, MAP_FRAME, pixel_size=GSD_M, tile_size=128)


def render(flight, grid, folder, read=None, **kw):
    return render_mosaic(flight.trajectory, MAP_FRAME, grid, read or flight.read, folder, revision=1, **kw)


def whole(store: TileSource):
    return store.read(Window(0, 0, store.grid.width, store.grid.height))


@pytest.fixture(scope="module")
def reference(flight, grid, tmp_path_factory):
    return whole(render(flight, grid, tmp_path_factory.mktemp("reference"), workers=1))


def test_the_map_is_the_ground(flight, grid, reference):
    seen = reference[..., 3] == 255
    assert seen.sum() >= 0.999 * flight.seen(grid).sum()
    error = np.log(np.maximum(reference[seen][:, :3], 1.0)) - np.log(np.maximum(flight.truth(grid)[seen], 1.0))
    assert np.median(np.abs(error - np.median(error, axis=0))) < 0.05


def test_threads_change_nothing(flight, grid, reference, tmp_path):
    assert np.array_equal(whole(render(flight, grid, tmp_path, workers=3)), reference)


def test_progress_ends_where_it_said(flight, grid, tmp_path):
    seen = []
    render(flight, grid, tmp_path, on_progress=lambda done, total: seen.append((done, total)))
    done, totals = zip(*seen, strict=True)
    assert list(done) == list(range(1, len(seen) + 1)) and set(totals) == {len(seen)}


def test_a_killed_run_goes_on_and_the_map_is_the_same(flight, grid, reference, tmp_path):
    def stop(done, total):
        if done > total - 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(flight, grid, tmp_path, on_progress=stop, workers=2)
    half = TileStore(tmp_path)
    jobs = plan_tiles(flight.trajectory, grid, MAP_FRAME)
    finished = {job.tile for job in jobs if half.done(job.tile)}
    assert 0 < len(finished) < len(jobs)
    stamps = {p: p.stat().st_mtime_ns for p in tmp_path.glob("*/*.png")}

    reads = []
    store = render(flight, grid, tmp_path, read=lambda f: reads.append(f) or flight.read(f))
    assert np.array_equal(whole(store), reference)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())
    assert set(reads) <= {f for job in jobs if job.tile not in finished for f in job.neighbours}


def test_a_finished_map_is_not_rendered_again(flight, grid, tmp_path):
    render(flight, grid, tmp_path)
    render(flight, grid, tmp_path, read=lambda _: pytest.fail("a frame was opened"))
    assert not list(tmp_path.glob("low-*"))


def test_another_solution_is_rendered_anew(flight, grid, tmp_path):
    render(flight, grid, tmp_path)
    moved = [place(p.frame, *(p.centre_xy_map_m + 1.0)) for p in flight.placements]
    reads = set()
    read = lambda f: reads.add(f) or flight.read(f)  # noqa: E731
    store = render_mosaic(Trajectory(tuple(moved), 2), MAP_FRAME, grid, read, tmp_path, revision=2)
    assert reads and store.revision == 2


def test_unreadable_frames_are_left_out_and_logged(flight, grid, reference, tmp_path, caplog):
    def read(frame):
        if frame in (3, 8):
            raise FrameReadError(f"{frame}.jpg is cut off")
        return flight.read(frame)

    with caplog.at_level(logging.WARNING):
        store = render(flight, grid, tmp_path, read=read)
    assert [r.args[0] for r in caplog.records if "left out" in r.msg] == [3, 8]
    rest = Trajectory(tuple(p for p in flight.placements if p.frame not in (3, 8)), 1)
    got = whole(store)
    expected = type(flight)(flight.ground, list(rest.placements), flight.images).seen(grid)
    assert ((got[..., 3] == 255) != expected).mean() < 1e-3


def test_a_frame_that_fails_only_later_is_left_out_of_the_tiles(flight, grid, tmp_path):
    reads = dict.fromkeys(flight.images, 0)

    def read(frame):
        reads[frame] += 1
        if frame == 4 and reads[frame] > 1:
            raise FrameReadError("the card was pulled")
        return flight.read(frame)

    store = render(flight, grid, tmp_path, read=read, memory_mb=1)
    assert all(store.done(job.tile) for job in plan_tiles(flight.trajectory, grid, MAP_FRAME))


def test_when_the_first_of_a_hovering_crowd_cannot_be_read_another_stands_in(ground, tmp_path):
    base = lawnmower(ground, np.random.default_rng(5))
    p = base.placements[0]
    crowd = [place(i, *p.centre_xy_map_m) for i in range(5)]
    image = base.images[p.frame]

    def read(frame):
        if frame < 3:
            raise FrameReadError("unreadable")
        return image

    trajectory = Trajectory(tuple(crowd), 1)
    grid = plan_grid(trajectory, MAP_FRAME)
    store = render_mosaic(trajectory, MAP_FRAME, grid, read, tmp_path, revision=1)
    assert (whole(store)[..., 3] == 255).mean() > 0.95


def test_nothing_readable_is_an_error(flight, grid, tmp_path):
    def read(frame):
        raise FrameReadError("no such file")

    with pytest.raises(DataError, match="none of the frames"):
        render(flight, grid, tmp_path, read=read)


def test_other_failures_are_not_hidden(flight, grid, tmp_path):
    def read(frame):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        render(flight, grid, tmp_path, read=read)


def test_memory_for_frames_is_bounded(flight, grid, tmp_path, monkeypatch):
    most = 0
    lock = threading.Lock()
    get = LruCache.get

    def watched(self, key):
        nonlocal most
        value = get(self, key)
        with lock:
            most = max(most, self.held_bytes)
        return value

    monkeypatch.setattr(LruCache, "get", watched)
    monkeypatch.setattr("photomap_gis.mosaic.run._LOW_BAND_BYTES", 2**17)
    render(flight, grid, tmp_path, memory_mb=1, workers=2)
    one = 240 * 180 * 3
    assert most <= max(2**18, 2 * one) + one


def test_a_relative_map_needs_no_place_on_earth(flight, tmp_path):
    frame = type(MAP_FRAME)(None)
    grid = plan_grid(flight.trajectory, frame, tile_size=256)
    assert grid.crs_wkt is None
    store = render_mosaic(flight.trajectory, frame, grid, flight.read, tmp_path, revision=1)
    assert (whole(store)[..., 3] == 255).any()
