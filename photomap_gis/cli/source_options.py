"""The options that say how sources are read; shared by ``map`` and ``info``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photomap_gis.ingest.options import LensChoice, SrtOrder

if TYPE_CHECKING:
    from photomap_gis.ingest.options import IngestOptions

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--track", type=click.Path(path_type=Path), metavar="FILE",
                 help="Positions from this log: .srt .gpx .csv .tlog .bin .ulg .klv."),
    click.option("--track-offset", type=float, metavar="S", help="Seconds to add to the track's clock."),
    click.option("--srt-order", type=click.Choice([o.value for o in SrtOrder]), default=SrtOrder.AUTO.value,
                 show_default=True, help="Order of GPS(a, b, c) in subtitles."),
    click.option("--lens", type=click.Choice([c.value for c in LensChoice]), default=LensChoice.WIDEST.value,
                 show_default=True, help="Which of the drone's cameras."),
    click.option("--fov-deg", type=click.FloatRange(1, 170), metavar="DEG", help="Horizontal field of view."),
    click.option("--focal-35mm", type=click.FloatRange(5, 2000), metavar="MM", help="35 mm equivalent focal length."),
    click.option("--fps", type=click.FloatRange(0.01, 60), metavar="HZ",
                 help="Frames a second taken from a video; default: by speed and height."),
)  # fmt: skip


def source_options(function: F) -> F:
    """Add the options to a command; it receives them as keywords for ``ingest_options``."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


def ingest_options(chosen: Mapping[str, Any]) -> IngestOptions:
    """Return the options' value."""
    from photomap_gis.ingest.options import IngestOptions

    return IngestOptions(
        track=chosen["track"],
        track_offset_s=chosen["track_offset"],
        lens=LensChoice(chosen["lens"]),
        hfov_deg=chosen["fov_deg"],
        focal_35mm=chosen["focal_35mm"],
        frame_rate_hz=chosen["fps"],
        srt_order=SrtOrder(chosen["srt_order"]),
    )
