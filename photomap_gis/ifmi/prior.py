"""What is known of a motion before the pictures are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass

from photomap_gis.core.similarity import FloatArray, Similarity2D, wrap_angle

GATE_SIGMAS = 3.5


@dataclass(frozen=True, slots=True)
class Prior:
    """An expected motion ``T_a_b`` in the spectra's pixels, with one-sigmas that restrict the search.

    ``sigma_xy_px`` is per axis, of where the centre of b lies in a. A registration more than 3.5 sigmas from its
    prior is not accepted.
    """

    T_a_b: Similarity2D
    sigma_xy_px: float
    sigma_angle_rad: float
    sigma_log_scale: float

    def __post_init__(self) -> None:
        for name in ("sigma_xy_px", "sigma_angle_rad", "sigma_log_scale"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    def restricts(self, size_px: tuple[int, int]) -> bool:
        """Whether the gate is so much smaller than the frame that only its inside need be searched."""
        return (
            GATE_SIGMAS * self.sigma_xy_px < 0.5 * max(size_px)
            and GATE_SIGMAS * self.sigma_angle_rad < math.radians(60.0)
            and GATE_SIGMAS * self.sigma_log_scale < 0.5
        )

    def centre_within(self, size_b_px: tuple[int, int]) -> tuple[FloatArray, float]:
        """Return where in a the centre of b is expected, and how far from there at most it is admitted."""
        centre = self.T_a_b.apply(((size_b_px[0] - 1) / 2.0, (size_b_px[1] - 1) / 2.0))
        return centre, GATE_SIGMAS * self.sigma_xy_px + 1.0

    def admits(self, T_a_b: Similarity2D, size_b_px: tuple[int, int]) -> bool:
        """Whether a motion lies within the gate (a pixel, a third of a degree and half a percent are granted)."""
        expected, furthest_px = self.centre_within(size_b_px)
        d = T_a_b.apply(((size_b_px[0] - 1) / 2.0, (size_b_px[1] - 1) / 2.0)) - expected
        return (
            math.hypot(float(d[0]), float(d[1])) <= furthest_px
            and abs(wrap_angle(T_a_b.angle_rad - self.T_a_b.angle_rad)) <= GATE_SIGMAS * self.sigma_angle_rad + 0.006
            and abs(T_a_b.log_scale - self.T_a_b.log_scale) <= GATE_SIGMAS * self.sigma_log_scale + 0.005
        )
