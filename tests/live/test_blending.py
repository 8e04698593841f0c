"""The canvas's inner loop against NumPy, pixel for pixel."""

from __future__ import annotations

import numpy as np
import pytest

from photomap_gis.live.blending import DRAWN, FEATHER, LAID, blend_pixels
from photomap_gis.live.canvas import NOBODY


def planes(rng: np.random.Generator, side: int = 24) -> dict[str, np.ndarray]:
    """A tile of which a half shows something."""
    seen = rng.uniform(size=(side, side)) < 0.5
    return {
        "rgb": rng.integers(0, 256, (side, side, 3), np.uint8),
        "worth": np.where(seen, rng.uniform(0.0, 0.3, (side, side)), -np.inf).astype(np.float32),
        "shown": np.where(seen, 5, NOBODY).astype(np.int32),
        "seen_s": np.where(seen, rng.uniform(0.0, 20.0, (side, side)), -np.inf).astype(np.float32),
        "gsd": np.where(seen, rng.uniform(0.05, 0.2, (side, side)), np.inf).astype(np.float32),
    }


@pytest.mark.parametrize("lead", [0.0, FEATHER / 2.0])
def test_the_loop_does_what_numpy_does(rng: np.random.Generator, lead: float) -> None:
    tile = planes(rng)
    new_rgb = rng.integers(0, 256, tile["rgb"].shape, np.uint8)
    inside = np.where(rng.uniform(size=tile["worth"].shape) < 0.7, 255, 0).astype(np.uint8)
    worth = rng.uniform(0.0, 0.3, tile["worth"].shape).astype(np.float32)
    wanted = {k: v.copy() for k, v in tile.items()}
    laid = inside > 0
    gain = worth - wanted["worth"]
    share = np.clip((gain + lead) / FEATHER + 0.5, 0.0, 1.0)[..., None]
    mixed = np.where(share > 0.0, wanted["rgb"] + share * (new_rgb.astype(float) - wanted["rgb"]), wanted["rgb"])
    better = laid & (gain > 0.0)
    wanted["worth"][better], wanted["shown"][better] = worth[better], 9
    wanted["seen_s"][laid] = np.maximum(wanted["seen_s"], np.float32(10.0))[laid]
    wanted["gsd"][laid] = np.minimum(wanted["gsd"], np.float32(0.1))[laid]

    said = blend_pixels(*tile.values(), new_rgb, inside, worth, 9, 10.0, 0.1, lead)

    assert said == LAID | DRAWN
    for name in ("worth", "shown", "seen_s", "gsd"):
        np.testing.assert_array_equal(tile[name], wanted[name])
    np.testing.assert_allclose(tile["rgb"][laid], mixed[laid], atol=0.51)
    np.testing.assert_array_equal(tile["rgb"][~laid], wanted["rgb"][~laid])


def test_what_is_worth_less_is_seen_but_not_drawn(rng: np.random.Generator) -> None:
    tile = planes(rng)
    tile["worth"][:] = 1.0
    before = tile["rgb"].copy()
    whole, poor = np.full(tile["worth"].shape, 255, np.uint8), np.zeros(tile["worth"].shape, np.float32)
    said = blend_pixels(*tile.values(), before[::-1].copy(), whole, poor, 9, 30.0, 0.01, FEATHER / 2.0)
    assert said == LAID
    np.testing.assert_array_equal(tile["rgb"], before)
    assert (tile["seen_s"] == 30.0).all() and (tile["shown"] != 9).all()
    assert blend_pixels(*tile.values(), before, 0 * whole, poor, 9, 30.0, 0.01, 0.0) == 0
