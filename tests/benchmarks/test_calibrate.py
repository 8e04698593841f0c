"""The weights of the covariance are found again where errors are drawn from it."""

import numpy as np
import pytest

from benchmarks.registration import calibrate
from photomap_gis.ifmi.uncertainty import Spread, Weights


def test_the_scale_of_the_noise_is_found_again(rng, monkeypatch):
    monkeypatch.setattr(calibrate, "FIT_STEPS", 250)
    truth = Weights(noise=1.5)
    errors = []
    for _ in range(300):
        sigma = rng.uniform(0.5, 2.0)
        spread = Spread(
            noise=np.diag([1e-2, 1e-2, 1e-6, 1e-6]) * sigma**2,
            shape=np.diag([1.0, 1.0, 1e-4, 1e-4]) / 100.0,
            scatter2_px2=0.0,
            pull=np.zeros(4),
            outliers=0.0,
            baseline_px=30.0,
            bend2_px2=0.0,
            blocks=100,
            overlap=1.0,
        )
        errors.append((spread, rng.multivariate_normal(np.zeros(4), spread.covariance(truth))))
    assert calibrate.fit_weights([errors]).noise == pytest.approx(1.5, rel=0.15)
