"""What a user may say about a map, and how the corridor tells how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.mosaic.preference import Prefer

Progress = Callable[[str, int, int], None]
"""Called with (stage, done, total)."""


MAX_ANTENNA_OFFSET_M = 50.0
"""No vehicle is larger: more is a mistake, such as centimetres."""


@dataclass(frozen=True, slots=True)
class MapSettings:
    """Choices for one mission; those that shape its measurements are kept in the mission and hold for ``--add`` too.

    ``crs`` is what the user wrote (``None``: the right UTM zone), ``gsd_m_per_px`` the map's pixel (``None``: native).
    ``antenna_offset_m`` is where the GPS antenna sits from the camera: forward, right, down in the vehicle's axes.
    ``work_size_px`` is the longer side of the images that are registered. ``references`` are files of existing imagery
    that the map is laid on, ``reference_sigma_m`` their own constant error per axis (``None``: one of their pixels).
    ``prefer`` says which of several frames is shown (``None``: the steepest, or what the mission was drawn by),
    ``layers`` whether layers are written beside the map.
    ``dem`` is a file of the ground's heights, of which the shape is used. ``processes`` allows long work to be done in
    processes of their own: a script that sets it keeps its own start behind ``if __name__ == "__main__"``.
    """

    ingest: IngestOptions = field(default_factory=IngestOptions)
    crs: str | None = None
    gsd_m_per_px: float | None = None
    max_off_nadir_deg: float = 35.0
    work_size_px: int = 512
    workers: int | None = None
    scheduler: str | None = None
    memory_mb: int = 512
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    references: tuple[str, ...] = ()
    reference_sigma_m: float | None = None
    prefer: Prefer | None = None
    layers: bool | None = None
    dem: str | None = None
    processes: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.max_off_nadir_deg < 90.0:
            raise UsageError(f"--max-off-nadir must lie between 0 and 90 degrees, got {self.max_off_nadir_deg:g}")
        if self.gsd_m_per_px is not None and not (math.isfinite(self.gsd_m_per_px) and self.gsd_m_per_px > 0):
            raise UsageError(f"--gsd must be a positive number of metres a pixel, got {self.gsd_m_per_px:g}")
        if self.reference_sigma_m is not None and not (
            math.isfinite(self.reference_sigma_m) and self.reference_sigma_m > 0
        ):
            raise UsageError(f"--reference-sigma must be a positive number of metres, got {self.reference_sigma_m:g}")

        if not all(math.isfinite(v) and abs(v) <= MAX_ANTENNA_OFFSET_M for v in self.antenna_offset_m):
            raise UsageError(
                f"--antenna-offset must be three lengths of at most {MAX_ANTENNA_OFFSET_M:g} m, "
                f"got {self.antenna_offset_m}"
            )

    @property
    def max_off_nadir_rad(self) -> float:
        """Frames whose optical axis leans further from the plumb line are not pasted."""
        return math.radians(self.max_off_nadir_deg)


@dataclass(frozen=True, slots=True)
class Drawing:
    """How a mission's map is drawn this time; ``None``: as the mission has it."""

    prefer: Prefer | None = None
    layers: bool | None = None
    workers: int | None = None
    memory_mb: int | None = None

    def applied_to(self, settings: MapSettings) -> MapSettings:
        """Return the settings with what was said here."""
        return replace(
            settings,
            prefer=settings.prefer if self.prefer is None else self.prefer,
            layers=settings.layers if self.layers is None else self.layers,
            workers=settings.workers if self.workers is None else self.workers,
            memory_mb=settings.memory_mb if self.memory_mb is None else self.memory_mb,
        )
