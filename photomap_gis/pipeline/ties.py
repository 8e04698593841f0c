"""What a mission's ties to existing imagery say to the solver and to the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.posegraph import PointKind, PointObservation
from photomap_gis.core.tie import ReferenceTies


def reference_points(references: Sequence[ReferenceTies], views: Mapping[int, PlaneView]) -> list[PointObservation]:
    """Return the kept ties as points of known place; ``views`` level each frame as the graph's edges do."""
    out = []
    for r in references:
        place = np.eye(2) * r.sigma_m**2
        for t in r.kept:
            if t.frame not in views:
                continue
            planes = views[t.frame].to_plane(np.array(t.xy_px))
            # The picture's side is told in pixels of the plane: by how many metres the tie's points are apart.
            spread_m, spread_px = (float(np.std(np.asarray(p), axis=0).sum()) for p in (t.xy_map_m, planes))
            sigma_px = t.sigma_m * spread_px / max(spread_m, 1e-9)
            for xy_px, plane, xy_m in zip(t.xy_px, planes, t.xy_map_m, strict=True):
                out.append(
                    PointObservation(
                        t.frame, np.array(xy_px), plane, np.array(xy_m), place, sigma_px, r.path,
                        kind=PointKind.REFERENCE,
                    )
                )  # fmt: skip
    return out


def reference_warnings(references: Sequence[ReferenceTies]) -> list[str]:
    """Return a warning for every reference in which nothing was found."""
    return [f"reference {Path(r.path).name}: {r.word}" for r in references if not r.kept]
