"""Lay a lawnmower pattern on the ground: how high, how many strips, where each frame is taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.errors import UsageError
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.spec import FlightSpec

HIGHEST_M = 3000.0


@dataclass(frozen=True, slots=True)
class Pattern:
    """Strips of equally spaced stations about a centre; lengths in metres, ``frames`` in all.

    ``margin_m`` is what jitter and wander may add to the footprints on each side.
    """

    frames: int
    altitude_m: float
    strips: int
    stations: int
    along_step_m: float
    across_step_m: float
    heading_rad: float
    footprint_m: tuple[float, float]
    margin_m: float

    @property
    def extent_m(self) -> tuple[float, float]:
        """What the footprints cover across and along the strips, margins included."""
        across = (self.strips - 1) * self.across_step_m + self.footprint_m[0] + 2 * self.margin_m
        along = (self.stations - 1) * self.along_step_m + self.footprint_m[1] + 2 * self.margin_m
        return across, along

    @property
    def box_m(self) -> tuple[float, float]:
        """Width (east) and height (north) of the upright box about the turned pattern."""
        across, along = self.extent_m
        c, s = abs(math.cos(self.heading_rad)), abs(math.sin(self.heading_rad))
        return across * c + along * s, across * s + along * c

    def fits(self, room_m: tuple[float, float]) -> bool:
        """Whether the pattern lies within a ground of a width and height."""
        box = self.box_m
        return box[0] <= room_m[0] + 1e-9 and box[1] <= room_m[1] + 1e-9

    def turn_points(self, *, lead_m: float = 0.0) -> FloatArray:
        """``(2 strips, 2)`` east, north of the ends of each strip about the centre, in the order flown.

        ``lead_m`` flies on beyond each strip's end, so that turns lie outside of it.
        """
        half_along = (self.stations - 1) * self.along_step_m / 2.0 + lead_m
        across = (np.arange(self.strips) - (self.strips - 1) / 2.0) * self.across_step_m
        points = []
        for k, side in enumerate(across):
            ends = [(side, -half_along), (side, half_along)]
            points += ends if k % 2 == 0 else ends[::-1]
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        # along the heading is (sin, cos) in east, north; across, to its right, is (cos, -sin)
        return np.asarray(np.asarray(points) @ np.array([[c, -s], [s, c]]))


def plan_pattern(
    spec: FlightSpec, frames: int, heading_rad: float, *, room_m: tuple[float, float] | None, video: bool
) -> Pattern:
    """Return the pattern that fills the room best, or at a given altitude the most compact one that fits.

    ``room_m`` is the ground's width and height; ``None`` where the ground will be made to fit (then an altitude of
    100 m is taken unless one is given). ``UsageError`` says what would fit where nothing does.
    """
    if room_m is None or spec.altitude_m is not None:
        altitude = spec.altitude_m or 100.0
        choices = [_pattern(spec, frames, n, altitude, heading_rad, video=video) for n in _strip_counts(frames, video)]
        if room_m is not None:
            choices = [c for c in choices if c.fits(room_m)]
        if not choices:
            highest = _fill(spec, frames, heading_rad, room_m or (0.0, 0.0), video=video)
            advice = f"at most {highest.altitude_m:.0f} m high" if highest else "a larger ground or fewer frames"
            raise UsageError(
                f"simulate: {frames} frames from {altitude:.0f} m do not fit on a ground of "
                f"{room_m[0]:.0f} x {room_m[1]:.0f} m: take {advice}"  # type: ignore[index]
            )
        return min(choices, key=lambda c: abs(math.log(c.extent_m[0] / c.extent_m[1])))
    best = _fill(spec, frames, heading_rad, room_m, video=video)
    if best is None:
        raise UsageError(
            f"simulate: the ground of {room_m[0]:.0f} x {room_m[1]:.0f} m is too small for {frames} frames"
        )
    return best


def _strip_counts(frames: int, video: bool) -> range:
    return range(1, min(frames, 60) + 1)


def _pattern(
    spec: FlightSpec, frames: int, strips: int, altitude_m: float, heading_rad: float, *, video: bool
) -> Pattern:
    width = 2.0 * altitude_m * math.tan(math.radians(spec.hfov_deg) / 2.0)
    depth = width * spec.height_px / spec.width_px
    across = width * (1.0 - spec.side_overlap)
    # three sigma of tilt moves the footprint, two of wander and of height reach the border now and then
    tilt = 3.0 * math.radians(spec.motion.tilt_deg)
    margin = altitude_m * math.tan(tilt) * (1.0 + (width / 2.0 / altitude_m) ** 2)
    margin += 2.5 * spec.motion.wander_sigma_m + 2.5 * spec.motion.height_sigma_m * width / 2.0 / altitude_m
    margin += width / 2.0 * 2.5 * math.radians(spec.motion.yaw_deg)
    if video:
        path = frames * spec.speed_m_s / spec.video_rate_hz
        stations, along = 2, max(0.0, (path - (strips - 1) * across) / strips)
        # sideways legs between strips turn the frame: leave room for its longer side
        margin += max(0.0, (width - depth) / 2.0) if strips > 1 and spec.nose_follows_track else 0.0
    else:
        stations, along = -(-frames // strips), depth * (1.0 - spec.front_overlap)
    return Pattern(frames, altitude_m, strips, stations, along, across, heading_rad, (width, depth), margin)


def _fill(
    spec: FlightSpec, frames: int, heading_rad: float, room_m: tuple[float, float], *, video: bool
) -> Pattern | None:
    """Return the highest pattern that fits, over all numbers of strips; ``None`` where none does."""
    best: Pattern | None = None
    for strips in _strip_counts(frames, video):
        low, high = 1.0, HIGHEST_M
        if not _pattern(spec, frames, strips, low, heading_rad, video=video).fits(room_m):
            continue
        for _ in range(40):
            middle = (low + high) / 2.0
            fits = _pattern(spec, frames, strips, middle, heading_rad, video=video).fits(room_m)
            low, high = (middle, high) if fits else (low, middle)
        if best is None or low > best.altitude_m:
            best = _pattern(spec, frames, strips, low, heading_rad, video=video)
    return best
