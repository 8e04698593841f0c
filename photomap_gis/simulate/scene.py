"""A scene that ships as code: a coloured height field of roads, houses, trees, rubble and fields, no two the same."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.canvas import Canvas
from photomap_gis.simulate.geodesy import DEFAULT_ORIGIN_LAT_LON
from photomap_gis.simulate.ground import Ground, placed_ground
from photomap_gis.simulate.light import shine
from photomap_gis.simulate.structures import build_houses, drop_rubble, park_vehicles
from photomap_gis.simulate.terrain import lay_land, lay_roads
from photomap_gis.simulate.vegetation import plant_trees


def procedural_scene(
    size_m: tuple[float, float] = (300.0, 250.0),
    gsd_m: float = 0.1,
    seed: int = 0,
    *,
    origin_lat_lon: tuple[float, float] = DEFAULT_ORIGIN_LAT_LON,
    sun_azimuth_deg: float | None = None,
) -> Ground:
    """Return a ground of ``size_m`` (east, north) metres: houses 3-12 m, rubble to 5 m, trees, roads, slope, shadows.

    The same seed, size and pixel size give the same scene. Nothing in it repeats or is symmetric. ``sun_azimuth_deg``
    (clockwise from north) shows it at another hour than its own.
    """
    if not (min(size_m) >= 10.0 and gsd_m > 0):
        raise ValueError(f"size_m must be at least 10 m and gsd_m positive, got {size_m}, {gsd_m}")
    rng = np.random.default_rng([seed, 0x5CE])
    canvas = Canvas.blank(size_m, gsd_m, rng)
    area = size_m[0] * size_m[1]
    lay_land(canvas)
    roads = lay_roads(canvas)
    drop_rubble(canvas, max(1, round(area / 30_000.0)))
    build_houses(canvas, max(2, round(area / 2_600.0)))
    plant_trees(canvas, trees=round(area / 420.0), bushes=round(area / 160.0))
    park_vehicles(canvas, roads, max(3, round(area / 1_500.0)))
    azimuth, elevation = rng.uniform(110, 250), rng.uniform(38, 52)
    shine(
        canvas,
        azimuth_rad=math.radians(azimuth if sun_azimuth_deg is None else sun_azimuth_deg),
        elevation_rad=math.radians(elevation),
    )
    return placed_ground(canvas.colour, canvas.height_m, pixel_size_m=gsd_m, origin_lat_lon=origin_lat_lon)


@dataclass(frozen=True, slots=True, eq=False)
class OrientationScene:
    """A flat ground whose map cannot be turned or mirrored unseen: four coloured discs at known places, and letters.

    ``marks`` holds name, easting, northing and BGR colour of each disc; each is ``mark_radius_m`` wide.
    """

    ground: Ground
    marks: tuple[tuple[str, float, float, tuple[int, int, int]], ...]
    mark_radius_m: float


def orientation_scene(
    size_m: tuple[float, float] = (160.0, 140.0), gsd_m: float = 0.1, seed: int = 0
) -> OrientationScene:
    """Return natural flat land with four discs (red north-west, green north-east, blue south-west, yellow south-east).

    An unmirrored "F" stands in the middle, its top to the north.
    """
    canvas = Canvas.blank(size_m, gsd_m, np.random.default_rng([seed, 0xF]))
    lay_land(canvas, slope=0.0, relief_m=0.0)
    w, h = size_m
    radius = min(size_m) / 28.0
    corners: tuple[tuple[str, float, float, tuple[int, int, int]], ...] = (
        ("red", 0.34, 0.34, (30, 30, 230)),
        ("green", 0.68, 0.32, (30, 220, 30)),
        ("blue", 0.36, 0.66, (230, 50, 30)),
        ("yellow", 0.64, 0.70, (20, 230, 235)),
    )
    for _, fx, fy, bgr in corners:
        centre = canvas.px(np.array([fx * w, fy * h]))
        cv2.circle(canvas.colour, (int(centre[0]), int(centre[1])), round(radius / gsd_m), bgr, -1, cv2.LINE_AA)
    for bar in _letter_f(np.array([w / 2, h / 2]), min(size_m) / 7.0):
        cv2.fillPoly(canvas.colour, [canvas.px(bar)], (245, 245, 245))
    ground = placed_ground(canvas.colour, None, pixel_size_m=gsd_m)
    marks = tuple((name, ground.west + fx * w, ground.north - fy * h, bgr) for name, fx, fy, bgr in corners)
    return OrientationScene(ground, marks, radius)


def _letter_f(centre_m: FloatArray, height_m: float) -> list[FloatArray]:
    """Return three bars, each ``(4, 2)`` metres, y south."""
    unit = height_m / 5.0
    boxes = ((-1.5, -2.5, -0.5, 2.5), (-0.5, -2.5, 1.8, -1.5), (-0.5, -0.6, 1.0, 0.4))
    return [centre_m + unit * np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) for x0, y0, x1, y1 in boxes]
