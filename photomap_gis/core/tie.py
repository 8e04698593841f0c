"""What existing imagery says of a frame: points of it whose place on the map is known by the reference."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ReferenceTie:
    """A frame found in a reference.

    ``xy_px`` are points of the frame's raster and ``xy_map_m`` where the reference shows them (internal map metres);
    each of them is off by ``sigma_m`` per axis, independently. The reference's own constant error comes on top.
    ``kept`` is whether the ties of the reference agree with this one.
    """

    frame: int
    xy_px: tuple[tuple[float, float], ...]
    xy_map_m: tuple[tuple[float, float], ...]
    sigma_m: float
    probability: float
    method: str
    kept: bool = True

    def __post_init__(self) -> None:
        if len(self.xy_px) != len(self.xy_map_m) or not self.xy_px:
            raise ValueError(f"a tie must have as many pixels as places, got {len(self.xy_px)}, {len(self.xy_map_m)}")


@dataclass(frozen=True, slots=True)
class ReferenceTies:
    """A reference and the frames that were looked for in it.

    ``sigma_m`` is the reference's own constant error per axis. ``state`` tells one version of the file from another.
    ``tried`` counts the places that were compared; ``word`` says in a line what came of it.
    """

    path: str
    sigma_m: float
    gsd_m_per_px: float
    state: str
    tried: int
    ties: tuple[ReferenceTie, ...] = ()
    word: str = ""

    @property
    def kept(self) -> tuple[ReferenceTie, ...]:
        """The ties that agree with each other."""
        return tuple(t for t in self.ties if t.kept)
