"""From what is said of a lens to a camera: every statement alone, together, and against each other."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.lenses import LensFacts, camera_for
from photomap_gis.ingest.xmp import Calibration

P4P = LensFacts("DJI", "FC6310", focal_mm=8.8, focal_35mm=24.0, full_width_px=5472, full_height_px=3648)
P4P_FOCAL = 8.8 * 5472 / 13.2


@pytest.mark.parametrize("reduction", [1, 2, 4, 8])
def test_reduced_copies_keep_the_field_of_view(reduction):
    camera = camera_for(5472 // reduction, 3648 // reduction, P4P)
    assert camera.focal_px == pytest.approx(P4P_FOCAL / reduction, rel=1e-3)
    assert camera.name == "DJI Phantom 4 Pro / Advanced"


def test_reduced_copy_whose_sizes_were_rewritten():
    """The focal plane's resolution still counts the original's pixels; the camera's own size tells."""
    for size in ((4000, 3000), (1600, 1200), (1440, 1080)):
        facts = LensFacts("Canon", "Canon PowerShot SX260 HS", focal_mm=4.5, focal_plane_px_per_mm=645.411)
        camera = camera_for(*size, facts)
        assert math.degrees(camera.hfov_rad) == pytest.approx(69.1, abs=0.3)


def test_focal_plane_resolution_of_an_unknown_camera():
    facts = LensFacts("Acme", "X", focal_mm=10.0, focal_plane_px_per_mm=400.0, full_width_px=4000, full_height_px=3000)
    for width, height in ((4000, 3000), (1000, 750)):
        camera = camera_for(width, height, facts)
        assert camera.focal_px == pytest.approx(width)
        assert camera.origin == "exif focal plane resolution"


def test_focal_plane_resolution_of_a_reduced_copy_is_not_believed():
    camera = camera_for(1600, 1200, LensFacts("Acme", "X", focal_mm=4.5, focal_plane_px_per_mm=645.4))
    assert camera.focal_px is None  # a sensor of 2.5 mm is none


def test_equivalent_refers_to_the_sensors_diagonal():
    assert camera_for(4000, 3000, LensFacts(focal_35mm=24)).focal_px == pytest.approx(24 / 43.267 * 5000)
    # cut to 16:9 from a sensor of 4:3 or 3:2: the field across the width is nearly that of the whole picture
    wide = camera_for(4000, 2250, LensFacts(focal_35mm=24))
    assert wide.focal_px == pytest.approx(24 / 43.267 * 5000, rel=0.04)
    known = camera_for(4000, 2250, LensFacts("DJI", "FC330", focal_35mm=20))
    assert known.focal_px == pytest.approx(20 / 43.267 * 7.75 * 4000 / 6.2, rel=1e-6)


def test_profile_alone():
    camera = camera_for(4000, 3000, LensFacts("DJI", "FC330"))
    assert camera.origin == "profile"
    assert math.degrees(2 * math.atan(2500 / camera.focal_px)) == pytest.approx(94, abs=1.0)


def test_a_zoom_lens_alone_is_a_guess():
    assert camera_for(4000, 3000, LensFacts("Canon", "Canon PowerShot S110")).focal_sigma_rel > 0.2


def test_nothing_known():
    camera = camera_for(4000, 3000)
    assert camera.focal_px is None
    assert camera.origin == "unknown"


def test_a_lone_contradiction_is_outvoted():
    """Calibrated focal lengths of another raster happen; the others agree."""
    wrong = Calibration(1800.0, origin="xmp calibrated focal length")
    facts = LensFacts("DJI", "FC6310", focal_mm=8.8, focal_35mm=24.0, calibrations=(wrong,))
    camera = camera_for(5472, 3648, facts)
    assert camera.focal_px == pytest.approx(P4P_FOCAL, rel=1e-3)


def test_digital_zoom_narrows():
    facts = LensFacts("DJI", "FC6310", focal_mm=8.8, digital_zoom=2.0)
    assert camera_for(5472, 3648, facts).focal_px == pytest.approx(2 * P4P_FOCAL, rel=1e-3)


def test_factory_calibration_is_used_and_scaled():
    k = (-0.2681, 0.1131, -0.0315)
    factory = Calibration(3678.0, centre_offset_xy_px=(12.0, -8.0), radial=k, origin="xmp dewarp data")
    facts = LensFacts("DJI", "FC6310R", focal_mm=8.8, full_width_px=5472, full_height_px=3648, calibrations=(factory,))
    full, half = camera_for(5472, 3648, facts), camera_for(2736, 1824, facts)
    assert (full.origin, full.focal_px) == ("xmp dewarp data", 3678.0)
    assert full.focal_sigma_rel < 0.01
    np.testing.assert_allclose(full.principal_xy_px, [2735.5 + 12, 1823.5 - 8])
    assert half.focal_px == pytest.approx(1839.0)
    np.testing.assert_allclose(half.principal_xy_px, [1367.5 + 6, 911.5 - 4])
    assert (full.k1, full.k2, full.k3) == k
    view = PlaneView.flat(full)
    corners = np.array([[0.0, 0.0], [5471.0, 3647.0], [2735.5, 1823.5]])
    np.testing.assert_allclose(view.to_pixel(view.to_plane(corners)), corners, atol=1e-3)
    # what lies beyond the fold of the polynomial is not seen, though the polynomial would say so
    assert np.isnan(view.to_pixel([[full.focal_px * 1.5, 0.0]])).all()


@pytest.mark.parametrize("size", [(8000, 6000), (4000, 3000), (2000, 1500)])
def test_a_calibration_says_which_raster_it_means(size):
    """A quad-Bayer camera calibrated at a quarter of its pixels."""
    factory = Calibration(2800.0, centre_xy_px=(2004.0, 1497.0), origin="xmp calibrated focal length")
    camera = camera_for(*size, LensFacts("DJI", "M3T", focal_mm=4.4, calibrations=(factory,)))
    assert camera.focal_px == pytest.approx(2800.0 * size[0] / 4000)
    assert camera.principal_xy_px[0] == pytest.approx((size[0] - 1) / 2 + 4.0 * size[0] / 4000, abs=0.6)


def test_sigma_covers_what_good_statements_differ_by():
    agreeing = LensFacts("DJI", "FC6310", focal_mm=8.8, focal_35mm=24.0)
    assert camera_for(5472, 3648, agreeing).focal_sigma_rel < 0.02
    differing = LensFacts("DJI", "FC6310", focal_mm=8.8, focal_35mm=26.0)
    assert camera_for(5472, 3648, differing).focal_sigma_rel > 0.03


def test_a_calibration_that_folds_the_picture_is_not_used():
    broken = Calibration(3678.0, centre_offset_xy_px=(0.0, 0.0), radial=(-2.0, 0.0, 0.0))
    camera = camera_for(5472, 3648, LensFacts("DJI", "FC6310", focal_mm=8.8, calibrations=(broken,)))
    assert not camera.is_distorted


def test_the_users_word_is_first():
    camera = camera_for(4000, 3000, P4P, hfov_deg=60.0)
    assert math.degrees(camera.hfov_rad) == pytest.approx(60.0)
    assert camera.origin == "option"
    assert camera_for(4000, 3000, focal_35mm=24.0).focal_px == pytest.approx(24 / 43.267 * 5000)
    for nonsense in (0.0, 180.0, math.nan, -5.0):
        with pytest.raises(UsageError, match="field of view"):
            camera_for(4000, 3000, hfov_deg=nonsense)
    with pytest.raises(UsageError, match="35 mm equivalent"):
        camera_for(4000, 3000, focal_35mm=0.0)


def test_a_video_may_be_a_crop():
    assert camera_for(3840, 2160, P4P, is_video=True).focal_sigma_rel > camera_for(3840, 2160, P4P).focal_sigma_rel


@given(
    st.integers(1, 20_000),
    st.integers(1, 20_000),
    st.floats(0.5, 3000.0) | st.none(),
    st.floats(3.0, 6000.0) | st.none(),
    st.floats(10.0, 5000.0) | st.none(),
    st.sampled_from(["", "FC6310", "M3T", "Canon PowerShot S110", "HERO4 Black"]),
)
def test_any_facts_give_a_camera(width, height, focal, equivalent, density, model):
    facts = LensFacts("", model, focal_mm=focal, focal_35mm=equivalent, focal_plane_px_per_mm=density)
    camera = camera_for(width, height, facts)
    assert isinstance(camera, Camera)
    assert camera.focal_px is None or (math.isfinite(camera.focal_px) and camera.focal_px > 0)
    assert camera.focal_sigma_rel > 0
