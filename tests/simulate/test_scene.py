"""The scene that ships as code: rich, asymmetric, the same for the same seed."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio

from photomap_gis.simulate import FlightSpec, Ground, procedural_scene, simulate_photos
from photomap_gis.simulate.evaluate import raised_mask
from photomap_gis.simulate.ideal import write_ideal_map
from photomap_gis.simulate.scene import orientation_scene


@pytest.fixture(scope="module")
def scene() -> Ground:
    return procedural_scene((160.0, 120.0), 0.2, seed=3)


def test_the_same_seed_gives_the_same_scene(scene: Ground) -> None:
    again, other = (procedural_scene((160.0, 120.0), 0.2, seed=s) for s in (3, 4))
    assert np.array_equal(scene.colour, again.colour)
    assert np.array_equal(scene.height_m, again.height_m)
    assert not np.array_equal(scene.colour, other.colour)


def test_sizes_and_place(scene: Ground) -> None:
    assert scene.colour.shape == (600, 800, 3)
    assert scene.size_m == pytest.approx((160.0, 120.0))
    assert scene.west == round(scene.west)
    assert "UTM zone 32N" in scene.crs_wkt


def test_houses_trees_and_rubble_stand_on_sloping_land(scene: Ground) -> None:
    assert scene.height_m is not None
    mask = raised_mask(scene.height_m, scene.pixel_size_m)
    assert 0.03 < mask.mean() < 0.5
    land = scene.height_m[~mask]
    assert 0.2 < np.ptp(land) < 4.0
    assert 3.0 < scene.height_m.max() - np.median(land) < 14.0


def test_nothing_mirrors_or_repeats(scene: Ground) -> None:
    grey = scene.colour.mean(axis=2)
    grey = grey - grey.mean()

    def likeness(other: np.ndarray) -> float:
        return float(np.mean(grey[: other.shape[0], : other.shape[1]] * other) / (grey.std() * other.std()))

    assert max(abs(likeness(v)) for v in (grey[::-1], grey[:, ::-1], grey[::-1, ::-1])) < 0.3
    # the autocorrelation has one peak: away from it nothing comes near
    spectrum = np.abs(np.fft.rfft2(grey)) ** 2
    correlation = np.fft.fftshift(np.fft.irfft2(spectrum, s=grey.shape))
    correlation /= correlation.max()
    h, w = correlation.shape
    correlation[h // 2 - 60 : h // 2 + 60, w // 2 - 60 : w // 2 + 60] = 0
    assert correlation.max() < 0.35


def test_a_scene_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 10 m"):
        procedural_scene((5.0, 5.0), 0.1)


def test_the_orientation_scene_knows_where_its_marks_are() -> None:
    scene = orientation_scene((80.0, 70.0), 0.2)
    g = scene.ground
    for _, easting, northing, bgr in scene.marks:
        x, y = np.round(g.grid.to_px([[easting, northing]])[0]).astype(int)
        assert tuple(g.colour[y, x]) == bgr
    east = {name: e - g.centre_en_m[0] for name, e, _, _ in scene.marks}
    north = {name: n - g.centre_en_m[1] for name, _, n, _ in scene.marks}
    assert east["red"] < 0 < east["green"]
    assert north["blue"] < 0 < north["red"]


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0])
def test_at_four_headings_nothing_is_mirrored_or_turned(heading: float, tmp_path: Path) -> None:
    scene = orientation_scene((90.0, 80.0), 0.2)
    spec = FlightSpec(frames=6, width_px=300, height_px=220, headings_deg=(heading,), nose_follows_track=False)
    truth = simulate_photos(scene.ground, spec, tmp_path)
    write_ideal_map(truth, lambda f: cv2.imread(str(tmp_path / "photos" / f.name)), tmp_path / "map.tif")
    with rasterio.open(tmp_path / "map.tif") as written:
        rgba = written.read()
        seen = 0
        for name, easting, northing, bgr in scene.marks:
            row, col = written.index(easting, northing)
            if not (0 <= row < written.height and 0 <= col < written.width and rgba[3, row, col]):
                continue
            seen += 1
            assert np.abs(rgba[2::-1, row, col].astype(int) - bgr).max() < 70, name
    assert seen >= 3
