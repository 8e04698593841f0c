"""The pose graph for other programs: g2o for solvers, GeoJSON for a GIS.

g2o knows poses of the plane (x, y, theta), not similarities. So the scale is taken out: lengths are map metres (pixels
of the first frame for a map without a place on Earth), an edge's translation and covariance are multiplied by the
solved ground sampling distance of the frame that they are in, and what the edge says of the scale stands in comments at
the file's end: ``# EDGE_LOG_SCALE a b value sigma``, ``# VERTEX_LOG_SCALE id value``. Axes are those of solvers: x
east, y **north**, angles counter-clockwise (the product's own are image-handed).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from photomap_gis.core.errors import OutputError
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import PoseGraph, Solution
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.crs import WGS84, needs_place, point_map
from photomap_gis.export.publish import file_in_place_of

_DEGREE_DIGITS = 9
_FLIP = np.array([1.0, -1.0, -1.0])
"""From image-handed (x, y, theta) to x east, y north, counter-clockwise."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedGraph:
    """A graph with its solution, that of its sequential edges alone, and what the solution makes of its edges.

    ``misfit_sigmas`` ``(E,)`` is how far each edge lies from the solution (about 1 where it is as good as it says; NaN
    where an end has no pose). ``names`` are by frame.
    """

    graph: PoseGraph
    solution: Solution
    sequential: Solution
    misfit_sigmas: FloatArray
    map_frame: MapFrame
    names: Mapping[int, str] = field(default_factory=dict)


def write_g2o(solved: SolvedGraph, path: Path) -> None:
    """Write poses and edges as ``VERTEX_SE2`` and ``EDGE_SE2``; edges that the solver put aside are comments."""
    text = "\n".join(_g2o_lines(solved)) + "\n"
    with file_in_place_of(path.absolute()) as temporary:
        temporary.write_text(text, encoding="ascii")


def write_graph_geojson(solved: SolvedGraph, path: Path) -> None:
    """Write frames as points and edges as lines, WGS84 (RFC 7946); raises ``NotGeoreferencedError`` without a place."""
    document = _geojson(solved)
    count = len(document["features"])

    def check(temporary: Path) -> None:
        if len(json.loads(temporary.read_text(encoding="utf-8"))["features"]) != count:
            raise OutputError(f"{path} is damaged after writing; check the disk")

    with file_in_place_of(path.absolute(), check) as temporary:
        text = json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1)
        temporary.write_text(text, encoding="utf-8")


def _g2o_lines(solved: SolvedGraph) -> list[str]:
    poses = {p.frame: p.T_map_plane for p in solved.solution.poses}
    rejected = set(solved.solution.rejected)
    unit = "pixels of the first frame" if solved.map_frame.crs_wkt is None else "metres"
    vertices, edges, fixed = [], [], []
    comments = [
        f"# photomap pose graph: similarities with the scale taken out; {unit}, x east, y north, angles in radians",
        "# the frames' planes have y up too; information is about the origin of the second frame's plane",
    ]
    segments: set[int] = set()
    for p in sorted(solved.solution.poses, key=lambda p: p.frame):
        t = p.T_map_plane
        vertices.append(f"VERTEX_SE2 {p.frame} {t.tx:.9g} {-t.ty:.9g} {-t.angle_rad:.9g}")
        comments.append(f"# VERTEX_LOG_SCALE {p.frame} {t.log_scale:.9g}")
        if p.segment not in segments:
            segments.add(p.segment)
            fixed.append(f"FIX {p.frame}")
    for k, e in enumerate(solved.graph.edges):
        if e.a not in poses or e.b not in poses:
            continue
        in_metres = np.array([poses[e.b].scale, poses[e.b].scale, 1.0])
        # what is known of x, y, theta when the scale is anything: the marginal, not the conditional
        covariance = e.covariance[:3, :3] * np.outer(in_metres, in_metres) * np.outer(_FLIP, _FLIP)
        information = np.linalg.inv(covariance)
        x, y = poses[e.a].scale * e.T_a_b.translation
        upper = " ".join(f"{v:.9g}" for v in information[np.triu_indices(3)])
        line = f"EDGE_SE2 {e.a} {e.b} {x:.9g} {-y:.9g} {-e.T_a_b.angle_rad:.9g} {upper}"
        if k in rejected:
            comments.append(f"# put aside: {line}")
        else:
            edges.append(line)
        sigma = math.sqrt(float(e.covariance[3, 3]))
        comments.append(f"# EDGE_LOG_SCALE {e.a} {e.b} {e.T_a_b.log_scale:.9g} {sigma:.3g}")
    # gtsam's reader gives up at the first line that is neither vertex nor edge: those come first
    return [*vertices, *edges, *fixed, *comments]


def _geojson(solved: SolvedGraph) -> dict[str, Any]:
    crs_wkt = needs_place(solved.map_frame.crs_wkt, "GeoJSON")
    poses = sorted(solved.solution.poses, key=lambda p: p.frame)
    en = solved.map_frame.to_crs(np.array([p.T_map_plane.translation for p in poses]).reshape(-1, 2))
    lon_lat = point_map(crs_wkt, WGS84, around_xy=en)(en) if len(en) else en
    at = {p.frame: [round(float(v), _DEGREE_DIGITS) for v in q] for p, q in zip(poses, lon_lat, strict=True)}
    rejected = set(solved.solution.rejected)
    features: list[dict[str, Any]] = []
    for p in poses:
        linear = p.T_map_plane.linear
        variance = np.diag(linear @ p.covariance[:2, :2] @ linear.T)
        features.append(
            _feature(
                {"type": "Point", "coordinates": at[p.frame]},
                element="frame", frame=p.frame, name=solved.names.get(p.frame, str(p.frame)), segment=p.segment,
                sigma_e_m=_rounded(math.sqrt(variance[0])), sigma_n_m=_rounded(math.sqrt(variance[1])),
            )
        )  # fmt: skip
    for k, e in enumerate(solved.graph.edges):
        if e.a not in at or e.b not in at:
            continue
        line = {"type": "LineString", "coordinates": [at[e.a], at[e.b]]}
        residual = _rounded(float(solved.misfit_sigmas[k]))
        features.append(
            _feature(
                line, element="edge", a=e.a, b=e.b, kind=e.kind.value, method=e.method, kept=k not in rejected,
                probability=round(e.probability, 4), overlap=round(e.overlap, 3), residual_sigmas=residual,
            )
        )  # fmt: skip
    return {"type": "FeatureCollection", "features": features}


def _feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _rounded(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None
