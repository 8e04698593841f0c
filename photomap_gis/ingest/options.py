"""What a user may say about the sources."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class LensChoice(StrEnum):
    """Which of a drone's cameras to use; ``WIDEST`` takes the widest visible one."""

    WIDEST = "widest"
    WIDE = "wide"
    ZOOM = "zoom"
    THERMAL = "thermal"
    ALL = "all"


class SrtOrder(StrEnum):
    """How to read ``GPS(a, b, c)`` in a subtitle track; ``AUTO`` decides by dialect and evidence."""

    AUTO = "auto"
    LAT_LON = "lat-lon"
    LON_LAT = "lon-lat"


@dataclass(frozen=True, slots=True)
class IngestOptions:
    """Choices for reading sources.

    ``track`` is a telemetry file for all sources; ``track_offset_s`` is added to the track's clock to reach the
    camera's (``None``: found by the tool). ``hfov_deg`` and ``focal_35mm`` override the lens;
    ``frame_rate_hz`` is how many frames a second of a video enter the map (``None``: by speed, height, field of view).
    """

    track: Path | None = None
    track_offset_s: float | None = None
    lens: LensChoice = LensChoice.WIDEST
    hfov_deg: float | None = None
    focal_35mm: float | None = None
    frame_rate_hz: float | None = None
    srt_order: SrtOrder = SrtOrder.AUTO
