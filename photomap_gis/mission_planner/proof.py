"""What pictures are sure to show: the exact union of their footprints at the tolerances, and what it leaves out.

A straight lane's footprints are one convex polygon first (a lower bound that misses only the scallops between
pictures); only where that leaves something are single footprints looked at. ``tests`` hold it against a raster.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from photomap_gis.mission_planner.free_space import FreeSpace
from photomap_gis.mission_planner.lanes import Lane
from photomap_gis.mission_planner.optics import Spacing, SureFootprint

FloatArray = npt.NDArray[np.float64]

SLIVER_M = 0.004
"""Ground narrower than this is rounding."""
_MOST_SPOTS = 300


def uncovered(target: BaseGeometry, lanes: Sequence[Lane], spacing: Spacing, sure: SureFootprint) -> BaseGeometry:
    """Return the part of ``target`` (local metres) that the lanes' pictures are not sure to show."""
    strips = [s for lane in lanes if (s := _strip(lane, spacing, sure)) is not None]
    left = without_slivers(target.difference(shapely.union_all(strips))) if strips else target
    if left.is_empty:
        return left
    prints = footprints(*counted_shots(lanes, spacing), sure)
    near = shapely.STRtree(prints).query(left, predicate="intersects") if len(prints) else []
    if not len(near):
        return left
    return without_slivers(left.difference(shapely.union_all(prints[near])))


def counted_shots(lanes: Sequence[Lane], spacing: Spacing) -> tuple[FloatArray, FloatArray]:
    """Return places and headings of the pictures that count: a lane's first one may be taken in the turn."""
    found = [_counted(lane, spacing) for lane in lanes]
    if not found:
        return np.zeros((0, 2)), np.zeros(0)
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def footprints(xy: FloatArray, heading_rad: FloatArray, sure: SureFootprint) -> npt.NDArray[np.object_]:
    """Return a polygon for each picture: the sure footprint turned to its heading."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    # x across to the right of the heading, y along it
    axes = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)
    rings = np.einsum("rk,nkl->nrl", sure.ring, axes * np.array([[1.0, -1.0], [-1.0, 1.0]])) + xy[:, None]
    return np.asarray(shapely.polygons(rings), dtype=object)


def _counted(lane: Lane, spacing: Spacing) -> tuple[FloatArray, FloatArray]:
    xy, heading = lane.shots(spacing.step_m)
    if lane.spot or spacing.guard_m == 0.0 or len(xy) < 2:
        return xy, heading
    return xy[1:], heading[1:]


def _strip(lane: Lane, spacing: Spacing, sure: SureFootprint) -> Polygon | None:
    """The convex polygon that a straight lane is sure to cover."""
    xy, heading = _counted(lane, spacing)
    if len(lane.xy) > 2 and not lane.spot:
        return None
    half = sure.half_width_at(spacing.step_m)
    if len(xy) == 1 or half <= 0.0 or lane.nose_rad is not None:
        return None
    x = np.unique(np.concatenate([np.clip(sure.ring[:, 0], -half, half), [-half, half]]))
    top = sure.top(x)
    c, s = math.cos(heading[0]), math.sin(heading[0])
    across, along = np.array([c, -s]), np.array([s, c])
    ahead = xy[-1] + x[:, None] * across + top[:, None] * along
    behind = xy[0] + x[:, None] * across - top[:, None] * along
    return Polygon(np.concatenate([ahead, behind[::-1]]))


def without_slivers(geometry: BaseGeometry) -> BaseGeometry:
    """Return the polygons that are wider than rounding."""
    parts = [p for p in shapely.get_parts(geometry) if isinstance(p, Polygon) and p.area > SLIVER_M**2]
    return MultiPolygon([p for p in parts if not p.buffer(-SLIVER_M / 2).is_empty])


def spots_for(left: BaseGeometry, free: FreeSpace, sure: SureFootprint, heading_rad: float) -> list[Lane]:
    """Return single pictures from allowed places that show what lanes left out, the most telling first.

    Greedy cover: of the places on a grid about a gap (and the allowed place nearest to it) the one whose picture shows
    most of it is taken, until no allowed place shows more.
    """
    spots: list[Lane] = []
    reach = float(np.hypot(*sure.ring.T).max())
    for gap in sorted(shapely.get_parts(left), key=lambda g: (-g.area, g.bounds)):
        rest = gap
        for lane in spots:  # of a gap before
            if np.abs(lane.xy[0] - np.asarray(gap.centroid.coords[0])).max() < 2 * reach + gap.length:
                rest = rest.difference(footprints(lane.xy[:1], np.array([heading_rad]), sure)[0])
        rest = without_slivers(rest)
        while not rest.is_empty and len(spots) < _MOST_SPOTS:
            piece = max(shapely.get_parts(rest), key=lambda g: (g.area, g.bounds))
            places = _places_about(piece, free, reach)
            if not len(places):
                rest = without_slivers(rest.difference(piece))
                continue
            prints = footprints(places, np.full(len(places), heading_rad), sure)
            gain = shapely.area(shapely.intersection(prints, piece))
            best = int(np.argmax(gain))
            if gain[best] < max(1e-6, 1e-4 * piece.area):
                rest = without_slivers(rest.difference(piece))
                continue
            spots.append(Lane(np.repeat(places[best : best + 1], 2, axis=0), spot=True, nose_rad=heading_rad))
            rest = without_slivers(rest.difference(prints[best]))
    return spots


def _places_about(piece: Polygon, free: FreeSpace, reach: float) -> FloatArray:
    """``(N, 2)`` allowed places from which some of a piece may be seen."""
    west, south, east, north = piece.bounds
    middle = np.array([[(west + east) / 2, (south + north) / 2]])
    span = max(min((max(east - west, north - south)) / 2, reach) + reach, 1.0)
    steps = np.linspace(-0.95, 0.95, 15) * span
    centre = np.asarray(piece.representative_point().coords[0])
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    rim = shapely.boundary(free.zones).intersection(piece.buffer(reach)) if not free.is_open else shapely.Point()
    edge = [
        shapely.get_coordinates(shapely.line_interpolate_point(g, np.linspace(0.0, 1.0, 24), normalized=True))
        for g in shapely.get_parts(shapely.line_merge(rim))
        if g.length > 0
    ]
    places = np.concatenate([middle, centre[None], free.nearest(centre)[None], centre + grid, *edge])
    return places[free.holds(places)]
