"""How far each edge of a graph lies from a solution, in its own sigmas."""

from __future__ import annotations

import numpy as np

from photomap_gis.core.posegraph import PoseGraph, Solution
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.linear import edge_residuals, squared_distances
from photomap_gis.slam.problem import DriftTerms, PositionTerms, Problem, ScalarTerms, State, edge_terms

DOF_COUNT = 4


def edge_misfits(graph: PoseGraph, solution: Solution) -> FloatArray:
    """``(E,)`` root of chi squared per degree of freedom of every edge; NaN where an end has no pose.

    Edges that are as good as they say lie about 1, whatever the solver made of them.
    """
    out = np.full(len(graph.edges), np.nan)
    poses = {p.frame: p.T_map_plane for p in solution.poses}
    rows = [k for k, e in enumerate(graph.edges) if e.a in poses and e.b in poses]
    if not rows:
        return out
    frames = sorted(poses)
    node_of = {f: k for k, f in enumerate(frames)}
    terms = edge_terms([graph.edges[k] for k in rows], node_of)
    none = np.zeros(0)
    nobody = none.astype(np.intp)
    no_fix = PositionTerms(nobody, none.astype(complex), np.zeros((0, 2, 2)), nobody, nobody, nobody, none)
    no_scalar = ScalarTerms.of([], [], [])
    problem = Problem(
        len(frames), terms, no_fix, DriftTerms(nobody, none, none), none, no_scalar, no_scalar, nobody
    )  # fmt: skip
    w = np.array([complex(poses[f].log_scale, poses[f].angle_rad) for f in frames])
    t = np.array([complex(poses[f].tx, poses[f].ty) for f in frames])
    residuals = edge_residuals(problem, State.of_poses(w, t, problem))
    out[rows] = np.sqrt(squared_distances(residuals, terms.information) / DOF_COUNT)
    return out
