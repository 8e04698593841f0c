"""Plainer planners to be measured against, each with our overlaps, height and camera.

``grid`` is a sweep as ground stations make it (QGroundControl's survey): lanes at the asked spacing over the bounding
box about its middle, cut at the polygon's edge, flown to the edge, one after the other. ``angle`` None takes, to be
generous, the angle of all edges and every ten degrees whose flight is the shortest.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import LineString

from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.lanes import Lane, candidate_headings, turned
from photomap_gis.mission_planner.optics import Spacing


def grid(polygon: shapely.Polygon, spacing: Spacing, model: FlightModel, heading_rad: float | None) -> list[Lane]:
    if heading_rad is not None:
        return _sweep(polygon, spacing, heading_rad)
    headings = {float(h) for h in candidate_headings(polygon)} | set(np.radians(np.arange(0, 180, 10)))
    plans = [_sweep(polygon, spacing, h) for h in sorted(headings)]
    return min(plans, key=lambda lanes: flight_s(lanes, model))


def _sweep(polygon: shapely.Polygon, spacing: Spacing, heading_rad: float) -> list[Lane]:
    flat = turned(polygon, heading_rad)
    west, south, east, north = flat.bounds
    count = math.ceil((east - west) / spacing.lane_m)
    xs = (west + east) / 2.0 + (np.arange(count) - (count - 1) / 2.0) * spacing.lane_m
    back = np.array([[math.cos(heading_rad), -math.sin(heading_rad)], [math.sin(heading_rad), math.cos(heading_rad)]])
    lanes: list[Lane] = []
    for number, x in enumerate(xs):
        cut = LineString([(x, south - 1), (x, north + 1)]).intersection(flat)
        pieces = [np.asarray(g.coords) for g in shapely.get_parts(cut) if g.length > 0.1]
        pieces = sorted((p[np.argsort(p[:, 1])] for p in pieces), key=lambda p: p[0, 1])
        if number % 2:
            pieces = [p[::-1] for p in pieces[::-1]]
        lanes += [Lane(p @ back) for p in pieces]
    return lanes


def flight_s(lanes: list[Lane], model: FlightModel) -> float:
    """Seconds of a plan from its first lane's start and back there: one model for everybody."""
    xy = np.concatenate([*(lane.xy for lane in lanes), lanes[0].xy[:1]])
    survey = np.zeros(len(xy) - 1, bool)
    k = 0
    for lane in lanes:
        survey[k : k + len(lane.xy) - 1] = True
        k += len(lane.xy)
    return model.path_s(xy, survey)
