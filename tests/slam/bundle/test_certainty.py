"""How sure a pixel is: what cameras and ground do together moves none, and what is left is held by the errors."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import make_world

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import PosedPlacement
from photomap_gis.slam.bundle import bundle_adjust
from photomap_gis.slam.bundle.certainty import PIXELS, Surface, _alike
from photomap_gis.slam.bundle.problem import exp_rotation

CAMERA = Camera(1600, 1200, 1200.0, k1=-0.02)


def pixels() -> np.ndarray:
    x, y = ((np.arange(PIXELS) + 0.5) / PIXELS * side - 0.5 for side in (1600, 1200))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def placement(centre, R, ground, camera=CAMERA, step=None):
    if step is not None:
        centre, R = centre + step[:3], exp_rotation(step[None, 3:])[0] @ R
    return PosedPlacement(camera, centre * (1, 1, -1), R, ground)


@pytest.fixture
def posed(rng):
    centre = np.array([12.0, -7.0, -90.0])
    return centre, exp_rotation(rng.normal(0, 0.1, (1, 3)))[0], Surface(np.array([0.0, 0.0]), 60.0)


@pytest.mark.parametrize("bend", range(3))
def test_a_ground_that_rises_or_slopes_is_the_pose_that_moves_pixels_alike(posed, bend):
    """Of level and slopes that is exact: the world is but moved and turned."""
    centre, R, surface = posed
    alike = _alike(CAMERA, centre[None], R[None], HeightField.level(), surface, 0, 1)[0][:, 2 + bend]
    h, xy = 1e-4, pixels()
    corner = np.array([[-600.0, -600.0], [600.0, -600.0], [-600.0, 600.0], [600.0, 600.0]])
    up = -h * surface.bends(corner)[:, bend].reshape(2, 2)
    still = placement(centre, R, HeightField.level())
    by_ground = placement(centre, R, HeightField((-600.0, -600.0), 1200.0, up)).project(xy) - still.project(xy)
    by_pose = placement(centre, R, HeightField.level(), step=h * alike).project(xy) - still.project(xy)
    assert np.abs(by_ground).max() > 0.05 * h
    assert by_pose == pytest.approx(by_ground, abs=0.02 * np.abs(by_ground).max())


def test_another_focal_length_is_another_height(posed):
    centre, R, surface = posed
    alike = _alike(CAMERA, centre[None], R[None], HeightField.level(), surface, 0, 1)[0][:, 0]
    h, xy = 1e-5, pixels()
    still = placement(centre, R, HeightField.level()).project(xy)
    longer = replace(CAMERA, focal_px=1200.0 * np.exp(h))
    by_lens = placement(centre, R, HeightField.level(), camera=longer).project(xy) - still
    by_pose = placement(centre, R, HeightField.level(), step=h * alike).project(xy) - still
    assert by_pose == pytest.approx(by_lens, abs=0.1 * np.abs(by_lens).max())


def test_what_cameras_and_ground_do_together_moves_no_pixel(rng):
    """Nobody knows how level this flight's world is: its cameras do not know how high they are, but its map holds."""
    world = make_world(rng, relief=2.0)
    bundle = bundle_adjust(world.problem, joint=True)
    xy = pixels()
    spread = []
    for covariance in (bundle.covariance, bundle.over_ground):
        corner = [
            placement(c, R, bundle.ground).position_covariance(xy, covariance[k])[0]
            for k, (c, R) in enumerate(zip(bundle.centre, bundle.R_map_camera, strict=True))
        ]
        spread.append(np.sqrt(np.mean(np.trace(np.array(corner), axis1=1, axis2=2))))
    assert spread[1] < spread[0], "corners of frames are surer than their cameras' heights would have it"
    n = len(bundle.centre)
    for joint, own in ((bundle.joint, bundle.covariance), (bundle.joint_over_ground, bundle.over_ground)):
        for k in range(n):
            assert joint[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] == pytest.approx(own[k], rel=1e-5, abs=1e-10)
        assert np.linalg.eigvalsh(joint).min() > -1e-9 * np.linalg.eigvalsh(joint).max()


def test_predicted_sigmas_of_pixels_are_those_of_their_errors():
    """NEES of what frames show, GPS and all, pooled over several worlds."""
    nees = []
    for seed in range(8):
        world = make_world(np.random.default_rng(200 + seed), strips=3, a_strip=5, relief=1.0)
        bundle, xy = bundle_adjust(world.problem), pixels()
        for k, (c, R) in enumerate(zip(bundle.centre, bundle.R_map_camera, strict=True)):
            found = placement(c, R, bundle.ground, camera=bundle.lenses[0].camera)
            truth = placement(world.centre[k], world.R[k], world.ground, camera=world.camera)
            off = found.project(xy) - truth.project(xy)
            claimed = found.position_covariance(xy, bundle.over_ground[k])
            nees.append(np.einsum("ni,ni->n", off, np.linalg.solve(claimed, off[:, :, None])[:, :, 0]) / 2.0)
    assert 0.3 < np.mean(nees) < 1.6
