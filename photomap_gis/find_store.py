"""A mission's finds on disk: ``finds.geojson``, replaced whole, and a picture of each in ``finds/ID.jpg``.

The file is plain GeoJSON that any GIS opens. Features that somebody else put there are kept as they are. A find without
a place on Earth has no geometry (RFC 7946 section 3.2) but ``xy_map``: nobody takes its pixels for degrees.
"""

from __future__ import annotations

import json
import math
import re
import secrets
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import DataError
from photomap_gis.core.find import FindAnchor, FindKind, MarkedFind
from photomap_gis.publish import write_file

FINDS_FILE = "finds.geojson"
SNAPSHOTS = "finds"
_MAX_BYTES = 32 << 20
_MAX_FINDS = 10_000
_ID = re.compile(r"[a-z0-9][a-z0-9-]{0,39}", re.ASCII)


class FindStore:
    """The finds of one mission folder; safe among threads. What others write to the file is seen at the next look."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.RLock()

    @property
    def path(self) -> Path:
        """Where they lie."""
        return self.folder / FINDS_FILE

    def features(self) -> list[dict[str, Any]]:
        """Return the file's features as they are, ours and others'; empty where there is none or it is damaged."""
        try:
            return self._read()
        except DataError:
            return []

    def all(self) -> tuple[MarkedFind, ...]:
        """Return the finds that were marked, in the order of marking."""
        return tuple(find for f in self.features() if (find := _find_of(f)) is not None)

    def get(self, id: str) -> MarkedFind:
        """Return a find; ``KeyError`` where there is none."""
        for find in self.all():
            if find.id == id:
                return find
        raise KeyError(id)

    def add(
        self,
        kind: FindKind,
        *,
        time_utc: str,
        note: str = "",
        name: str = "",
        lon_lat: tuple[float, float] | None = None,
        xy_map: tuple[float, float] | None = None,
        ce90_m: float | None = None,
        anchor: FindAnchor | None = None,
        jpeg: bytes | None = None,
    ) -> MarkedFind:
        """Keep a new find, named after its kind and number where it has no name; the picture first, then the find.

        ``DataError`` where the file that is there cannot be read: it is not overwritten.
        """
        with self._lock:
            features = self._read()
            if len(features) >= _MAX_FINDS:
                raise DataError(f"{self.path.name} holds {len(features)} finds, as many as there can be: remove some")
            known = [f for f in map(_find_of, features) if f is not None]
            name = name or _next_name(kind, {f.name for f in known})
            id = f"f-{secrets.token_hex(5)}"
            find = MarkedFind(id, kind, name, time_utc, note, lon_lat, xy_map, ce90_m, anchor, jpeg is not None)
            if jpeg is not None:
                (self.folder / SNAPSHOTS).mkdir(exist_ok=True)
                write_file(self._snapshot(id), jpeg)
            self._write([*features, _feature_of(find)])
            return find

    def change(
        self, id: str, *, kind: FindKind | None = None, name: str | None = None, note: str | None = None
    ) -> MarkedFind:
        """Change what is said of a find and return it; ``KeyError`` where there is none."""

        def changed(find: MarkedFind) -> MarkedFind:
            return replace(
                find, kind=kind or find.kind, name=name or find.name, note=find.note if note is None else note
            )

        with self._lock:
            self.get(id)
            self.move(lambda find: changed(find) if find.id == id else find)
            return self.get(id)

    def remove(self, id: str) -> None:
        """Take a find away, and its picture; ``KeyError`` where there is none."""
        with self._lock:
            self.get(id)
            self._write([f for f in self._read() if (find := _find_of(f)) is None or find.id != id])
            self._snapshot(id).unlink(missing_ok=True)

    def move(self, change: Callable[[MarkedFind], MarkedFind]) -> bool:
        """Let ``change`` replace each find, as when the map has moved; return whether any changed."""
        with self._lock:
            features = self._read()
            fresh = []
            for feature in features:
                find = _find_of(feature)
                new = None if find is None else change(find)
                fresh.append(feature if find is None or new is None or new == find else _feature_of(new))
            if fresh == features:
                return False
            self._write(fresh)
            return True

    def snapshot(self, id: str) -> bytes:
        """Return the picture of a find, JPEG; ``KeyError`` where there is none."""
        if not _ID.fullmatch(id):
            raise KeyError(id)
        try:
            return self._snapshot(id).read_bytes()
        except OSError:
            raise KeyError(id) from None

    def _snapshot(self, id: str) -> Path:
        return self.folder / SNAPSHOTS / f"{id}.jpg"

    def _read(self) -> list[dict[str, Any]]:
        if not self.path.is_file():
            return []
        try:
            if self.path.stat().st_size > _MAX_BYTES:
                raise DataError(f"{self.path.name} is larger than a list of finds can be ({_MAX_BYTES >> 20} MB)")
            document = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise DataError(f"{self.path.name} is damaged: repair it or move it away, then mark again") from error
        found = document.get("features") if isinstance(document, dict) else None
        if not isinstance(found, list):
            raise DataError(f"{self.path.name} is no list of finds (GeoJSON): move it away, then mark again")
        return [f for f in found if isinstance(f, dict) and f.get("type") == "Feature"]

    def _write(self, features: Iterable[dict[str, Any]]) -> None:
        document = {"type": "FeatureCollection", "features": list(features)}
        write_file(self.path, json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1).encode())


def _next_name(kind: FindKind, taken: set[str]) -> str:
    number = 1
    while (name := f"{kind.value.capitalize()} {number}") in taken:
        number += 1
    return name


def _feature_of(find: MarkedFind) -> dict[str, Any]:
    point = None if find.lon_lat is None else {"type": "Point", "coordinates": list(find.lon_lat)}
    a = find.anchor
    return {
        "type": "Feature",
        "id": find.id,
        "geometry": point,
        "properties": {
            "id": find.id,
            "kind": find.kind.value,
            "name": find.name,
            "note": find.note,
            "remarks": find.note,
            "time_utc": find.time_utc,
            "ce90_m": find.ce90_m,
            "xy_map": None if find.xy_map is None else list(find.xy_map),
            "anchor": None if a is None else [a.frame, a.x_px, a.y_px],
            "snapshot": f"{SNAPSHOTS}/{find.id}.jpg" if find.snapshot else None,
        },
    }


def _find_of(feature: dict[str, Any]) -> MarkedFind | None:
    """Return a feature as the find that we wrote, ``None`` where somebody else did."""
    p = feature.get("properties")
    if not isinstance(p, dict) or not isinstance(p.get("id"), str) or not _ID.fullmatch(p["id"]):
        return None
    if p.get("kind") not in [k.value for k in FindKind]:
        return None
    geometry = feature.get("geometry")
    lon_lat = _pair(geometry.get("coordinates")) if isinstance(geometry, dict) else None
    a = p.get("anchor")
    numbers = isinstance(a, list) and len(a) == 3 and all(_is_number(v) for v in a)
    anchor = FindAnchor(int(a[0]), float(a[1]), float(a[2])) if isinstance(a, list) and numbers else None
    ce90 = p.get("ce90_m")
    return MarkedFind(
        p["id"],
        FindKind(p["kind"]),
        str(p.get("name") or p["kind"]),
        str(p.get("time_utc") or ""),
        str(p.get("note") or ""),
        lon_lat,
        _pair(p.get("xy_map")),
        float(ce90) if isinstance(ce90, int | float) and _is_number(ce90) and ce90 >= 0 else None,
        anchor,
        bool(p.get("snapshot")),
    )


def _pair(value: Any) -> tuple[float, float] | None:
    if isinstance(value, list) and len(value) >= 2 and _is_number(value[0]) and _is_number(value[1]):
        return float(value[0]), float(value[1])
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
