"""How likely a search finds what it looks for: coverage factor and probability of detection.

The coverage factor is C = W / S for parallel tracks, and C = W L / A for any track of length L over an area A, with
sweep width W and track spacing S [IAMSAR Manual II, 4.6]. Two models of the probability of detection are told:

- random search, POD = 1 - exp(-C): tracks that lie anyhow; the careful figure [Koopman 1946, OEG Report 56];
- inverse cube law, POD = erf(sqrt(pi) / 2 C): even tracks and a look that fades with the cube of the distance, the
  curve for ideal conditions in search manuals [same].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from photomap_gis.core.errors import UsageError

TARGET_PX = 8.0
"""A target must span this many pixels to be found (the issue's hazard card)."""


@dataclass(frozen=True, slots=True)
class Detection:
    """What a search is worth; shares are 0 to 1."""

    sweep_width_m: float
    track_spacing_m: float
    coverage_factor: float
    pod_random: float
    pod_inverse_cube: float


def detection(
    sweep_width_m: float, track_spacing_m: float, *, length_m: float | None = None, area_m2: float | None = None
) -> Detection:
    """Return coverage factor and probabilities: by the spacing, or by length and area where both are given."""
    _above_zero("--sweep-width", sweep_width_m)
    _above_zero("--track-spacing", track_spacing_m)
    factor = sweep_width_m / track_spacing_m
    if length_m is not None and area_m2:
        factor = sweep_width_m * length_m / area_m2
    return Detection(sweep_width_m, track_spacing_m, factor, pod_random(factor), pod_inverse_cube(factor))


def pod_random(coverage_factor: float) -> float:
    """Koopman's random search.

    >>> round(pod_random(1.0), 3)
    0.632
    """
    return -math.expm1(-coverage_factor)


def pod_inverse_cube(coverage_factor: float) -> float:
    """The inverse cube law.

    >>> round(pod_inverse_cube(1.0), 2)
    0.79
    """
    return math.erf(math.sqrt(math.pi) / 2.0 * coverage_factor)


def spacing_m(sweep_width_m: float, coverage_factor: float) -> float:
    """Return the track spacing S = W / C that gives a coverage factor."""
    _above_zero("--sweep-width", sweep_width_m)
    _above_zero("--coverage-factor", coverage_factor)
    return sweep_width_m / coverage_factor


def sweep_width_m(height_m: float, focal_px: float, width_px: int, target_m: float) -> float:
    """Return the sweep width of a camera that looks straight down: its swath, where it resolves the target.

    Raises ``UsageError`` where the target spans fewer than ``TARGET_PX`` pixels from that height.
    """
    gsd = height_m / focal_px
    if gsd * TARGET_PX > target_m * (1 + 1e-9):
        raise UsageError(
            f"from {height_m:.0f} m a target of {target_m:g} m spans {target_m / gsd:.1f} pixels, fewer than "
            f"{TARGET_PX:.0f}: fly at {target_m * focal_px / TARGET_PX:.0f} m or lower"
        )
    return gsd * width_px


def _above_zero(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise UsageError(f"{name} must be above 0, got {value:g}")
