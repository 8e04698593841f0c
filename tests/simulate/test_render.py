"""What the rendered pixels show is what the pose's geometry says they should."""

import math

import cv2
import numpy as np
import pytest

from photomap_gis.core.camera import Camera
from photomap_gis.simulate.geodesy import utm_wkt
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.noise import fractal_noise
from photomap_gis.simulate.pose import CameraPose
from photomap_gis.simulate.render import SKY_BGR, FrameRenderer
from photomap_gis.simulate.surface import Surface

CAMERA = Camera(320, 240, 300.0)


def _ground(colour: np.ndarray, height: np.ndarray | None, pixel: float = 0.1) -> Ground:
    return Ground(colour, height, pixel, 5000.0, 9000.0, utm_wkt(50, 8))


def _textured(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    noise = fractal_noise(shape, rng, wavelength_px=20, octaves=3)
    return np.clip(120 + 40 * np.repeat(noise[..., None], 3, axis=2), 0, 255).astype(np.uint8)


def _pose(ground: Ground, height: float, **angles: float) -> CameraPose:
    full = {"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0} | angles
    return CameraPose.of_body(ground.centre_en_m, height, **full)


@pytest.mark.parametrize("camera", [CAMERA, Camera(320, 240, 300.0, k1=-0.12, k2=0.02)])
@pytest.mark.parametrize("height_field", [False, True])
def test_every_pixel_shows_the_ground_point_that_it_sees(
    rng: np.random.Generator, camera: Camera, height_field: bool
) -> None:
    colour = _textured(rng, (700, 800))
    plane = np.full((700, 800), 2.0, np.float32) if height_field else None
    ground = _ground(colour, plane)
    level = 2.0 if height_field else 0.0
    pose = _pose(ground, 30.0 + level, roll_rad=0.05, pitch_rad=-0.08, yaw_rad=0.9)
    image = FrameRenderer(ground, camera).render(pose)
    y, x = np.mgrid[0:240, 0:320]
    seen = ground.grid.to_px(pose.ground_points(camera, np.stack([x, y], -1).reshape(-1, 2), level))
    expected = cv2.remap(colour, *(seen.T.reshape(2, 240, 320).astype(np.float32)), cv2.INTER_LINEAR)
    assert np.abs(image.astype(int) - expected.astype(int)).max() <= 3


def test_a_tower_hides_what_lies_behind_it_and_leans_outward() -> None:
    colour = np.full((600, 600, 3), 40, np.uint8)
    height = np.zeros((600, 600), np.float32)
    colour[280:320, 400:440] = (0, 0, 250)  # a red roof 10 m up, to the east
    height[280:320, 400:440] = 10.0
    ground = _ground(colour, height)
    pose = _pose(ground, 40.0)
    image = FrameRenderer(ground, CAMERA).render(pose)
    red = image[..., 2] > 246  # purer than the wall, into which the roof's edge is drawn out
    e, n = ground.centre_en_m
    corners = pose.project(CAMERA, [[e + dx, n, 10.0] for dx in (10.0, 14.0)])
    ys, xs = np.nonzero(red)
    assert (xs.min(), xs.max()) == pytest.approx(tuple(corners[:, 0]), abs=2.5)
    foot = pose.project(CAMERA, [[e + 10.0, n, 0.0]])[0, 0]
    assert xs.min() > foot + 20  # the wall that faces the camera fills the gap
    assert ys.mean() == pytest.approx(119.5, abs=1.5)


def test_scaled_down_ground_does_not_move(rng: np.random.Generator) -> None:
    # far up, the frame is drawn from a coarser level: edges must stay where they were to a tenth of a pixel
    colour = _textured(rng, (1500, 1500))
    ground = _ground(colour, None, 0.05)
    camera = Camera(120, 120, 120.0)
    pose = _pose(ground, 40.0)
    image = cv2.cvtColor(FrameRenderer(ground, camera).render(pose), cv2.COLOR_BGR2GRAY).astype(np.float32)
    factor = 40.0 / 120.0 / 0.05
    soft = cv2.GaussianBlur(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), (0, 0), factor / 2).astype(np.float32)
    x, y = np.meshgrid(np.arange(120.0), np.arange(120.0))
    px = ground.grid.to_px(pose.ground_points(camera, np.stack([x, y], -1).reshape(-1, 2), 0.0)).astype(np.float32)
    expected = cv2.remap(soft, *px.T.reshape(2, 120, 120), cv2.INTER_LINEAR)
    window = cv2.createHanningWindow((120, 120), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(image - image.mean(), expected - expected.mean(), window)
    assert math.hypot(dx, dy) < 0.1


def test_rows_are_exposed_one_after_the_other(rng: np.random.Generator) -> None:
    ground = _ground(_textured(rng, (700, 800)), None)
    first, last = _pose(ground, 30.0), CameraPose.of_body(
        (ground.centre_en_m[0] + 2.0, ground.centre_en_m[1]), 30.0, roll_rad=0.02, pitch_rad=0.01, yaw_rad=0.05
    )  # fmt: skip
    renderer = FrameRenderer(ground, CAMERA)
    rolling, top, bottom = renderer.render(first, last), renderer.render(first), renderer.render(last)
    assert np.abs(rolling[0].astype(int) - top[0]).max() <= 2
    assert np.abs(rolling[-1].astype(int) - bottom[-1]).max() <= 3
    assert np.abs(rolling[120].astype(int) - top[120]).mean() > 3


def test_above_the_horizon_is_sky(rng: np.random.Generator) -> None:
    ground = _ground(_textured(rng, (700, 800)), np.zeros((700, 800), np.float32))
    image = FrameRenderer(ground, CAMERA).render(_pose(ground, 10.0, pitch_rad=math.radians(85)))
    assert tuple(image[0, 160]) == SKY_BGR
    assert tuple(image[-1, 160]) != SKY_BGR


def test_rays_meet_a_slope_where_algebra_says() -> None:
    x = np.arange(400, dtype=np.float32)
    surface = Surface(np.repeat((0.05 * x)[None], 300, axis=0))
    slopes = np.linspace(-4.0, 4.0, 128, dtype=np.float32)[None].repeat(64, axis=0)
    eye = np.full((64, 1), 200.0, np.float32), np.full((64, 1), 150.0, np.float32)
    z = surface.intersect(eye, np.full((64, 1), 40.0, np.float32), (slopes, np.zeros_like(slopes)))
    # z = 0.05 (200 + (40 - z) s)
    assert np.allclose(z, (10.0 + 2.0 * slopes) / (1.0 + 0.05 * slopes), atol=0.06)


def test_rays_meet_a_wall_before_the_land_behind_it() -> None:
    height = np.zeros((100, 300), np.float32)
    height[:, 200:210] = 8.0
    slopes = np.linspace(0.0, 7.0, 256, dtype=np.float32)[None].repeat(32, axis=0)
    eye = np.full((32, 1), 100.0, np.float32), np.full((32, 1), 50.0, np.float32)
    z = Surface(height).intersect(eye, np.full((32, 1), 30.0, np.float32), (slopes, np.zeros_like(slopes)))[0]
    s = slopes[0]
    # to the wall's foot at x = 199: 30 s < 99; over its top at x = 200: 22 s > 109 would pass behind it
    assert np.all(z[30 * s < 98] < 0.05)
    on_wall = (30 * s > 101) & (22 * s < 99)
    assert np.allclose(z[on_wall], 30 - 99.5 / s[on_wall], atol=0.4)
    on_roof = (22 * s > 101) & (22 * s < 108)
    assert np.allclose(z[on_roof], 8.0, atol=0.05)
    assert np.all(z[(22 * s > 112)] < 0.05)
