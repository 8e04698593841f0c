"""What a server knows of a mission: the values that a host hands it, and nothing of how they were solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from photomap_gis.core.frame import FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.placement import FramePlacement


@dataclass(frozen=True, slots=True, eq=False)
class MissionView:
    """A mission at one moment: its frames, where they lie, and what is known of the map's accuracy.

    ``pieces`` are the segments that were drawn, the largest first: one per picture where the map has no place on Earth,
    else empty. ``mosaics`` are the folders of their tiles, ``accuracy`` the words and numbers of ``photomap info``.
    """

    folder: Path
    name: str
    map_frame: MapFrame
    frames: tuple[FrameRef, ...]
    placements: tuple[FramePlacement, ...]
    statuses: Mapping[int, FrameStatus]
    reasons: Mapping[int, str]
    revision: int
    mosaics: tuple[Path, ...]
    pieces: tuple[int, ...] = ()
    crs_label: str | None = None
    accuracy: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def georeferenced(self) -> bool:
        """Whether the map has a place on Earth."""
        return self.map_frame.crs_wkt is not None


OpenView = Callable[[Path], MissionView]
"""Reads a mission folder; raises ``PhotomapError`` where it cannot be shown."""
