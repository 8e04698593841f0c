"""Where a vehicle may be, and the shortest way there: a visibility graph about no-fly zones.

Shortest paths among polygons bend only at their vertices [Lozano-Perez and Wesley 1979]; rows of the graph are worked
out when a search first needs them.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
import numpy.typing as npt
import shapely
import shapely.ops
from shapely.geometry import LineString, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

INSET_MARGIN_M = 0.1
"""How far inside its polygon an inset flight stays: more than what rounding coordinates moves."""
_TOUCH_M = 0.01
_FAR_M = 1e5
_MOST_NODES = 900
_MOST_KEPT = 20_000


class FreeSpace:
    """The plane without its no-fly zones, in local metres; with ``inside`` only the inside of that polygon.

    A plan, in the manner of a precomputed index: asked, never changed but for its cache.
    """

    def __init__(self, avoid: BaseGeometry, *, margin_m: float, inside: BaseGeometry | None = None) -> None:
        zones = avoid.buffer(max(margin_m, 0.1), join_style="mitre", mitre_limit=2.0) if not avoid.is_empty else avoid
        if inside is not None:
            west, south, east, north = inside.bounds
            world = shapely.box(west - _FAR_M, south - _FAR_M, east + _FAR_M, north + _FAR_M)
            kept = inside.buffer(-INSET_MARGIN_M, join_style="mitre", mitre_limit=2.0)
            zones = world.difference(kept).union(zones)
        self.zones = zones
        """What may not be entered, margins included."""
        self.is_open = zones.is_empty
        self._strict = zones.buffer(-_TOUCH_M, join_style="mitre", mitre_limit=2.0)
        shapely.prepare(self._strict)
        shapely.prepare(self.zones)
        self._nodes = _corners(zones)
        self._rows: dict[int, BoolArray] = {}
        self._seen: dict[tuple[float, float], BoolArray] = {}

    def holds(self, xy: npt.ArrayLike) -> BoolArray:
        """Whether ``(N, 2)`` points may be visited."""
        p = np.atleast_2d(np.asarray(xy, np.float64))
        if self.is_open:
            return np.ones(len(p), bool)
        return ~shapely.intersects(self._strict, shapely.points(p))

    def sees(self, a: npt.ArrayLike, b: npt.ArrayLike) -> BoolArray:
        """Whether the straight legs from ``(N, 2)`` to ``(N, 2)`` points are free; either may be one point."""
        p, q = np.broadcast_arrays(np.atleast_2d(np.asarray(a, float)), np.atleast_2d(np.asarray(b, float)))
        if self.is_open:
            return np.ones(len(p), bool)
        return ~shapely.intersects(self._strict, shapely.linestrings(np.stack([p, q], axis=1)))

    def clip(self, line: LineString) -> list[LineString]:
        """Return the free pieces of a line, in its order."""
        if self.is_open or not self._strict.intersects(line):
            return [line]
        left = shapely.get_parts(line.difference(self.zones))
        pieces = [g for g in left if isinstance(g, LineString) and g.length > 1e-3]
        return sorted(pieces, key=lambda g: line.project(shapely.Point(g.coords[0])))

    def nearest(self, xy: npt.ArrayLike) -> FloatArray:
        """Return the allowed place nearest to a point, itself where it is allowed."""
        p = np.asarray(xy, np.float64)
        if self.holds(p)[0]:
            return p
        spot = shapely.Point(p)
        edge = shapely.boundary(self.zones)
        return np.asarray(shapely.ops.nearest_points(edge, spot)[0].coords[0])

    def path(self, a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray | None:
        """Return the ``(N, 2)`` shortest free way from a to b with both ends, None where there is none."""
        start, goal = np.asarray(a, np.float64), np.asarray(b, np.float64)
        if self.sees(start, goal)[0]:
            return np.stack([start, goal])
        if not (self.holds(start)[0] and self.holds(goal)[0]) or not len(self._nodes):
            return None
        nodes = self._nodes
        from_start, to_goal = self._nodes_seen(start), self._nodes_seen(goal)
        left = np.hypot(*(nodes - goal).T)
        best = np.where(from_start, np.hypot(*(nodes - start).T), math.inf)
        before = np.full(len(nodes), -1)
        queue = [(float(best[i] + left[i]), int(i)) for i in np.flatnonzero(from_start)]
        heapq.heapify(queue)
        closed = np.zeros(len(nodes), bool)
        goal_length, last = math.inf, -1
        while queue:
            bound, i = heapq.heappop(queue)
            if bound >= goal_length:
                break
            if closed[i]:
                continue
            closed[i] = True
            if to_goal[i] and best[i] + left[i] < goal_length:
                goal_length, last = float(best[i] + left[i]), i
                continue  # no way by another corner is shorter than straight on
            through = best[i] + np.hypot(*(nodes - nodes[i]).T)
            for j in np.flatnonzero(self._row(i) & ~closed & (through < best)):
                best[j], before[j] = through[j], i
                heapq.heappush(queue, (float(through[j] + left[j]), int(j)))
        if last < 0:
            return None
        way = [goal]
        while last >= 0:
            way.append(nodes[last])
            last = int(before[last])
        return np.array([start, *way[:0:-1], goal])

    def _nodes_seen(self, place: FloatArray) -> BoolArray:
        key = (float(place[0]), float(place[1]))
        if key not in self._seen:
            if len(self._seen) >= _MOST_KEPT:
                self._seen.clear()
            self._seen[key] = self.sees(place, self._nodes)
        return self._seen[key]

    def _row(self, i: int) -> BoolArray:
        if i not in self._rows:
            self._rows[i] = self.sees(self._nodes[i], self._nodes)
        return self._rows[i]


def _corners(zones: BaseGeometry) -> FloatArray:
    """``(N, 2)`` the vertices about which a shortest path can bend."""
    tolerance, outline = 0.0, zones
    while True:
        found = [_convex_vertices(p) for p in shapely.get_parts(outline) if isinstance(p, Polygon)]
        nodes = np.concatenate(found) if found else np.zeros((0, 2))
        nodes = nodes[np.abs(nodes - (nodes.mean(axis=0) if len(nodes) else 0)).max(axis=1, initial=0) < _FAR_M / 2]
        if len(nodes) <= _MOST_NODES:
            return nodes
        tolerance = 2.0 * tolerance or 1.0
        outline = zones.buffer(tolerance, join_style="mitre", mitre_limit=2.0).simplify(tolerance)


def _convex_vertices(polygon: Polygon) -> FloatArray:
    turned = shapely.geometry.polygon.orient(polygon)
    kept = []
    for ring in (turned.exterior, *turned.interiors):
        p = np.asarray(ring.coords)[:-1]
        before, after = p - np.roll(p, 1, axis=0), np.roll(p, -1, axis=0) - p
        kept.append(p[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 1e-9])
    return np.concatenate(kept)


def polygons_of(geometry: BaseGeometry) -> BaseGeometry:
    """Return the polygons of any geometry as one multipolygon."""
    return MultiPolygon([g for g in shapely.get_parts(geometry, return_index=False) if isinstance(g, Polygon)])
