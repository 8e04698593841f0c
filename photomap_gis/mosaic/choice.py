"""What it costs to take a spot of ground from a frame: the one rule of choice that plan and render share.

The cost grows with the square of the distance from where the frame looks straight down, so cells of equally fine
frames are those of a Voronoi diagram: every spot is taken from the frame that looks at it most steeply. Coarser frames
pay, and the outermost rim of a raster pays (lens, border artefacts); what the user prefers costs less (``preference``).
A frame of a higher tier is taken only where no lower one sees the spot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.views import View

RIM_SHARE = 0.02
"""Width of the rim that pays, as a share of the raster's shorter side."""

RIM_COST = 4.0

TIER_COST = 1000.0
"""What a tier adds where a single frame is chosen: more than any cost of ``choice_cost``."""

TAPER_SHARE = 0.15
"""How far inside the raster ``taper`` is 1, as a share of its shorter side."""

WIDE_REACH = 0.4
"""Low frequencies are shared by the frames whose cost is within this of the best (1: as far as a frame's corner)."""


class Sighting(NamedTuple):
    """How one view sees points of the map: ``(...)`` arrays, NaN where it does not.

    ``cost`` is that of ``choice_cost``; ``border_px`` is the distance from the raster's outer edge, positive inside.
    """

    x_px: FloatArray
    y_px: FloatArray
    cost: FloatArray
    border_px: FloatArray


def sight(view: View, xy_map_m: FloatArray, shape: tuple[int, ...], *, slack_m: float) -> Sighting:
    """Return how ``view`` sees ``(N, 2)`` map points, up to ``slack_m`` beyond its footprint; arrays of ``shape``."""
    xy = view.locate(xy_map_m, slack_m=slack_m)
    x, y = xy[:, 0].reshape(shape).copy(), xy[:, 1].reshape(shape).copy()  # numpy is slow where values lie apart
    border = border_of(view, x, y)
    return Sighting(x, y, choice_cost(view, distance_from_middle(view, x, y), border), border)


def border_of(view: View, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
    """Return the distances in pixels from the raster's outer edge, positive inside."""
    w, h = view.placement.width_px, view.placement.height_px
    dx, dy = np.abs(x_px - (w - 1) / 2.0), np.abs(y_px - (h - 1) / 2.0)
    return np.minimum(w / 2.0 - dx, h / 2.0 - dy)


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
    rim_px = RIM_SHARE * min(view.placement.width_px, view.placement.height_px)
    if not np.min(border_px, initial=np.inf) > rim_px:  # also where it is NaN
        cost += RIM_COST * np.clip(1.0 - border_px / rim_px, 0.0, 1.0)
    return cost


def taper(view: View, border_px: FloatArray) -> FloatArray:
    """Return 0 at the raster's edge rising smoothly to 1 well inside: frames enter and leave a blend unseen."""
    t = np.clip(border_px / taper_px(view), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def taper_px(view: View) -> float:
    """Return how many pixels inside the raster's edge ``taper`` reaches 1."""
    return TAPER_SHARE * min(view.placement.width_px, view.placement.height_px)
