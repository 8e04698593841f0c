"""The accuracy of a map: tested by check points that never entered its fit, or predicted by its covariances.

Words are kept apart: a *residual* says how well fit and measurement agree; an *accuracy* is tested by points that had
no part in the fit. NSSDA is FGDC-STD-007.3: the error that 95 % of well-defined points do not exceed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray

CE90_PER_RMSE_R = 1.5175
"""CE90 = 1.5175 RMSE_r where the errors of x and y are about alike (FGDC-STD-007.3, appendix 3-A)."""
NSSDA_PER_RMSE_R = 1.7308
"""The same at 95 %: 1.7308 RMSE_r."""
STANDARD_COUNT = 20
"""How many check points the standard demands."""


@dataclass(frozen=True, slots=True)
class PointMiss:
    """How far off the map shows a known point: map minus given place, metres east and north.

    ``sigma_m`` is what was predicted for it per axis (map, survey and click together), ``d2`` the squared miss in units
    of that covariance. Of several pictures that show the point, it is the one nearest whose middle it lies.
    """

    name: str
    east_m: float
    north_m: float
    sigma_m: float
    d2: float
    sightings: int = 1

    @property
    def miss_m(self) -> float:
        """Its distance."""
        return math.hypot(self.east_m, self.north_m)


@dataclass(frozen=True, slots=True)
class CheckedAccuracy:
    """What check points say of the map, metres; ``nees_per_dof`` is 1 where the predicted sigmas are true."""

    n: int
    rmse_x_m: float
    rmse_y_m: float
    rmse_r_m: float
    mean_east_m: float
    mean_north_m: float
    ce90_m: float
    nssda_95_m: float
    nees_per_dof: float

    @property
    def meets_standard(self) -> bool:
        """Whether there are as many check points as the standard demands."""
        return self.n >= STANDARD_COUNT

    @property
    def method(self) -> str:
        """How it was found, in one line."""
        few = "" if self.meets_standard else f"; the standard demands {STANDARD_COUNT} or more"
        points = "1 check point" if self.n == 1 else f"{self.n} check points"
        return f"{points} outside the fit, NSSDA = 1.7308 RMSE_r at 95 %, CE90 = 1.5175 RMSE_r{few}"


def checked_accuracy(misses: Sequence[PointMiss]) -> CheckedAccuracy | None:
    """Return the accuracy by check points; ``None`` where there is none."""
    if not misses:
        return None
    d = np.array([(m.east_m, m.north_m) for m in misses])
    x, y = np.sqrt(np.mean(d**2, axis=0)).tolist()
    r = math.hypot(x, y)
    east, north = d.mean(axis=0).tolist()
    nees = float(np.mean([m.d2 for m in misses])) / 2.0
    return CheckedAccuracy(len(misses), x, y, r, east, north, CE90_PER_RMSE_R * r, NSSDA_PER_RMSE_R * r, nees)


def predicted_covariance_m2(trajectory: Trajectory, xy_map_m: npt.ArrayLike) -> FloatArray:
    """``(N, 2, 2)`` covariance (x east, y south) of the map at ``(N, 2)`` points; NaN where no frame shows them.

    Of the frames that cover a point it is the one that is placed best there (least trace).
    """
    return covariance_by_placements_m2(trajectory.placements, xy_map_m)


def covariance_by_placements_m2(placements: Sequence[FramePlacement], xy_map_m: npt.ArrayLike) -> FloatArray:
    """``(N, 2, 2)`` the same by the placements of a solution."""
    points = np.atleast_2d(np.asarray(xy_map_m, dtype=np.float64))
    best = np.full((len(points), 2, 2), np.nan)
    least = np.full(len(points), np.inf)
    for p in placements:
        px = p.camera_to_map.unproject(points)
        inside = np.isfinite(px).all(axis=1) & ((px >= -0.5) & (px <= (p.width_px - 0.5, p.height_px - 0.5))).all(
            axis=1
        )
        rows = np.flatnonzero(inside)
        if not len(rows):
            continue
        covariance = p.position_covariance_m2(px[rows])
        trace = np.trace(covariance, axis1=1, axis2=2)
        better = trace < least[rows]
        best[rows[better]], least[rows[better]] = covariance[better], trace[better]
    return best


def predicted_sigma_m(trajectory: Trajectory, xy_map_m: npt.ArrayLike) -> FloatArray:
    """``(N,)`` predicted one sigma per axis of the map at ``(N, 2)`` points, metres; NaN where no frame shows them."""
    return np.asarray(np.sqrt(np.trace(predicted_covariance_m2(trajectory, xy_map_m), axis1=1, axis2=2) / 2.0))
