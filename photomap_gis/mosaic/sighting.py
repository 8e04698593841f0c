"""How all frames that may see a tile see the nodes of its lattice: one array, which the compiled passes read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.choice import RIM_COST, TIER_COST, rim_px
from photomap_gis.mosaic.lattice import FloatImage, Lattice
from photomap_gis.mosaic.views import View

X_PX, Y_PX, COST, BORDER_PX = range(4)
"""What is told of each node: where the frame shows it, what choosing it costs, how far inside the raster it is."""

_SLACK_NODES = 3.0


def sights_of(views: Sequence[View], lattice: Lattice, pixel_m: float) -> FloatImage:
    """``(K, 4, rows, columns)`` how each view sees the nodes (``X_PX`` ...); NaN where it does not.

    Views see a few nodes beyond their footprints, too: pixels inside are interpolated from them.
    """
    xy = lattice.nodes_xy_map_m
    low, high = xy.min(axis=0), xy.max(axis=0)
    out = np.empty((len(views), 4, *lattice.shape), dtype=np.float32)
    for view, into in zip(views, out, strict=True):
        xy_px = view.locate(xy, slack_m=_SLACK_NODES * lattice.step_px * pixel_m, bounds_map_m=(low, high))
        (middle_x, middle_y), placement = view.middle_xy_px.tolist(), view.placement
        _see(
            np.ascontiguousarray(xy_px), placement.width_px, placement.height_px, middle_x, middle_y,
            view.half_diagonal_px, view.resolution_cost + view.preference_cost, rim_px(view), into.reshape(4, -1),
        )  # fmt: skip
    return out


def ranked_costs(views: Sequence[View], sights: FloatImage) -> FloatImage:
    """``(K, rows, columns)`` what it costs to choose a view at the nodes, its tier counted; infinite where unseen."""
    tiers = np.array([TIER_COST * view.tier for view in views], dtype=np.float32)
    costs = sights[:, COST] + tiers[:, None, None]
    np.copyto(costs, np.inf, where=np.isnan(costs))
    return costs


@compiled("void(Array(f8, 2, 'C', True), i8, i8, f8, f8, f8, f8, f8, f4[:,::1])")
def _see(
    xy_px: FloatArray,
    width: int,
    height: int,
    middle_x: float,
    middle_y: float,
    half_diagonal: float,
    constant_cost: float,
    rim: float,
    out: npt.NDArray[np.float32],
) -> None:
    """Fill ``(4, N)`` of what ``choice`` says of ``(N, 2)`` pixels: ``choice_cost`` and ``border_of``."""
    for n in range(len(xy_px)):
        x, y = xy_px[n, 0], xy_px[n, 1]
        border = min(width / 2.0 - abs(x - (width - 1) / 2.0), height / 2.0 - abs(y - (height - 1) / 2.0))
        cost = ((x - middle_x) ** 2 + (y - middle_y) ** 2) / half_diagonal**2 + constant_cost
        if border < rim:
            cost += RIM_COST * min(1.0 - border / rim, 1.0)
        if np.isnan(x + y):
            border = np.nan
        out[0, n], out[1, n], out[2, n], out[3, n] = x, y, cost, border
