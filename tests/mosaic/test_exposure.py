"""Gains and vignetting come back as they were put in; nothing drifts; nothing explodes."""

import numpy as np
import pytest

from photomap_gis.mosaic.exposure import MAX_GAIN, PairRatio, compare, find_exposure, overlapping_pairs, solve
from photomap_gis.mosaic.lowband import low_band_of
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.views import views_of
from tests.mosaic.flight import lawnmower


def levelled(flight):
    views = views_of(flight.trajectory)
    lows = {v.frame: low_band_of(SourceImage(flight.images[v.frame], 1.0)) for v in views}
    return views, lows, find_exposure(views, lows.__getitem__)


def disagreement(views, lows, exposure=None):
    """Median log step between overlapping frames, as seen at the seams."""
    out = []
    for a, b in overlapping_pairs(views):
        for r in compare(a, b, lows[a.frame], lows[b.frame]):
            step = r.log_ratio
            if exposure is not None:
                step = (
                    step - np.log(exposure.gains[a.frame] / exposure.gains[b.frame]) - r.vignetting @ exposure.vignette
                )
            out.append(np.abs(step).mean())
    return float(np.median(out))


def test_steps_of_exposure_are_taken_out(ground, rng):
    views, lows, exposure = levelled(lawnmower(ground, rng, gain_sigma=0.15))
    assert disagreement(views, lows, exposure) < 0.15 * disagreement(views, lows)


def test_vignetting_is_found(ground, rng):
    views, lows, exposure = levelled(lawnmower(ground, rng, vignette=0.3))
    corner, middle = (exposure.factor(views[0], np.array(r * views[0].half_diagonal_px)).mean() for r in (0.9, 0.1))
    assert corner / middle == pytest.approx(1 / (1 - 0.3 * 0.81), rel=0.08)
    assert disagreement(views, lows, exposure) < 0.4 * disagreement(views, lows)


def test_equal_frames_stay_as_they_are(ground, rng):
    _, _, exposure = levelled(lawnmower(ground, rng))
    assert np.allclose(np.stack(list(exposure.gains.values())), 1.0, atol=0.01)
    assert np.abs(exposure.vignette).max() < 0.02


def test_the_radiometry_of_the_whole_is_kept(ground, rng):
    _, _, exposure = levelled(lawnmower(ground, rng, gain_sigma=0.2))
    assert np.log(np.stack(list(exposure.gains.values()))).mean() == pytest.approx(0.0, abs=0.02)


def chain(count, step, *, wrong=()):
    log_ratio = lambda k: np.full(3, 1.5 if k in wrong else step)  # noqa: E731
    return [PairRatio(k, k + 1, log_ratio(k), np.zeros(2), 100) for k in range(count - 1)]


def test_a_small_bias_in_every_pair_does_not_add_up_along_a_flight():
    """Each frame seems 2 % brighter than the last (the sun's side of every picture): not 2 % to the 200th."""
    gains = np.stack(list(solve(range(200), chain(200, 0.02)).gains.values()))
    assert gains.max() < 1.25 and gains.min() > 0.8


def test_one_wrong_pair_does_not_shift_the_frames():
    ratios = chain(30, 0.0, wrong={15}) + [PairRatio(k, k + 2, np.zeros(3), np.zeros(2), 100) for k in range(28)]
    gains = np.stack(list(solve(range(30), ratios).gains.values()))
    assert np.allclose(gains, 1.0, atol=0.05)


def test_gains_are_bounded():
    gains = np.stack(list(solve(range(2), [PairRatio(0, 1, np.full(3, 5.0), np.zeros(2), 500)] * 400).gains.values()))
    assert gains.max() <= MAX_GAIN and gains.min() >= 1 / MAX_GAIN


def test_frames_without_overlaps_keep_their_exposure():
    exposure = solve([3, 9], [])
    assert all((g == 1).all() for g in exposure.gains.values()) and set(exposure.gains) == {3, 9}


def test_black_and_saturated_overlaps_say_nothing(ground, rng):
    flight = lawnmower(ground, rng)
    a, b = views_of(flight.trajectory)[:2]
    for level in (0, 255):
        low = low_band_of(SourceImage(np.full((180, 240), level, np.uint8), 1.0))
        assert compare(a, b, low, low_band_of(SourceImage(flight.images[b.frame], 1.0))) == []


def test_pairs_are_near_and_not_too_many(ground, rng):
    views = views_of(lawnmower(ground, rng).trajectory)
    pairs = list(overlapping_pairs(views))
    assert len(pairs) == len({(a.frame, b.frame) for a, b in pairs})
    assert all(a.frame != b.frame for a, b in pairs)
    assert len(pairs) <= 18 * len(views)
