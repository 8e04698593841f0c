"""Components laid on their fixes."""

from __future__ import annotations

import numpy as np
import pytest

from photomap_gis.slam.anchor import _medians


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (8,), (5, 9), (4, 12)])
def test_medians_are_numpys(shape):
    values = np.random.default_rng(3).normal(size=shape)
    assert np.allclose(_medians(values), np.median(values, axis=-1), rtol=0, atol=0)
