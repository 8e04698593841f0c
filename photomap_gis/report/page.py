"""One page of HTML that needs nothing beside it: no network, no scripts, pictures inside, fit for printing on A4."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

from jinja2 import Environment, StrictUndefined, Template

from photomap_gis.report.times import FlightTimes


@dataclass(frozen=True, slots=True)
class MapPicture:
    """The map as a JPEG; ``width_m`` is what its width measures on the ground, ``None`` for a map without a place."""

    jpeg: bytes
    width_m: float | None

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")

    @property
    def bar(self) -> tuple[str, float] | None:
        """The label of a scale bar and its length in per cent of the picture's width."""
        if self.width_m is None or self.width_m <= 0:
            return None
        most = self.width_m / 4.0
        digits = math.floor(math.log10(most))
        length = max(k * 10.0**digits for k in (1.0, 2.0, 5.0) if k * 10.0**digits <= most)
        label = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
        return label, 100.0 * length / self.width_m


@dataclass(frozen=True, slots=True)
class PackedFile:
    """A file of the package: its name in it, bytes, and what it is for."""

    name: str
    bytes: int
    purpose: str


@dataclass(frozen=True, slots=True)
class Find:
    """A find: its name, where it lies, and its picture."""

    name: str
    place: str
    picture: MapPicture | None


@dataclass(frozen=True, slots=True)
class Page:
    """All that the page says; ``accuracy`` are lines in words, ``frames`` numbers by their name (table 2)."""

    title: str
    facts: Mapping[str, str]
    picture: MapPicture | None
    accuracy: Sequence[str]
    times: Sequence[FlightTimes]
    times_missing: str
    frames: Mapping[str, str]
    finds: Sequence[Find]
    files: Sequence[PackedFile]
    lost: Sequence[str]
    warnings: Sequence[str]
    made_by: str


def page_html(page: Page) -> str:
    """Return the page as HTML; every word is escaped."""
    return _template().render(page=page, clock=clock_text, size=size_text) + "\n"


def clock_text(seconds: float) -> str:
    """Return minutes and seconds as the paper's table 1 has them.

    >>> clock_text(660.2), clock_text(3450)
    ('11:00', '57:30')
    """
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def size_text(size_bytes: int) -> str:
    """Return a size as people read it.

    >>> size_text(1_234_567), size_text(900)
    ('1.2 MB', '1 kB')
    """
    return f"{size_bytes / 1e6:.1f} MB" if size_bytes >= 100_000 else f"{max(1, round(size_bytes / 1000))} kB"


@lru_cache(maxsize=1)
def _template() -> Template:
    text = resources.files("photomap_gis.report").joinpath("summary.html.j2").read_text(encoding="utf-8")
    engine = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return engine.from_string(text)
