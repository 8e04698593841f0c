"""How long a multirotor takes: legs with acceleration, corners, wind, take-off and landing.

One model for planning, for sorties and for the benchmark. A vehicle holds ``speed_m_s`` through the air, slows down
for a corner to the part of its speed that points along the next leg (a stop from a right angle on), and needs
``accel_m_s2`` for every change. Wind carries it: over the ground a leg is flown at V cos(crab) + w_along, where
sin(crab) = w_cross / V.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import UsageError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightModel:
    """Speeds in metres a second; wind is where the air moves **to**, east and north."""

    speed_m_s: float = 10.0
    accel_m_s2: float = 2.5
    climb_m_s: float = 3.0
    descent_m_s: float = 1.5
    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0
    most_ground_speed_m_s: float = math.inf
    """What blur and the camera's shortest interval allow."""
    hover_s: float = 1.5
    """Standing still for one picture."""

    def __post_init__(self) -> None:
        if not 0.1 <= self.speed_m_s <= 100.0:
            raise UsageError(f"--speed must lie in 0.1 to 100 m/s, got {self.speed_m_s:g}")
        if self.wind_m_s >= 0.95 * self.speed_m_s:
            raise UsageError(
                f"a wind of {self.wind_m_s:g} m/s is no weather for {self.speed_m_s:g} m/s through the air: "
                "fly faster (--speed) or wait"
            )

    @property
    def wind_m_s(self) -> float:
        """The wind's speed."""
        return math.hypot(self.wind_east_m_s, self.wind_north_m_s)

    def crab_deg(self, heading_rad: float) -> float:
        """Return by how much the nose points off a track of this heading (clockwise from north)."""
        east, north = math.sin(heading_rad), math.cos(heading_rad)
        cross = self.wind_east_m_s * north - self.wind_north_m_s * east
        return math.degrees(math.asin(abs(cross) / self.speed_m_s))

    def ground_speed(self, direction_en: npt.ArrayLike, *, survey: bool = False) -> FloatArray:
        """Return the speed over the ground along ``(..., 2)`` unit vectors east, north."""
        d = np.asarray(direction_en, np.float64)
        along = d[..., 0] * self.wind_east_m_s + d[..., 1] * self.wind_north_m_s
        cross = d[..., 1] * self.wind_east_m_s - d[..., 0] * self.wind_north_m_s
        speed = np.sqrt(np.maximum(self.speed_m_s**2 - cross**2, 0.0)) + along
        return np.minimum(speed, self.most_ground_speed_m_s) if survey else speed

    def path_s(self, xy: npt.ArrayLike, survey: npt.ArrayLike | None = None) -> float:
        """Return the seconds for a path of ``(N, 2)`` points, rest to rest; ``survey`` ``(N-1,)`` marks camera legs."""
        p = np.asarray(xy, np.float64)
        if len(p) < 2:
            return 0.0
        on = np.zeros(len(p) - 1, bool) if survey is None else np.asarray(survey, bool)
        legs = np.diff(p, axis=0)
        length = np.hypot(legs[:, 0], legs[:, 1])
        keep = length > 1e-6
        legs, length, on = legs[keep], length[keep], on[keep]
        if not len(legs):
            return 0.0
        u = legs / length[:, None]
        v = np.where(on, self.ground_speed(u, survey=True), self.ground_speed(u))
        corner = np.zeros(len(v) + 1)
        corner[1:-1] = np.minimum(v[:-1], v[1:]) * np.maximum(np.sum(u[:-1] * u[1:], axis=1), 0.0)
        # No leg is too short to slow down on: sweep back and forth.
        for i in range(len(v) - 1, 0, -1):
            corner[i] = min(corner[i], math.sqrt(corner[i + 1] ** 2 + 2 * self.accel_m_s2 * length[i]))
        for i in range(len(v) - 1):
            corner[i + 1] = min(corner[i + 1], math.sqrt(corner[i] ** 2 + 2 * self.accel_m_s2 * length[i]))
        return float(np.sum(self.leg_s(length, v, corner[:-1], corner[1:])))

    def leg_s(
        self, length_m: npt.ArrayLike, cruise: npt.ArrayLike, enter: npt.ArrayLike = 0.0, leave: npt.ArrayLike = 0.0
    ) -> FloatArray:
        """Return the seconds of straight legs by a trapezoidal profile of speed; arrays broadcast."""
        length, v, v0, v1 = (np.asarray(a, np.float64) for a in (length_m, cruise, enter, leave))
        a = self.accel_m_s2
        peak = np.minimum(v, np.sqrt(np.maximum((2 * a * length + v0**2 + v1**2) / 2, 1e-12)))
        peak = np.maximum(peak, np.maximum(np.maximum(v0, v1), 1e-6))
        ramps = (2 * peak**2 - v0**2 - v1**2) / (2 * a)
        return (2 * peak - v0 - v1) / a + np.maximum(length - ramps, 0.0) / peak

    def vertical_s(self, up_m: float, down_m: float) -> float:
        """Return the seconds for climbing and descending."""
        return up_m / self.climb_m_s + down_m / self.descent_m_s
