"""The documents that server and clients exchange; ``docs/protocol.md`` says the same in words.

The page, the QGIS plugin and scripts share them. A field is only ever added within one ``API`` number.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

API = 1

Bounds = tuple[float, float, float, float]


class Document(BaseModel):
    """The root of all documents: unknown fields are a mistake on our side, so they are refused when we write."""

    model_config = ConfigDict(extra="forbid")


class ServerDocument(Document):
    """``GET /api``: who answers."""

    api: int = API
    product: str = "photomap"
    version: str
    missions: list[str]


class LegendDocument(Document):
    """A layer whose colours stand for numbers: what its ends mean, and its colours from low to high."""

    low: float
    high: float
    units: str = ""
    colours: list[str]


class SchemeDocument(Document):
    """How a layer's tiles are addressed (see ``layers.TileScheme``)."""

    kind: Literal["webmercator", "local"]
    tile_px: int = 256
    min_zoom: int
    max_zoom: int
    bounds: Bounds
    origin_xy: tuple[float, float]
    unit_per_px: float


class LayerDocument(Document):
    """A raster of a mission. ``tiles`` is a template with {z}, {x}, {y}; row 0 lies in the north."""

    id: str
    title: str
    role: Literal["map", "layer", "before"]
    piece: int | None = None
    scheme: SchemeDocument
    tiles: str
    legend: LegendDocument | None = None


class MissionDocument(Document):
    """``GET /missions/ID``: all that a page needs to begin.

    ``bounds`` are those of the first layer, in its scheme's units. ``epoch`` changes whenever pictures or frames may
    have changed; it is part of tile addresses, so that no cache shows a stale map.
    """

    id: str
    name: str
    epoch: str
    revision: int
    georeferenced: bool
    note: str
    crs: str | None
    bounds: Bounds
    layers: list[LayerDocument]
    frames: dict[str, int]
    start_utc: str | None
    end_utc: str | None
    pieces: list[int]
    accuracy: dict[str, Any]
    accuracy_words: list[str]
    warnings: list[str]
    links: dict[str, str]
    live: Any | None = None
    """A flight that is under way: its ``LiveDocument``."""


class MissionsDocument(Document):
    """``GET /missions``."""

    missions: list[MissionDocument]


class ValueDocument(Document):
    """``GET /missions/ID/layers/LAYER/value``: the number of a layer at a place, ``null`` where it has none."""

    value: float | None
    units: str = ""


class EventDocument(Document):
    """One event of ``GET /events``; the SSE event's name is ``event``."""

    event: Literal["hello", "mission"]
    mission: str | None = None
    epoch: str | None = None


class ErrorDocument(Document):
    """What comes with every status of 400 and more: ``message`` says what to do."""

    error: str
    message: str


class ReadyDocument(Document):
    """The first line on stdout of ``photomap serve --json``."""

    event: Literal["ready"] = "ready"
    api: int = API
    port: int
    token: str | None
    url: str
