"""The corpus: seeded areas in local metres, the even ones convex, the odd ones concave, some with holes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.affinity
from shapely.geometry import Polygon

SEED = 20261125


@dataclass(frozen=True, slots=True)
class BenchArea:
    name: str
    polygon: Polygon
    convex: bool
    wind: tuple[float, float]


def areas(count: int = 120, seed: int = SEED) -> Iterator[BenchArea]:
    """Yield ``count`` areas of 0.05 to 1.5 km2; every third flight has wind (metres a second, to east and north)."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        convex = number % 2 == 0
        size = float(np.sqrt(10 ** rng.uniform(4.7, 6.2)))
        polygon = _convex(rng) if convex else _concave(rng, number)
        scale = size / float(np.sqrt(polygon.area))
        polygon = shapely.affinity.scale(polygon, scale, scale, origin=(0.0, 0.0))
        blow = rng.uniform(0, 2 * np.pi)
        wind = 5.0 * np.array([np.sin(blow), np.cos(blow)]) if number % 3 == 0 else np.zeros(2)
        yield BenchArea(f"{number:03d}", polygon, convex, (float(wind[0]), float(wind[1])))


def _convex(rng: np.random.Generator) -> Polygon:
    points = rng.normal(size=(int(rng.integers(4, 14)), 2)) * [rng.uniform(0.3, 1.0), 1.0]
    return _turned(shapely.convex_hull(shapely.multipoints(points)), rng)


def _concave(rng: np.random.Generator, number: int) -> Polygon:
    if number % 4 == 1:  # a star-shaped outline
        n = int(rng.integers(7, 18))
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        reach = rng.uniform(0.35, 1.0, n)
        made = Polygon(np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1))
        made = made if made.is_valid else made.buffer(0)
    else:  # fields of right angles: L, T, U, and with holes
        boxes = [shapely.box(*low, *(low + rng.uniform(0.4, 1.1, 2))) for low in rng.uniform(0, 1, (3, 2))]
        made = shapely.union_all(boxes)
        hole = made.representative_point().buffer(rng.uniform(0.05, 0.15), quad_segs=2)
        made = made.difference(hole) if number % 8 == 3 else made
    made = max(shapely.get_parts(made), key=lambda g: g.area)
    return _turned(made, rng)


def _turned(polygon: Polygon, rng: np.random.Generator) -> Polygon:
    return shapely.affinity.rotate(polygon, float(rng.uniform(0, 360)), origin=(0.0, 0.0))
