"""The grid holds every frame; the plan names every frame that a tile needs, and refuses nonsense."""

import numpy as np
import pytest

from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.mosaic import plan_grid, plan_tiles
from photomap_gis.mosaic.lattice import STEP_PX, Lattice
from photomap_gis.mosaic.light import consensus_weights
from photomap_gis.mosaic.sighting import BORDER_PX, sights_of
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import GSD_M, MAP_FRAME, place
from tests.mosaic.looking import labels_of


def random_trajectory(rng, count=20):
    statuses = rng.choice([FrameStatus.REGISTERED, FrameStatus.GPS_ONLY], count, p=[0.7, 0.3])
    return Trajectory(
        tuple(
            place(
                i, *rng.uniform(0, 250, 2), heading_rad=rng.uniform(-3, 3), scale=rng.uniform(0.7, 1.5), status=status
            )
            for i, status in enumerate(statuses)
        )
    )


def test_the_grid_covers_every_frame_at_native_sampling(rng):
    trajectory = random_trajectory(rng)
    grid = plan_grid(trajectory, MAP_FRAME, tile_size=256)
    assert grid.pixel_size == pytest.approx(trajectory.gsd_m_per_px, rel=0.1)
    west, south, east, north = grid.bounds
    for p in trajectory.placements:
        e, n = MAP_FRAME.to_crs(p.outline_xy_map_m()).T
        assert west <= e.min() and e.max() <= east and south <= n.min() and n.max() <= north
    assert (grid.tile_size, grid.crs_wkt) == (256, MAP_FRAME.crs_wkt)


def test_the_pixel_size_can_be_chosen(rng):
    assert plan_grid(random_trajectory(rng), MAP_FRAME, pixel_size=2.0).pixel_size == 2.0
    with pytest.raises(ValueError, match="pixel_size"):
        plan_grid(random_trajectory(rng), MAP_FRAME, pixel_size=-1.0)


def test_nothing_placed_is_said():
    with pytest.raises(DataError, match="nothing"):
        plan_grid(Trajectory(), MAP_FRAME)


def test_one_frame_far_away_is_named():
    trajectory = Trajectory((*(place(i, 20.0 * i, 0) for i in range(6)), place(77, 60_000.0, 40_000.0)))
    with pytest.raises(DataError, match=r"frame 77 .*--gsd"):
        plan_grid(trajectory, MAP_FRAME)


def test_a_map_of_absurd_size_is_refused():
    trajectory = Trajectory(tuple(place(i, 30.0 * i, 0) for i in range(4)))
    with pytest.raises(DataError, match="--gsd"):
        plan_grid(trajectory, MAP_FRAME, pixel_size=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_the_plan_names_all_frames_that_matter_and_few_others(seed):
    """Twin: the full weighing of all frames, pixel by pixel, as the renderer does it."""
    rng = np.random.default_rng(seed)
    trajectory = random_trajectory(rng)
    grid = plan_grid(trajectory, MAP_FRAME, tile_size=200)
    jobs = {job.tile: job for job in plan_tiles(trajectory, grid, MAP_FRAME)}
    views = views_of(trajectory)
    named = needed = 0
    for tile in grid.tiles():
        lattice = Lattice.over(grid.window(tile), grid, MAP_FRAME)
        sights = sights_of(views, lattice, grid.pixel_size)
        window = grid.window(tile)
        labels = labels_of(views, sights, lattice)[0][
            STEP_PX : STEP_PX + window.height, STEP_PX : STEP_PX + window.width
        ]
        givers = {views[i].frame for i in np.unique(labels) if i >= 0}
        on_raster = np.nan_to_num(sights[:, BORDER_PX], nan=-1.0) > 0.0
        shares = ((consensus_weights(views, sights) > 1e-3) & on_raster)[:, 2:-2, 2:-2].any(axis=(1, 2))
        sharing = {view.frame for view, has_share in zip(views, shares, strict=True) if has_share}
        job = jobs.get(tile)
        assert givers <= set(job.frames if job else ())
        assert sharing <= set(job.neighbours if job else ())
        assert job is None or set(job.frames) <= set(job.neighbours)
        named += len(job.frames) if job else 0
        needed += len(givers)
    assert named <= 1.6 * needed


def test_tiles_that_nobody_sees_get_no_job():
    trajectory = Trajectory((place(0, 0, 0), place(1, 400, 300)))
    grid = plan_grid(trajectory, MAP_FRAME, tile_size=128)
    jobs = plan_tiles(trajectory, grid, MAP_FRAME)
    assert 0 < len(jobs) < grid.tile_rows * grid.tile_cols / 3
    assert [job.tile for job in jobs] == sorted(job.tile for job in jobs)


def test_frames_outside_a_given_grid_are_no_concern():
    grid = MapGrid(None, 500_000.0, 4_000_000.0, GSD_M, 300, 300, 128)
    trajectory = Trajectory((place(0, 40, 40), place(1, 1000, 1000), place(2, -1000, 0)))
    assert {f for job in plan_tiles(trajectory, grid, MAP_FRAME) for f in job.frames} == {0}
