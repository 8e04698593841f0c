"""What it costs to take a spot of ground from a frame: the one rule of choice that plan and render share.

The cost grows with the square of the distance from where the frame looks straight down, so cells of equally fine
frames are those of a Voronoi diagram: every spot is taken from the frame that looks at it most steeply. Coarser frames
pay, and the outermost rim of a raster pays (lens, border artefacts); what the user prefers costs less (``preference``).
A frame of a higher tier is taken only where no lower one sees the spot.
"""

from __future__ import annotations

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.views import View

RIM_SHARE = 0.02
"""Width of the rim that pays, as a share of the raster's shorter side."""

RIM_COST = 4.0

TIER_COST = 1000.0
"""What a tier adds where a single frame is chosen: more than any cost of ``choice_cost``."""

TAPER_SHARE = 0.15
"""How far inside the raster a frame has its full say in the consensus, as a share of its shorter side."""

WIDE_REACH = 0.4
"""Low frequencies are shared by the frames whose cost is within this of the best (1: as far as a frame's corner)."""


def radius_and_border(view: View, x_px: FloatArray, y_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances in pixels from the raster's centre and, positive inside, from its outer edge."""
    w, h = view.placement.width_px, view.placement.height_px
    dx, dy = np.abs(x_px - (w - 1) / 2.0), np.abs(y_px - (h - 1) / 2.0)
    return np.sqrt(dx * dx + dy * dy), np.minimum(w / 2.0 - dx, h / 2.0 - dy)


def distance_from_middle(view: View, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
    """Return the distances in pixels from where the frame looks straight down (``View.middle_xy_px``)."""
    x, y = view.middle_xy_px
    return np.asarray(np.hypot(x_px - x, y_px - y))


def choice_cost(view: View, distance_px: FloatArray, border_px: FloatArray) -> FloatArray:
    """Return the cost of choosing ``view`` where it sees a spot at these distances from its middle and its edge."""
    cost = np.square(distance_px / view.half_diagonal_px) + (view.resolution_cost + view.preference_cost)
    rim = rim_px(view)
    if not np.min(border_px, initial=np.inf) > rim:  # also where it is NaN
        cost += RIM_COST * np.clip(1.0 - border_px / rim, 0.0, 1.0)
    return cost


def rim_px(view: View) -> float:
    """Return how wide the rim that pays is."""
    return RIM_SHARE * min(view.placement.width_px, view.placement.height_px)


def taper_px(view: View) -> float:
    """Return how many pixels inside the raster's edge a frame has its full say in low frequencies: it rises from 0."""
    return TAPER_SHARE * min(view.placement.width_px, view.placement.height_px)
