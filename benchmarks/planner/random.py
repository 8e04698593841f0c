"""``python -m benchmarks.planner.random``: thousands of random areas, each flown soundly or refused in words.

Stars, bow-ties, slivers, tiny ones, duplicate corners, holes, several parts, no-fly zones; across the antimeridian and
near the poles. Each plan is asked what must hold of all: no leg in a zone, inset flights inside, the same plan again,
and coverage as an independent raster has it: every cell projected into every picture, off by the tolerances.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import LineString

from photomap_gis.core.errors import PhotomapError
from photomap_gis.core.plan import GeoPolygon
from photomap_gis.mission_planner.area import survey_area
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics, Tolerances
from photomap_gis.mission_planner.proof import counted_shots
from photomap_gis.mission_planner.survey import Survey, SurveySettings, plan_survey

FloatArray = npt.NDArray[np.float64]

SEED = 20261125
_OPTICS = Optics(5472, 3648, 3648.0)
_PLACES = ((47.0, 8.0), (0.0, 179.9995), (89.995, 10.0), (-89.99, 0.0), (-60.0, -180.0), (71.0, -179.999))
_CELLS = 50
_AGAIN = 10
"""Every so many areas are planned twice."""
_SAY_EVERY = 100


@dataclass(frozen=True, slots=True)
class RandomArea:
    number: int
    polygons: tuple[GeoPolygon, ...]
    zones: tuple[GeoPolygon, ...]
    settings: SurveySettings


def random_areas(count: int, seed: int = SEED, first: int = 0) -> Iterator[RandomArea]:
    """Yield ``count`` areas from number ``first`` on; a number's area hangs on ``seed`` and the number alone."""
    for number in range(first, first + count):
        rng = np.random.default_rng((seed, number))
        frame = LocalFrame.about(*_PLACES[int(rng.integers(len(_PLACES)))])
        size = float(10 ** rng.uniform(0.0, 2.5))
        polygons = [_polygon(rng, frame, size, np.zeros(2))]
        if rng.random() < 0.15:
            polygons.append(_polygon(rng, frame, size / 2, rng.uniform(-2, 2, 2) * size))
        zones = []
        for _ in range(int(rng.integers(4)) if rng.random() < 0.5 else 0):
            corners = rng.uniform(-0.6, 0.6, 2) * size + rng.uniform(-0.25, 0.25, (int(rng.integers(3, 8)), 2)) * size
            zones.append(GeoPolygon((_ring(frame, corners),)))
        nose = float(rng.uniform(0, 360)) if rng.random() < 0.15 else None
        yield RandomArea(
            number,
            tuple(polygons),
            tuple(zones),
            SurveySettings(
                _OPTICS,
                float(rng.uniform(20.0, 80.0)),
                inset=bool(rng.random() < 0.4),
                endurance_s=1500.0 if rng.random() < 0.3 else None,
                trigger=str(rng.choice(["distance", "distance", "time", "hover"])),
                crosshatch=bool(rng.random() < 0.15),
                fixed_heading=nose is not None,
                nose_deg=nose,
                overshoot_m=10.0 if rng.random() < 0.2 else 0.0,
                lead_in_m=10.0 if rng.random() < 0.2 else 0.0,
                model=FlightModel(wind_east_m_s=4.0 if rng.random() < 0.3 else 0.0),
            ),
        )


def _polygon(rng: np.random.Generator, frame: LocalFrame, size: float, middle: FloatArray) -> GeoPolygon:
    corners = int(rng.integers(3, 14))
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    xy = (size * rng.uniform(0.15, 1.0, corners))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    kind = rng.random()
    if kind < 0.15:
        rng.shuffle(xy)  # crosses itself
    elif kind < 0.3:
        xy = xy * [1.0, rng.choice([0.02, 0.002])]
    if rng.random() < 0.15:
        xy = np.repeat(xy, 2, axis=0)
    rings = [_ring(frame, xy + middle)]
    if rng.random() < 0.25:
        turn = np.linspace(0, 2 * np.pi, int(rng.integers(4, 9)), endpoint=False)
        hole = rng.uniform(0.03, 0.3) * size * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        rings.append(_ring(frame, hole + middle + rng.uniform(-0.2, 0.2, 2) * size))
    return GeoPolygon(tuple(rings))


def _ring(frame: LocalFrame, xy: FloatArray) -> tuple[tuple[float, float], ...]:
    places = [(float(lon), float(lat)) for lat, lon in frame.to_lat_lon(xy)]
    return (*places, places[0])


def faults(asked: RandomArea) -> tuple[str, list[str]]:
    """Return ``planned`` or ``refused``, and what is wrong with it: empty where nothing is."""
    chosen = asked.settings
    try:
        survey = plan_survey(survey_area(asked.polygons, asked.zones), chosen)
    except PhotomapError as refusal:
        return "refused", [] if len(str(refusal)) > 20 else [f"crash: refused without words: {refusal!r}"]
    except Exception as error:  # any other one is what this looks for
        return "crashed", [f"crash: {type(error).__name__}: {error}"]
    found = []
    area = survey.area
    for sortie in survey.plan.sorties:
        path = LineString(area.frame.to_xy([(w.lat_deg, w.lon_deg) for w in sortie.waypoints]))
        if path.intersects(area.avoid):
            found.append("zone: a leg enters a no-fly zone")
        if chosen.inset and not area.area.covers(path):
            found.append(f"inset: the flight leaves the area by {_outside_m(path, area.area):.3g} m")
        if chosen.endurance_s is not None and sortie.duration_s > 1.02 * chosen.endurance_s:
            found.append(f"endurance: a sortie takes {sortie.duration_s:.0f} s")
    found += coverage_faults(survey, chosen)
    if not asked.zones and not chosen.inset and survey.plan.covered_share < 1 - 1e-6:
        found.append(f"coverage: {survey.plan.covered_share:.6f} of an open area is covered")
    if asked.number % _AGAIN == 0:
        again = plan_survey(survey_area(asked.polygons, asked.zones), chosen)
        if again.plan != survey.plan:
            found.append("again: the same request gives another plan")
    return "planned", found


def _outside_m(path: LineString, area: shapely.Geometry) -> float:
    return float(shapely.distance(shapely.points(shapely.get_coordinates(path.difference(area))), area).max(initial=0))


def coverage_faults(survey: Survey, chosen: SurveySettings) -> list[str]:
    """Compare what the plan says it covers with a raster of about ``_CELLS`` cells a side."""
    target, left = survey.area.target, survey.left
    west, south, east, north = target.bounds
    cell = max(east - west, north - south) / _CELLS
    x, y = np.meshgrid(np.arange(west, east, cell) + cell / 2, np.arange(south, north, cell) + cell / 2)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = np.concatenate([points, shapely.get_coordinates(shapely.point_on_surface(shapely.get_parts(target)))])
    spots = shapely.points(points)
    inside = shapely.contains(target, spots)
    open_ = np.zeros(len(points), bool) if left.is_empty else shapely.distance(left, spots) == 0
    seen = _seen(points, survey, chosen)
    found = []
    missed = int((inside & ~open_ & ~seen).sum())
    if missed:
        found.append(f"coverage: {missed} of {int(inside.sum())} cells are said to be covered and are not")
    # Wind and a nose across lanes make the plan's footprint smaller than a picture's at any one moment.
    if not left.is_empty and chosen.model.wind_m_s == 0.0 and not chosen.fixed_heading:
        deep = shapely.contains(left.buffer(-max(cell, 0.03 * chosen.height_m)), spots)
        if (deep & seen).any():
            found.append(f"coverage: {int((deep & seen).sum())} cells are said to be uncovered and are seen")
    return found


def _seen(points: FloatArray, survey: Survey, chosen: SurveySettings) -> npt.NDArray[np.bool_]:
    shots, headings = counted_shots(survey.lanes, survey.spacing)
    if chosen.fixed_heading:
        nose = survey.headings_deg[0] if chosen.nose_deg is None else chosen.nose_deg
        headings = np.full(len(shots), math.radians(nose))
    seen = np.zeros(len(points), bool)
    for place, heading in zip(shots, headings, strict=True):
        near = np.flatnonzero(~seen & (np.hypot(*(points - place).T) < 1.1 * chosen.height_m))
        if len(near):
            seen[near] = surely_sees(
                points[near] - place, float(heading), chosen.optics, chosen.height_m, chosen.tolerances
            )
    return seen


def surely_sees(
    offset: FloatArray, heading_rad: float, optics: Optics, height_m: float, off: Tolerances
) -> npt.NDArray[np.bool_]:
    """Return which ``(N, 2)`` places from the plumb point a picture shows, however the tolerances fall."""
    ok = np.ones(len(offset), bool)
    limits = np.array([optics.width_px, optics.height_px]) / 2 / optics.focal_px
    for turn in (-1, 0, 1):
        a = heading_rad + turn * math.radians(off.heading_deg)
        across = offset @ [math.cos(a), -math.sin(a)]
        along = offset @ [math.sin(a), math.cos(a)]
        for shift_x, shift_y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            for share in (-1, 1):
                down = np.full(len(offset), height_m * (1 + share * off.height_share))
                ray = np.stack(
                    [across + shift_x * off.cross_track_m, along + shift_y * off.cross_track_m, down], axis=1
                )
                for axis, tilt in ((0, -1), (0, 1), (1, -1), (1, 1)):
                    b = tilt * math.radians(off.tilt_deg)
                    lean = ray.copy()
                    lean[:, axis] = ray[:, axis] * math.cos(b) + ray[:, 2] * math.sin(b)
                    lean[:, 2] = ray[:, 2] * math.cos(b) - ray[:, axis] * math.sin(b)
                    ok &= (np.abs(lean[:, :2] / lean[:, 2:]) <= limits).all(axis=1)
    return ok


def measure(count: int, seed: int = SEED, first: int = 0) -> dict[str, object]:
    """Plan ``count`` areas and return the figures."""
    ends: Counter[str] = Counter()
    kinds: Counter[str] = Counter({"crash": 0, "coverage": 0, "zone": 0, "inset": 0, "endurance": 0, "again": 0})
    told: list[str] = []
    began = time.perf_counter()
    for asked in random_areas(count, seed, first):
        end, wrong = faults(asked)
        ends[end] += 1
        for words in wrong:
            kinds[words.split(":")[0]] += 1
            told.append(f"area {asked.number}: {words}")
        done = asked.number - first + 1
        if done % _SAY_EVERY == 0:
            left_s = (time.perf_counter() - began) / done * (count - done)
            print(f"{done} of {count} areas, {len(told)} faults, {left_s:.0f} s left", file=sys.stderr)
    return {
        "areas": count,
        "seed": seed,
        "planned": ends["planned"],
        "refused": ends["refused"],
        "faults": dict(kinds),
        "told": told,
        "seconds": round(time.perf_counter() - began, 1),
    }


def main() -> int:
    """Print the figures; exit code 1 on any fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--areas", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="number of the first area")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    found = measure(chosen.areas, chosen.seed, chosen.first)
    if chosen.json:
        print(json.dumps(found, indent=1))
    else:
        print(
            f"{found['areas']} areas: {found['planned']} planned, {found['refused']} refused in words, in "
            f"{found['seconds']} s"
        )
        print("faults: " + ", ".join(f"{name} {n}" for name, n in dict(found["faults"]).items()))  # type: ignore[call-overload]
        for words in list(found["told"])[:40]:  # type: ignore[call-overload]
            print(words)
    return 1 if found["told"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
