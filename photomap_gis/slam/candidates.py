"""Whom to try for loops: pairs of frames whose footprints, as far as is known, overlap. Pure.

A pair tells the more the more ground its frames share, frames next but one in time as well as frames of neighbouring
strips: the former stiffen the chain, the latter tie its windings to each other. The budget of each frame is spread
over different stretches of the flight: with dense frames the best-overlapping ones are all of its own.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np
import shapely

from photomap_gis.core.similarity import FloatArray, Similarity2D

STRETCH = 8
"""So many frames in a row are one stretch of the flight."""
CROWDING = 0.8
"""By what a pair's score shrinks for every accepted pair that joins one of its frames to the other's stretch."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pair to register: predicted overlap (of the smaller footprint) and motion ``T_a_b`` of the planes.

    ``covariance`` is ``(4, 4)`` about the origin of plane b (``T_true = T Exp(xi)``), or ``None`` where poses carry
    none; the two poses' errors are taken as independent, which is wide rather than narrow.
    """

    a: int
    b: int
    overlap: float
    T_a_b: Similarity2D
    covariance: FloatArray | None


def candidates(
    poses: Mapping[int, tuple[Similarity2D, FloatArray | None]],
    footprints: Mapping[int, FloatArray],
    *,
    exclude: AbstractSet[tuple[int, int]] = frozenset(),
    min_overlap: float = 0.3,
    max_per_frame: int = 12,
    spent: Mapping[int, int] | None = None,
) -> list[Candidate]:
    """Return the pairs worth registering, the most informative first; the same list for the same input.

    ``footprints`` are the frames' outlines ``(N, 2)`` in their **planes**. ``exclude`` holds pairs in either order.
    No frame is in more than ``max_per_frame`` pairs, those included that earlier rounds ``spent`` on it.
    """
    frames = [f for f in sorted(poses) if f in footprints and len(footprints[f]) >= 3]
    if len(frames) < 2:
        return []
    outlines = [poses[f][0].apply(footprints[f]) for f in frames]
    sane = np.array([np.isfinite(o).all() for o in outlines])
    shapes = np.array(
        [shapely.convex_hull(shapely.multipoints(o if ok else [(0, 0)])) for o, ok in zip(outlines, sane, strict=True)]
    )
    area = shapely.area(shapes)
    i, j = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    ordered = (i < j) & (area[i] > 0) & (area[j] > 0) & sane[i] & sane[j]
    i, j = i[ordered], j[ordered]
    overlap = shapely.area(shapely.intersection(shapes[i], shapes[j])) / np.minimum(area[i], area[j])
    enough = overlap >= min_overlap
    i, j, overlap = i[enough], j[enough], overlap[enough]
    barred = {(min(p), max(p)) for p in exclude}
    pairs = [
        (frames[a], frames[b], float(o))
        for a, b, o in zip(i.tolist(), j.tolist(), overlap.tolist(), strict=True)
        if (frames[a], frames[b]) not in barred
    ]
    order = {f: k for k, f in enumerate(frames)}
    return [_candidate(a, b, o, poses) for a, b, o in _chosen(pairs, order, max_per_frame, spent or {})]


def _chosen(
    pairs: list[tuple[int, int, float]], order: Mapping[int, int], max_per_frame: int, spent: Mapping[int, int]
) -> list[tuple[int, int, float]]:
    """Take pairs by falling score, each frame within its budget, each crowd of like pairs at a discount."""
    heap = [(-overlap, 0, a, b, overlap) for a, b, overlap in pairs]
    heapq.heapify(heap)
    used = dict(spent)
    crowd: dict[tuple[int, int], int] = {}
    out = []
    while heap:
        score, discounts, a, b, overlap = heapq.heappop(heap)
        if used.get(a, 0) >= max_per_frame or used.get(b, 0) >= max_per_frame:
            continue
        cells = [(a, order[b] // STRETCH), (b, order[a] // STRETCH)]
        crowded = sum(crowd.get(cell, 0) for cell in cells)
        if crowded > discounts:  # others came first since this was scored: back in the queue at its lower worth
            heapq.heappush(heap, (score * CROWDING ** (crowded - discounts), crowded, a, b, overlap))
            continue
        out.append((a, b, overlap))
        for frame in (a, b):
            used[frame] = used.get(frame, 0) + 1
        for cell in cells:
            crowd[cell] = crowd.get(cell, 0) + 1
    return out


def _candidate(
    a: int, b: int, overlap: float, poses: Mapping[int, tuple[Similarity2D, FloatArray | None]]
) -> Candidate:
    (T_a, cov_a), (T_b, cov_b) = poses[a], poses[b]
    T_a_b = T_a.inverse() @ T_b
    if cov_a is None or cov_b is None:
        return Candidate(a, b, overlap, T_a_b, None)
    ad = T_a_b.inverse().adjoint()
    return Candidate(a, b, overlap, T_a_b, cov_b + ad @ cov_a @ ad.T)
