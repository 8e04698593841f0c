"""The statistics that the noise claims."""

import numpy as np
import pytest

from photomap_gis.simulate.noise import fractal_noise, gauss_markov, smooth_process


@pytest.mark.parametrize("octaves", [1, 5])
def test_fractal_noise_has_unit_sigma_and_no_mean(rng: np.random.Generator, octaves: int) -> None:
    field = fractal_noise((700, 900), rng, wavelength_px=30.0, octaves=octaves)
    assert field.dtype == np.float32
    assert field.std() == pytest.approx(1.0, abs=0.12)
    assert abs(field.mean()) < 0.15


def test_fractal_noise_is_smooth_at_its_wavelength(rng: np.random.Generator) -> None:
    field = fractal_noise((600, 600), rng, wavelength_px=100.0, octaves=1)
    assert np.abs(np.diff(field, axis=1)).max() < 0.15


def test_gauss_markov_has_the_sigma_and_the_correlation_asked_for(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 60_000.0, 2.0)
    x = gauss_markov(t, sigma=2.0, tau_s=60.0, rng=rng)
    assert x.std() == pytest.approx(2.0, rel=0.12)
    assert np.corrcoef(x[:-30], x[30:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.1)


def test_gauss_markov_without_time_constant_is_white(rng: np.random.Generator) -> None:
    x = gauss_markov(np.arange(5000.0), sigma=1.0, tau_s=0.0, rng=rng)
    assert abs(np.corrcoef(x[:-1], x[1:])[0, 1]) < 0.05


def test_smooth_process_moves_without_jumps(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 4000.0, 0.05)
    x = smooth_process(t, sigma=1.0, tau_s=2.0, rng=rng)
    assert x.std() == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.diff(x)).max() < 0.3


def test_no_sigma_is_silence(rng: np.random.Generator) -> None:
    t = np.arange(10.0)
    assert not gauss_markov(t, sigma=0.0, tau_s=5.0, rng=rng).any()
    assert not smooth_process(t, sigma=0.0, tau_s=5.0, rng=rng).any()
