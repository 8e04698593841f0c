"""What every log dialect turns into: points on a clock, camera triggers, and what the user should know of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from photomap_gis.core.frame import Attitude


class Clock(StrEnum):
    """What a track's ``time_s`` counts from.

    ``VIDEO``: seconds since the video's first frame. ``UTC``: Unix seconds. ``LOCAL``: a wall clock without a zone,
    written as if it were UTC. ``BOOT``: seconds since something that nobody else knows.
    """

    VIDEO = "video"
    UTC = "utc"
    LOCAL = "local"
    BOOT = "boot"


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """Where the camera was at one moment, in WGS84 degrees.

    ``alt_m`` is as reported (uncertain datum), ``height_m`` is above take-off or ground; ``attitude`` is the
    **camera's**. ``sigma_m`` is the reported or implied horizontal one-sigma per axis, ``None`` where nothing is known.
    ``focal_35mm`` and ``hfov_rad`` are set where the log follows the lens.
    """

    time_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float | None = None
    height_m: float | None = None
    attitude: Attitude | None = None
    sigma_m: float | None = None
    focal_35mm: float | None = None
    hfov_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Trigger:
    """One shot of the camera as the autopilot logged it; its position is ``None`` where only the moment was logged."""

    time_s: float
    index: int
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_m: float | None = None
    height_m: float | None = None
    attitude: Attitude | None = None


@dataclass(frozen=True, slots=True)
class ModeChange:
    """The flight mode that holds from ``time_s`` on."""

    time_s: float
    name: str


@dataclass(frozen=True, slots=True)
class Track:
    """One telemetry log: points in order of time, strictly increasing.

    ``epoch_utc_s`` (Unix seconds) and ``epoch_local_s`` (the same without a known zone) say when a ``VIDEO`` clock's
    zero was, where the log tells.
    """

    points: tuple[TrackPoint, ...]
    clock: Clock
    source: str
    triggers: tuple[Trigger, ...] = ()
    modes: tuple[ModeChange, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    epoch_utc_s: float | None = None
    epoch_local_s: float | None = None

    @property
    def start_s(self) -> float | None:
        """The first moment that is known of, ``None`` for an empty track."""
        times = [t[0].time_s for t in (self.points, self.triggers) if t]
        return min(times) if times else None

    @property
    def end_s(self) -> float | None:
        """The last moment that is known of, ``None`` for an empty track."""
        times = [t[-1].time_s for t in (self.points, self.triggers) if t]
        return max(times) if times else None

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last moment, 0 for an empty track."""
        return 0.0 if self.start_s is None or self.end_s is None else self.end_s - self.start_s
