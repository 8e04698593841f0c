"""Finds as the server keeps them: marked at a place, with how sure it is and a picture; moved when the map moves."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from PIL import Image
from pydantic import Field, field_validator

from photomap_gis.core.accuracy import CE90_PER_RMSE_R
from photomap_gis.core.errors import UsageError
from photomap_gis.core.find import FindAnchor, FindKind, MarkedFind
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.find_files import FindFormat, finds_text
from photomap_gis.export.finds import Find
from photomap_gis.find_store import FindStore
from photomap_gis.server.placer import Placer
from photomap_gis.server.protocol import Document

_QUALITY = 85
_MOST_NOTE, _MOST_NAME = 2000, 80

Rgb = npt.NDArray[np.uint8]


class FindRequest(Document):
    """``POST /missions/ID/finds``: ``place`` is longitude and latitude, or the map's own units."""

    kind: FindKind
    place: tuple[float, float]
    note: str = Field("", max_length=_MOST_NOTE)
    name: str = Field("", max_length=_MOST_NAME)

    @field_validator("place")
    @classmethod
    def _finite(cls, place: tuple[float, float]) -> tuple[float, float]:
        if not all(math.isfinite(v) for v in place):
            raise ValueError("place must be two finite numbers")
        return place


class FindChange(Document):
    """``PATCH /missions/ID/finds/FIND``: what is named is changed."""

    kind: FindKind | None = None
    note: str | None = Field(None, max_length=_MOST_NOTE)
    name: str | None = Field(None, min_length=1, max_length=_MOST_NAME)


class FindGround(Protocol):
    """The map as finds need it."""

    @property
    def map_frame(self) -> MapFrame:
        """Where the map lies."""
        ...

    def covariance_at(self, xy_map_m: tuple[float, float]) -> FloatArray | None:
        """``(2, 2)`` predicted covariance of a place; ``None`` where nothing was seen."""
        ...

    def anchor_at(self, xy_map_m: tuple[float, float]) -> FindAnchor | None:
        """The frame and pixel that a place hangs on; ``None`` where the map does not move any more."""
        ...

    def place_of(self, anchor: FindAnchor) -> tuple[float, float] | None:
        """Where an anchor lies now."""
        ...

    def picture_at(self, xy_map_m: tuple[float, float], anchor: FindAnchor | None) -> Rgb | None:
        """``(h, w, 3)`` RGB about a place; ``None`` where nothing was seen."""
        ...


class FindDesk:
    """Marks finds on one mission's ground and keeps them in its folder; safe among threads."""

    def __init__(self, store: FindStore, ground: FindGround) -> None:
        self.store, self._ground = store, ground

    def mark(self, request: FindRequest, *, now: datetime) -> MarkedFind:
        """Keep a new find; ``UsageError`` for a place that the map cannot have."""
        frame = self._ground.map_frame
        xy = Placer(frame).to_map(request.place)
        if xy is None:
            raise UsageError("this place is none of the map: give longitude and latitude (a local map: its units)")
        anchor = self._ground.anchor_at(xy)
        picture = self._ground.picture_at(xy, anchor)
        local = frame.crs_wkt is None
        return self.store.add(
            request.kind,
            time_utc=now.isoformat(timespec="seconds").replace("+00:00", "Z"),
            note=request.note,
            name=request.name.strip(),
            lon_lat=None if local else request.place,
            xy_map=request.place if local else None,
            ce90_m=None if local else ce90_of(self._ground.covariance_at(xy)),
            anchor=anchor,
            jpeg=None if picture is None else _jpeg(picture),
        )

    def replace_all(self) -> bool:
        """Put every find that hangs on a frame where that frame lies now; return whether any moved."""
        frame = self._ground.map_frame
        place = Placer(frame)

        def moved(find: MarkedFind) -> MarkedFind:
            if find.anchor is None or (xy := self._ground.place_of(find.anchor)) is None:
                return find
            found = place(np.array([xy]))
            if not found:
                return find
            at = (found[0][0], found[0][1])
            if frame.crs_wkt is None:
                return replace(find, lon_lat=None, xy_map=at, ce90_m=None)
            return replace(find, lon_lat=at, xy_map=None, ce90_m=ce90_of(self._ground.covariance_at(xy)))

        return self.store.move(moved)


def ce90_of(covariance_m2: FloatArray | None) -> float | None:
    """Return within how many metres a place lies with a chance of 90 %; ``None`` where that is not known."""
    if covariance_m2 is None or not np.isfinite(covariance_m2).all():
        return None
    return round(CE90_PER_RMSE_R * math.sqrt(max(0.0, float(np.trace(covariance_m2)))), 2)


def finds_document(store: FindStore, *, georeferenced: bool) -> dict[str, Any]:
    """Return a mission's finds as GeoJSON: in degrees, or at their ``xy_map`` where the map has no place on Earth."""
    features = store.features()
    if not georeferenced:
        features = [_local(f) for f in features]
    kind = "lonlat" if georeferenced else "local"
    return {"type": "FeatureCollection", "coordinates": kind, "features": features}


def finds_file(store: FindStore, wanted: FindFormat, *, title: str, now: datetime) -> str:
    """Return the finds that have a place on Earth as a file's text."""
    return finds_text(_placed(store.all()), wanted, title=title, now=now)


def _placed(finds: Sequence[MarkedFind]) -> list[Find]:
    return [
        Find(f.name, *f.lon_lat, f.ce90_m, f.time_utc or None, f.note, f.kind.value, f.id)
        for f in finds
        if f.lon_lat is not None
    ]


def _local(feature: dict[str, Any]) -> dict[str, Any]:
    properties = feature.get("properties")
    xy = properties.get("xy_map") if isinstance(properties, dict) else None
    return {**feature, "geometry": {"type": "Point", "coordinates": xy} if isinstance(xy, list) else None}


def _jpeg(rgb: Rgb) -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb)).save(out, "JPEG", quality=_QUALITY)
    return out.getvalue()


def on_white(rgba: npt.NDArray[np.uint8]) -> Rgb | None:
    """``(h, w, 3)`` of RGBA, white where nothing was seen; ``None`` where that is everywhere."""
    if not rgba[..., 3].any():
        return None
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    return np.rint(rgba[..., :3] * alpha + 255.0 * (1.0 - alpha)).astype(np.uint8)
