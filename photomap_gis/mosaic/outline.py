"""Convex outlines on the map: hulls of footprints, and how deep inside them points lie."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray


def distance_inside(hull: FloatArray, points: npt.ArrayLike) -> FloatArray:
    """``(N,)`` distance of ``(N, 2)`` points from a convex hull's border, positive inside."""
    return distance_inside_sides(*sides(hull), points)


def distance_inside_sides(normals: FloatArray, offsets: FloatArray, points: npt.ArrayLike) -> FloatArray:
    """Return what ``distance_inside`` does, for a hull whose ``sides`` are known."""
    # A side a row: numpy takes the least of rows ten times as fast as that of short columns.
    distances: FloatArray = normals @ np.asarray(points, dtype=np.float64).T
    distances -= offsets[:, None]
    return np.asarray(distances.min(axis=0))


def sides(hull: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``(K, 2)`` unit normals of a convex hull's sides, pointing inside, and ``(K,)`` how far along them each lies."""
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    return normals, np.sum(normals * hull, axis=1)


def convex_hull(points: FloatArray) -> FloatArray:
    """``(K, 2)`` convex hull of ``(N, 2)`` points, turning from x to y, without collinear corners (Andrew's chain)."""
    order = points[np.lexsort((points[:, 1], points[:, 0]))]
    size = float(np.ptp(order, axis=0).max()) or 1.0

    def chain(path: Iterable[FloatArray]) -> list[FloatArray]:
        out: list[FloatArray] = []
        for p in path:
            while len(out) >= 2 and _turn(out[-2], out[-1], p) <= 1e-9 * size * size:
                out.pop()
            out.append(p)
        return out[:-1]

    return np.array(chain(order) + chain(order[::-1]))


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
