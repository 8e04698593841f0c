"""The lattice tells every pixel where it lies in a frame, to a few hundredths of a pixel."""

import math

import numpy as np
import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.mosaic.lattice import STEP_PX, Box, Lattice
from tests.mosaic.flight import GSD_M, MAP_FRAME, place

GRID = MapGrid("a CRS", 499_980.0, 4_000_020.0, GSD_M, 160, 160, 512)


def worst_error_px(placement, window: Window) -> float:
    lattice = Lattice.over(window, GRID, MAP_FRAME)
    nodes = placement.camera_to_map.unproject(lattice.nodes_xy_map_m).reshape(*lattice.shape, 2)
    box = Box(STEP_PX, STEP_PX, window.width, window.height)
    got = lattice.dense(nodes.astype(np.float32), box)
    px = np.stack(
        np.meshgrid(window.col_off + np.arange(window.width), window.row_off + np.arange(window.height)), axis=-1
    )
    xy = MAP_FRAME.from_crs(GRID.to_crs(px.reshape(-1, 2)))
    exact = placement.camera_to_map.unproject(xy).reshape(got.shape)
    return float(np.abs(got - exact).max())


@pytest.mark.parametrize("window", [Window(0, 0, 160, 160), Window(13, 57, 31, 18), Window(100, 3, 1, 1)])
@pytest.mark.parametrize(
    ("camera", "tilt_deg", "tolerance_px"),
    [
        (None, (0, 0), 2e-4),
        (Camera.of_hfov(240, 180, math.radians(60)), (10, -8), 0.05),
        (Camera(240, 180, focal_px=220.0, k1=-0.12, k2=0.03), (3, 2), 0.05),
    ],
)
def test_dense_coordinates_are_those_of_the_camera(window, camera, tilt_deg, tolerance_px):
    placement = place(0, 3.0, 2.0, heading_rad=0.7, camera=camera, tilt_rad=tuple(np.radians(tilt_deg)))
    assert worst_error_px(placement, window) < tolerance_px


def test_a_box_is_a_part_of_the_whole(rng):
    lattice = Lattice.over(Window(0, 0, 100, 70), GRID, MAP_FRAME)
    values = rng.normal(size=(*lattice.shape, 3)).astype(np.float32)
    whole = lattice.dense(values)
    assert whole.shape == (lattice.height, lattice.width, 3)
    for box in (Box(0, 0, 1, 1), Box(7, 9, 50, 30), Box(lattice.width - 3, lattice.height - 2, 3, 2), lattice.domain):
        assert np.allclose(lattice.dense(values, box), whole[box.slices], atol=1e-5)
