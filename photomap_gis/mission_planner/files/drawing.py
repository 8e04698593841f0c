"""What a GIS draws of a plan: ``plan_geojson`` with each picture's ground and the ground that is sure to be seen."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import shapely

from photomap_gis.core.plan import GeoPolygon, SurveyPlan
from photomap_gis.mission_planner.files.geojson import feature, plan_features, rings_of
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.shots import PlannedShot, footprint_ring, planned_shots

Json = dict[str, Any]

MOST_FOOTPRINTS = 2000
"""More are thinned evenly: a map that shows them all shows none, and a preview must be quick."""


def plan_drawing(plan: SurveyPlan, optics: Optics, height_m: float, *, most_footprints: int = MOST_FOOTPRINTS) -> str:
    """Return a FeatureCollection: the features of ``plan_geojson``, and of ``kind`` ``covered`` and ``footprint``.

    ``covered`` is the area less what is avoided or not sure to be seen. A ``footprint`` is the ground of a level
    picture from ``height_m`` above ground, without tolerances; of more than ``most_footprints`` every n-th is drawn,
    and ``footprints_every`` says n. Pictures that look ahead have none.
    """
    frame = _frame(plan)
    shots = [shot for shot in planned_shots(plan, frame) if shot.looks_down]
    every = max(1, math.ceil(len(shots) / most_footprints))
    features = [*plan_features(plan), *_covered(plan), *_footprints(shots, every, frame, optics, height_m)]
    collection = {
        "type": "FeatureCollection",
        "pattern": plan.pattern,
        "covered_share": plan.covered_share,
        "gsd_m_per_px": plan.gsd_m_per_px,
        "height_m": height_m,
        "footprints_every": every,
        "features": features,
    }
    return json.dumps(collection, allow_nan=False) + "\n"


def _frame(plan: SurveyPlan) -> LocalFrame:
    first = plan.sorties[0].waypoints[0] if plan.sorties else None
    return LocalFrame.about(first.lat_deg, first.lon_deg) if first is not None else LocalFrame.about(0.0, 0.0)


def _covered(plan: SurveyPlan) -> Iterator[Json]:
    whole = shapely.union_all([_polygon(p) for p in plan.area])
    without = shapely.union_all([_polygon(p) for p in (*plan.avoid, *plan.uncovered)])
    for part in shapely.get_parts(whole.difference(without)):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            rings = [[[x, y] for x, y in ring.coords] for ring in (part.exterior, *part.interiors)]
            yield feature({"type": "Polygon", "coordinates": rings}, kind="covered")


def _polygon(polygon: GeoPolygon) -> Any:
    """In degrees: what is cut here was made of the same vertices, so that nothing bends."""
    shell, *holes = rings_of(polygon)
    return shapely.make_valid(shapely.Polygon(shell, holes))


def _footprints(
    shots: list[PlannedShot], every: int, frame: LocalFrame, optics: Optics, height_m: float
) -> Iterator[Json]:
    for number in range(0, len(shots), every):
        shot = shots[number]
        ring = [
            [round(float(lon), 8), round(float(lat), 8)]
            for lat, lon in frame.to_lat_lon(footprint_ring(shot, optics, height_m))
        ]
        if max(p[0] for p in ring) - min(p[0] for p in ring) > 180.0:  # across the antimeridian: longitudes run on
            ring = [[lon + 360.0 if lon < 0 else lon, lat] for lon, lat in ring]
        yield feature(
            {"type": "Polygon", "coordinates": [ring]}, kind="footprint", sortie=shot.sortie, photo=number + 1
        )
