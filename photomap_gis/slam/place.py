"""From solved poses to placements: what mosaic, live, export and report know of a frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import PoseGraph, Solution, Trajectory

MAX_OFF_NADIR_RAD = math.radians(35.0)
GPS_METHOD = "gps"


def placements(
    solution: Solution,
    graph: PoseGraph,
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    *,
    max_off_nadir_rad: float = MAX_OFF_NADIR_RAD,
) -> Trajectory:
    """Return the placement of every frame with a pose and a view, in the order of ``frames``.

    A frame is ``registered`` where an edge that the solver kept ties it to another placed frame, else ``gps_only``
    (without a fix either it has no pose). ``oblique`` frames look more than ``max_off_nadir_rad`` off nadir by their
    reported attitude, whatever else ties them. ``method`` is that of most of a frame's edges.
    """
    poses = {p.frame: p for p in solution.poses}
    rejected = set(solution.rejected)
    methods: dict[int, Counter[str]] = {}
    for k, e in enumerate(graph.edges):
        if k not in rejected and e.a in poses and e.b in poses:
            for frame in (e.a, e.b):
                methods.setdefault(frame, Counter())[e.method] += 1
    out = []
    for ref in frames:
        pose, view = poses.get(ref.index), views.get(ref.index)
        if pose is None or view is None:
            continue
        tied = methods.get(ref.index)
        # ties of the counter are broken by name: the same graph gives the same word
        method = min(tied, key=lambda m: (-tied[m], m)) if tied else GPS_METHOD
        status = FrameStatus.REGISTERED if tied else FrameStatus.GPS_ONLY
        if ref.attitude is not None and ref.attitude.off_nadir_rad > max_off_nadir_rad:
            status = FrameStatus.OBLIQUE
        placement = PlanePlacement(view, pose.T_map_plane)
        out.append(
            FramePlacement(
                ref.index, ref.width_px, ref.height_px, placement, pose.covariance, status, pose.segment, method
            )
        )
    return Trajectory(tuple(out), solution.revision)
