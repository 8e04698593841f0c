"""The working image shows the plane, and says exactly where."""

import math

import cv2
import numpy as np
import pytest
from ifmi_ground import ground

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.frame import Attitude, level_rotation
from photomap_gis.ifmi import make_working


def tilted(camera: Camera, pitch_deg: float, roll_deg: float = 0.0) -> PlaneView:
    a = Attitude(0.3, math.radians(pitch_deg), math.radians(roll_deg))
    return PlaneView(camera, level_rotation(a.R_ned_camera))


@pytest.mark.parametrize(
    "shape", [(1200, 1600), (1080, 1920), (3000, 4000), (1999, 3001), (777, 1111), (600, 450), (515, 511)]
)
def test_a_rigid_view_is_shrunk_about_pixel_centres(shape):
    """A ramp keeps its values: every working pixel shows what lies where its transform says."""
    h, w = shape
    for ramp in (np.linspace(0, 255, w)[None, :].repeat(h, 0), np.linspace(0, 255, h)[:, None].repeat(w, 1)):
        image = ramp.astype(np.float64)
        work = make_working(np.rint(image).astype(np.uint8), PlaneView.flat(Camera(w, h)))
        assert max(work.grey.shape) == 512 or max(shape) < 512
        assert work.mask is None
        yy, xx = np.mgrid[0 : work.grey.shape[0] : 37, 0 : work.grey.shape[1] : 37]
        p = work.T_plane_work.apply(np.stack([xx.ravel(), yy.ravel()], 1)) + np.array([(w - 1) / 2, (h - 1) / 2])
        expected = image[
            np.clip(np.rint(p[:, 1]).astype(int), 0, h - 1), np.clip(np.rint(p[:, 0]).astype(int), 0, w - 1)
        ]
        assert np.abs(work.grey[yy.ravel(), xx.ravel()] - expected).max() < 1.3


@pytest.mark.parametrize(("pitch", "roll"), [(-90, 0), (-80, 5), (-60, -10)])
def test_a_tilted_view_shows_the_plane(rng, pitch, roll):
    g = cv2.GaussianBlur(ground(rng, 1000), (0, 0), 3.0)[:750]
    view = tilted(Camera(1000, 750, 800.0, k1=-0.05), pitch, roll)
    work = make_working(cv2.cvtColor(g, cv2.COLOR_GRAY2BGR), view)
    assert max(work.grey.shape) == 512
    yy, xx = np.mgrid[4 : work.grey.shape[0] - 4 : 23, 4 : work.grey.shape[1] - 4 : 23]
    yy, xx = yy.ravel(), xx.ravel()
    pixel = view.to_pixel(work.T_plane_work.apply(np.stack([xx, yy], 1)))
    seen = np.isfinite(pixel).all(1) & (pixel > 2).all(1) & (pixel < [997, 747]).all(1)
    mask = np.ones(work.grey.shape, bool) if work.mask is None else work.mask
    assert mask[yy[seen], xx[seen]].all()
    assert seen.mean() > 0.5
    expected = cv2.remap(g, *(pixel[seen].T.astype(np.float32)[:, None, :]), cv2.INTER_LINEAR)[0]
    assert np.median(np.abs(work.grey[yy[seen], xx[seen]].astype(float) - expected)) < 3.0


@pytest.mark.parametrize("pitch", [-20, -5, 0, 30])
def test_the_horizon_does_not_explode(rng, pitch):
    g = ground(rng, 400)
    work = make_working(g, tilted(Camera(400, 400, 500.0), pitch))
    assert max(work.grey.shape) <= 512
    assert work.mask is not None
    assert np.isfinite(work.T_plane_work.matrix).all()


def test_small_frames_are_not_enlarged_and_odd_ones_are_understood():
    assert make_working(np.zeros((90, 120), np.uint8), PlaneView.flat(Camera(120, 90))).grey.shape == (90, 120)
    assert make_working(np.zeros((90, 120, 1), np.uint8), PlaneView.flat(Camera(120, 90))).grey.shape == (90, 120)
    with pytest.raises(ValueError, match="uint8"):
        make_working(np.zeros((90, 120)), PlaneView.flat(Camera(120, 90)))
    with pytest.raises(ValueError, match="image must be"):
        make_working(np.zeros((90, 120, 2), np.uint8), PlaneView.flat(Camera(120, 90)))
