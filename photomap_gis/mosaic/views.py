"""Which frames may be pasted, in which rank, and where on the map each of them can be seen.

A ``View`` is a placement made ready for many questions: its usable footprint as a convex hull, and its *tier*. Lower
tiers win wherever they see the ground at all; higher ones only fill. Of frames that lie almost on top of each other (a
hovering drone, a dense video) one gets a cell of the map, the others fill where they see ground that no better
frame does, and those that add nothing are left out: the map is not cut into slivers, and fewer frames are opened.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.outline import convex_hull, distance_inside_sides, sides
from photomap_gis.mosaic.seen import SeenGround

MIN_SPACING = 0.1
"""Frames whose centres are closer than this share of a frame's diagonal do not both get a cell of their own."""

MAX_COARSENING = 4.0
"""Pixels whose ground sampling is this many times coarser than at the frame's centre are not pasted (horizons)."""

MAX_OFF_CENTRE = 0.35
"""A frame is not preferred where it looks straight down if that is farther off its centre than this share of a side."""

SPARE_ADDS = 0.015
"""A crowded frame is of use where it adds this share of its footprint to the map."""

SPARE_TIER, FILL_TIER = 1, 2
"""Tiers: 0 registered, 1 registered but crowded, 2 placed by GPS alone, 3 both."""

_RING_POINTS_PER_SIDE = 8
_CELLS_PER_SIDE = 64
_COMES_BACK_PX = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A frame that may be pasted.

    ``tier`` ranks it (0 best). ``hull_xy_map_m`` is the ``(K, 2)`` convex hull of its usable footprint, turning
    from x to y. ``resolution_cost`` is what its ground sampling adds to the cost of choosing it, ``preference_cost``
    what the user's wish adds. ``middle_xy_px`` is the ``(2,)`` pixel from which a frame is chosen before others: where
    it looks straight down, or the raster's centre.
    """

    placement: FramePlacement
    tier: int
    gsd_m_per_px: float
    resolution_cost: float
    centre_xy_map_m: FloatArray
    hull_xy_map_m: FloatArray
    middle_xy_px: FloatArray
    preference_cost: float = 0.0
    _sides: tuple[FloatArray, FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_sides", sides(self.hull_xy_map_m))

    @property
    def frame(self) -> int:
        """The frame's index."""
        return self.placement.frame

    @property
    def half_diagonal_px(self) -> float:
        """Half the raster's diagonal."""
        return 0.5 * math.hypot(self.placement.width_px, self.placement.height_px)

    @property
    def bounds_map_m(self) -> tuple[FloatArray, FloatArray]:
        """``(2,)`` least and ``(2,)`` greatest x, y of the footprint."""
        return self.hull_xy_map_m.min(axis=0), self.hull_xy_map_m.max(axis=0)

    def locate(
        self, xy_map_m: FloatArray, *, slack_m: float, bounds_map_m: tuple[FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """``(N, 2)`` pixels of ``(N, 2)`` map points; NaN farther than ``slack_m`` outside the footprint.

        ``bounds_map_m`` are the least and the greatest x, y of the points, where they are known.

        The footprint is asked first because a distorted camera folds far-away ground back into its picture: there
        the polynomial of the lens no longer means anything.
        """
        (left, top), (right, bottom) = bounds_map_m or (xy_map_m.min(axis=0), xy_map_m.max(axis=0))
        box = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
        # What is near is convex: where the points' box is, they all are.
        if distance_inside_sides(*self._sides, box).min() >= -slack_m:
            return self.placement.camera_to_map.unproject(xy_map_m)
        near = distance_inside_sides(*self._sides, xy_map_m) >= -slack_m
        if near.all():
            return self.placement.camera_to_map.unproject(xy_map_m)
        xy_px = np.full(xy_map_m.shape, np.nan)
        if near.any():
            xy_px[near] = self.placement.camera_to_map.unproject(xy_map_m[near])
        return xy_px


def views_of(trajectory: Trajectory, costs: Mapping[int, float] = MappingProxyType({})) -> list[View]:
    """Return a view for every registered or GPS-placed frame that adds ground, in the trajectory's order.

    ``costs`` are those of the user's preference by frame: of a crowd the cheapest frame gets the cell.
    """
    usable = [replace(view, preference_cost=costs.get(view.frame, 0.0)) for view in all_views_of(trajectory)]
    if not usable:
        return []
    reference_gsd = float(np.median([view.gsd_m_per_px for view in usable]))
    ranked = [
        replace(
            view,
            tier=view.tier + (SPARE_TIER if crowded else 0),
            resolution_cost=_resolution_cost(view.gsd_m_per_px / reference_gsd),
        )
        for view, crowded in zip(usable, _crowded(usable), strict=True)
    ]
    return _that_add_ground(ranked, reference_gsd)


def all_views_of(trajectory: Trajectory) -> list[View]:
    """Return a view, not ranked yet, for every registered or GPS-placed frame that sees ground at all."""
    return [view for placement in trajectory.placements if (view := _view_of(placement)) is not None]


def _view_of(placement: FramePlacement) -> View | None:
    if placement.status not in (FrameStatus.REGISTERED, FrameStatus.GPS_ONLY):
        return None
    if placement.width_px < 2 or placement.height_px < 2:
        return None
    with np.errstate(all="ignore"):
        gsd, centre = placement.gsd_m_per_px, placement.centre_xy_map_m
    if not (np.isfinite(gsd) and gsd > 0 and np.isfinite(centre).all()):
        return None
    footprint = _usable_footprint(placement, gsd)
    if len(footprint) < 3:
        return None
    hull = convex_hull(footprint)
    if len(hull) < 3:
        return None
    tier = 0 if placement.status is FrameStatus.REGISTERED else FILL_TIER
    return View(placement, tier, gsd, 0.0, centre, hull, _middle_xy_px(placement))


def _middle_xy_px(placement: FramePlacement) -> FloatArray:
    """Return the pixel that looks straight down, no farther from the raster's centre than ``MAX_OFF_CENTRE``.

    What stands on the ground leans away from that pixel. Where the camera is not known to lean it is the centre.
    """
    centre = placement.centre_xy_px[0]
    plumb = placement.plumb_xy_map_m
    if plumb is None:
        return centre
    with np.errstate(all="ignore"):
        off = placement.camera_to_map.unproject(plumb[None])[0] - centre
    size = float(np.hypot(*off))
    limit = MAX_OFF_CENTRE * min(placement.width_px, placement.height_px)
    if not math.isfinite(size):
        return centre
    return np.asarray(centre + off * min(1.0, limit / max(size, 1e-9)))


def _usable_footprint(placement: FramePlacement, gsd: float) -> FloatArray:
    """Return map points that span the usable part of the frame: its border, or what lies well below the horizon."""
    w, h = placement.width_px, placement.height_px
    t = np.linspace(0.0, 1.0, _RING_POINTS_PER_SIDE + 1)
    grid = np.stack(np.meshgrid(t * w - 0.5, t * h - 0.5), axis=-1)
    on_ring = np.ones(grid.shape[:2], dtype=bool)
    on_ring[1:-1, 1:-1] = False
    ring = grid[on_ring]
    xy, ok = _project_usable(placement, ring, gsd)
    if ok.all():
        return xy
    fine = np.linspace(0.0, 1.0, 4 * _RING_POINTS_PER_SIDE + 1)
    inner = np.stack(np.meshgrid(fine * w - 0.5, fine * h - 0.5), axis=-1).reshape(-1, 2)
    xy, ok = _project_usable(placement, inner, gsd)
    return xy[ok]


def _project_usable(
    placement: FramePlacement, xy_px: FloatArray, gsd: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return map points of pixels and whether each can be pasted: it sees the ground, finely enough, and comes back.

    A pixel does not come back where a lens model bends more than any lens does, as wrong metadata may say.
    """
    with np.errstate(all="ignore"):
        xy = placement.camera_to_map.project(xy_px)
        local_gsd = np.sqrt(np.abs(np.linalg.det(placement.camera_to_map.jacobian(xy_px))))
        back = placement.camera_to_map.unproject(xy)
        ok = np.isfinite(xy).all(axis=1) & (local_gsd <= MAX_COARSENING * gsd)
        ok &= np.linalg.norm(back - xy_px, axis=1) < _COMES_BACK_PX
    return xy, ok


def _resolution_cost(ratio: float) -> float:
    """Return the cost of sampling ``ratio`` times coarser than the median: hardly any for a few per cent, 1 for 2."""
    octaves = math.log2(ratio)
    return math.copysign(octaves * octaves, octaves)


def _crowded(views: list[View]) -> list[bool]:
    """Say for each view whether it is too close to a preferred one of its tier, and not finer, to get its own cell.

    Among equals the earlier one is preferred.
    """
    crowded: dict[int, bool] = {}
    for tier in sorted({view.tier for view in views}):
        same = [(i, view) for i, view in enumerate(views) if view.tier == tier]
        same.sort(key=lambda at: at[1].preference_cost)
        cell = MIN_SPACING * max(2.0 * view.half_diagonal_px * view.gsd_m_per_px for _, view in same)
        kept: defaultdict[tuple[int, int], list[View]] = defaultdict(list)
        for i, view in same:
            crowded[i] = any(_crowds(other, view) for other in _around(kept, view, cell))
            if not crowded[i]:
                kept[_cell_of(view, cell)].append(view)
    return [crowded[i] for i in range(len(views))]


def _that_add_ground(views: list[View], reference_gsd: float) -> list[View]:
    """Return the views without those crowded ones that see (nearly) nothing that better ones do not see."""
    if not any(view.tier % 2 == SPARE_TIER for view in views):
        return views
    side_px = float(np.median([min(view.placement.width_px, view.placement.height_px) for view in views]))
    seen = SeenGround(side_px * reference_gsd / _CELLS_PER_SIDE)
    left_out: set[int] = set()
    for index in sorted(range(len(views)), key=lambda i: (views[i].tier, views[i].preference_cost)):
        crowded = views[index].tier % 2 == SPARE_TIER
        if seen.add(views[index].hull_xy_map_m, least_new=SPARE_ADDS if crowded else 0.0) < 0:
            left_out.add(index)
    return [view for index, view in enumerate(views) if index not in left_out]


def _crowds(kept: View, view: View) -> bool:
    if view.gsd_m_per_px < 0.8 * kept.gsd_m_per_px and view.preference_cost <= kept.preference_cost:
        return False
    reach = MIN_SPACING * 2.0 * min(v.half_diagonal_px * v.gsd_m_per_px for v in (kept, view))
    return math.dist(kept.centre_xy_map_m, view.centre_xy_map_m) < reach


def _cell_of(view: View, cell_m: float) -> tuple[int, int]:
    x, y = view.centre_xy_map_m
    return math.floor(x / cell_m), math.floor(y / cell_m)


def _around(kept: defaultdict[tuple[int, int], list[View]], view: View, cell_m: float) -> Iterator[View]:
    col, row = _cell_of(view, cell_m)
    for r in (row - 1, row, row + 1):
        for c in (col - 1, col, col + 1):
            yield from kept.get((c, r), ())
