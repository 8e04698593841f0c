"""Low frequencies: consensus that is smooth, complete and fair to trusted frames; compiled passes have their twins."""

import numpy as np
import pytest

from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapGrid
from photomap_gis.mosaic.choice import choice_cost, distance_from_middle, radius_and_border
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.light import consensus_weights, exposed, levels_of, shift_to_consensus
from photomap_gis.mosaic.lowband import low_band_of
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.sighting import BORDER_PX, COST, X_PX, Y_PX, ranked_costs
from tests.mosaic.flight import GSD_M, place
from tests.mosaic.looking import look

GRID = MapGrid("a CRS", 500_000.0, 4_000_000.0, GSD_M, 400, 300, 512)


def test_what_is_seen_of_the_nodes_is_what_choice_says():
    lattice, views, sights = look(
        GRID, place(0, 40, 35, heading_rad=0.4), place(1, 62, 40, status=FrameStatus.GPS_ONLY)
    )
    for view, sight in zip(views, sights, strict=True):
        x, y = view.locate(lattice.nodes_xy_map_m, slack_m=24 * GSD_M).T
        _, border = radius_and_border(view, x, y)
        with np.errstate(invalid="ignore"):
            cost = choice_cost(view, distance_from_middle(view, x, y), border)
        for told, expected in ((X_PX, x), (Y_PX, y), (COST, cost), (BORDER_PX, border)):
            assert np.allclose(sight[told].ravel(), expected, rtol=1e-5, atol=1e-4, equal_nan=True)
    assert np.isnan(sights).any()
    costs = ranked_costs(views, sights)
    assert np.array_equal(np.isinf(costs), np.isnan(sights[:, COST]))
    assert np.nanmin(costs[1] - sights[1, COST]) == pytest.approx(2000.0, rel=1e-5)


def test_consensus_adds_up_to_one_wherever_somebody_looks(rng):
    placements = [
        place(i, *rng.uniform((20, 20), (80, 55)), heading_rad=rng.uniform(-3, 3), status=status)
        for i, status in enumerate([FrameStatus.REGISTERED] * 6 + [FrameStatus.GPS_ONLY] * 3)
    ]
    _, views, sights = look(GRID, *placements)
    weights, border = consensus_weights(views, sights), np.nan_to_num(sights[:, BORDER_PX], nan=-1)
    assert weights.min() >= 0
    assert np.allclose(weights.sum(axis=0)[(border > 0).any(axis=0)], 1.0, atol=1e-5)
    registered = np.array([view.tier < 2 for view in views])
    deep = (border[registered] > 30).any(axis=0)
    assert weights[~registered].sum(axis=0)[deep].max() < 1e-4
    alone = (border > 0).any(axis=0) & (border[registered] <= 0).all(axis=0)
    assert alone.any() and weights[~registered].sum(axis=0)[alone].min() > 0.9


def test_consensus_changes_smoothly():
    _, views, sights = look(GRID, place(0, 40, 35), place(1, 55, 38), place(2, 62, 30))
    weights = consensus_weights(views, sights)
    inside_all = (np.nan_to_num(sights[:, BORDER_PX], nan=-1) > 10).all(axis=0)
    steps = np.abs(np.diff(weights, axis=2))[:, inside_all[:, 1:] & inside_all[:, :-1]]
    assert steps.max() < 0.25


def test_light_is_shared_and_things_are_not():
    ground = np.full((4, 4, 3), 100, np.float32)
    half = np.full((2, 4, 4), 0.5, np.float32)
    light = shift_to_consensus(np.stack([ground, 1.1 * ground]), half, 0)
    assert light == pytest.approx(np.full_like(ground, 5.0), rel=0.05)
    thing = shift_to_consensus(np.stack([ground, 2.2 * ground]), half, 0)
    assert np.abs(thing).max() < 0.1 * 60.0


def test_levels_are_those_of_the_thumbnail_exposed(rng):
    """A twin: the value objects' own rules, an array a step."""
    _, views, sights = look(GRID, place(0, 40, 35, heading_rad=0.3))
    low = low_band_of(SourceImage(rng.integers(0, 256, (180, 240, 3), dtype=np.uint8), 1.0))
    exposure = Exposure({0: np.array([0.9, 1.0, 1.1])}, (0.2, -0.1))
    factor = exposed(views[0], sights[0], exposure)
    radius, _ = radius_and_border(views[0], sights[0, X_PX], sights[0, Y_PX])
    assert np.allclose(factor, exposure.factor(views[0], radius), rtol=1e-4)
    seen = sights[0, BORDER_PX] > 0
    expected = low.sample(sights[0, X_PX], sights[0, Y_PX]) * factor
    # OpenCV rounds places to 1/32 of a pixel; here they are exact.
    assert np.abs(levels_of(low, sights[0], factor) - expected)[seen].max() < 2.0
