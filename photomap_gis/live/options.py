"""What a user may say about a live session, and the numbers by which the loop decides."""

from __future__ import annotations

from dataclasses import dataclass, field

from photomap_gis.pipeline.settings import MapSettings


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Choices of one session; all but the numbers of the screen hold for a replay too.

    ``new_ground`` is the share of a frame that must be new for it to become a key frame. ``solve_every`` key frames the
    graph is solved at least. ``lost_after_s`` without a registration begins a new segment, ``gap_s`` without any frame
    does so at once where the next frame does not fit.
    """

    settings: MapSettings = field(default_factory=MapSettings)
    new_ground: float = 0.10
    solve_every: int = 6
    lost_after_s: float = 0.3
    gap_s: float = 1.0
    area_lon_lat: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not 0.01 <= self.new_ground <= 0.6:
            raise ValueError(f"new_ground must lie within 0.01-0.6, got {self.new_ground}")
        if self.solve_every < 1:
            raise ValueError(f"solve_every must be at least 1, got {self.solve_every}")
