"""Missions that are being served: their layers and documents, made anew when the folder changes."""

from __future__ import annotations

import hashlib
import math
import re
import threading
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from photomap_gis.core.errors import DataError, PhotomapError
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.crs import WGS84, point_map, same_crs
from photomap_gis.find_store import FINDS_FILE
from photomap_gis.mosaic import TileStore
from photomap_gis.server.layers import Layer
from photomap_gis.server.raster import RasterFile
from photomap_gis.server.vectors import in_time, utc_of
from photomap_gis.server.view import MissionView, OpenView

NOT_GEOREFERENCED = "not georeferenced: pixels of the first frame, no place on Earth, north unknown"
_WATCHED = ("solution.json", "mission.json", "map.tif", FINDS_FILE, "layers")
_SAME_PLACE_PX = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A mission and its layers at one ``epoch``; what is drawn from it stays consistent while a newer one is made.

    ``pictures`` is the epoch of all but the finds: a tile holds none, so a find that is marked leaves them as they are.
    """

    epoch: str
    view: MissionView
    layers: tuple[Layer, ...]
    pictures: str

    def layer(self, id: str) -> Layer:
        """Return a layer; ``KeyError`` where there is none of that name."""
        for layer in self.layers:
            if layer.id == id:
                return layer
        raise KeyError(id)

    def place_in(self, layer: Layer, xy: tuple[float, float]) -> tuple[float, float] | None:
        """Return a place (longitude, latitude; a local map: its units) in a layer's CRS, ``None`` where it has none."""
        crs = layer.grid.crs_wkt
        if crs is None:
            return xy
        if not (abs(xy[0]) <= 360.0 and abs(xy[1]) <= 90.0):
            return None
        x, y = point_map(WGS84, crs)([xy])[0]
        return (float(x), float(y)) if math.isfinite(x) and math.isfinite(y) else None

    @property
    def counts(self) -> dict[str, int]:
        """Frames by status, and in total."""
        found = Counter(str(s.value) for s in self.view.statuses.values())
        return {"total": len(self.view.frames), **dict(sorted(found.items()))}

    @property
    def span_utc(self) -> tuple[str | None, str | None]:
        """When the first and the last frame were taken."""
        times = [t for t in (utc_of(f) for f in in_time(self.view.frames)) if t is not None]
        return (times[0], times[-1]) if times else (None, None)


class ServedMission:
    """A mission folder under a name; ``current`` opens it again when its files have changed."""

    def __init__(self, id: str, folder: Path, open_view: OpenView, before: Path | None = None) -> None:
        """Open the mission; ``PhotomapError`` where it, or ``before`` (a mission or a GeoTIFF), cannot be shown."""
        self.id, self.folder, self.before = id, folder, before
        self._open_view = open_view
        self._lock = threading.Lock()
        self._snapshot = self._opened(*self._stamps_now())

    def current(self) -> Snapshot:
        """Return the newest snapshot; where the folder is being rewritten just now, the last one that was whole."""
        with self._lock:
            stamp, pictures = self._stamps_now()
            if stamp != self._snapshot.epoch:
                if pictures == self._snapshot.pictures:
                    self._snapshot = replace(self._snapshot, epoch=stamp)
                    return self._snapshot
                try:
                    # Old layers are not closed: a tile may be read from one just now; they go with their last reader.
                    self._snapshot = self._opened(stamp, pictures)
                except (PhotomapError, OSError, ValueError, LookupError):
                    return self._snapshot  # half written: the next look tries again
            return self._snapshot

    def close(self) -> None:
        """Let go of its files."""
        for layer in self._snapshot.layers:
            layer.close()

    def _stamps_now(self) -> tuple[str, str]:
        """Return the epoch of the folder as it is now, and that of all but its finds."""
        parts = []
        folders = [self.folder] if self.before is None else [self.folder, self.before]
        for folder in folders:
            for name in _WATCHED if folder.is_dir() else ("",):
                path = folder / name if name else folder
                try:
                    status = path.stat()
                    parts.append(f"{path.name}:{status.st_mtime_ns}:{status.st_size}")
                except OSError:
                    parts.append(f"{path.name}:-")
        shown = [part for part in parts if not part.startswith(f"{FINDS_FILE}:")]
        whole, pictures = (hashlib.sha256("|".join(p).encode()).hexdigest()[:12] for p in (parts, shown))
        return whole, pictures

    def _opened(self, stamp: str, pictures: str) -> Snapshot:
        view = self._open_view(self.folder)
        layers = mission_layers(view)
        if self.before is not None:
            layers.append(before_layer(self.before, self._open_view, georeferenced=view.georeferenced))
        return Snapshot(stamp, view, tuple(layers), pictures)


def mission_layers(view: MissionView) -> list[Layer]:
    """Return the map (each piece of it) and what else of rasters the mission has, the map first."""
    layers = []
    for n, folder in enumerate(view.mosaics):
        file = _overviews_of(view, n)
        store = TileStore(folder)
        files = _same_ground(store, file)
        title = "Photo map" if len(view.mosaics) == 1 else f"Photo map, piece {n + 1}"
        piece = None if view.georeferenced else view.pieces[n]
        id = "map" if n == 0 else f"map-{n + 1}"
        layers.append(Layer(id, title, _levels(store, files), role="map", piece=piece, files=files))
    if not layers:
        raise DataError(f"{view.folder} has no drawn map: run 'photomap map' on its sources again to finish it")
    for n in range(len(view.mosaics)):
        layers += _further_layers(view, n)
    return layers


def _further_layers(view: MissionView, n: int) -> list[Layer]:
    """Return what ``photomap export --layers`` wrote of a map, or of its ``n``-th piece."""
    layers = []
    end = "" if n == 0 else f"-{n + 1}"
    for path in sorted((view.folder / f"layers{end}").glob("*.tif")):
        try:
            file = RasterFile(path, local=not view.georeferenced, ramp=True)
            title = file.tags.get("TITLE") or _title(path.stem, file.band_name)
            values = file if file.ramp is not None else None
            piece = None if view.georeferenced else view.pieces[n]
            id = f"layer-{_slug(path.stem)}{end}"
            layers.append(Layer(id, title, file.levels, role="layer", piece=piece, values=values, files=(file,)))
        except PhotomapError:
            continue  # a layer that cannot be shown does not keep the map from being shown
    return layers


def before_layer(path: Path, open_view: OpenView, *, georeferenced: bool) -> Layer:
    """Return the picture to compare with: another mission's map, or a GeoTIFF."""
    if not georeferenced:
        raise DataError("a map without a place on Earth cannot be laid over another: leave --before away")
    if path.is_dir():
        view = open_view(path)
        if not view.georeferenced:
            raise DataError(f"{path} has no place on Earth: name a georeferenced mission or GeoTIFF by --before")
        store = TileStore(view.mosaics[0])
        files = _same_ground(store, _overviews_of(view, 0))
        return Layer("before", f"Before: {view.name}", _levels(store, files), role="before", files=files)
    file = RasterFile(path)
    return Layer("before", f"Before: {path.name}", file.levels, role="before", files=(file,))


def _overviews_of(view: MissionView, piece: int) -> RasterFile | None:
    name = "map.tif" if len(view.mosaics) == 1 else f"map-{piece + 1}.tif"
    try:
        return RasterFile(view.folder / name, local=not view.georeferenced)
    except PhotomapError:
        return None


def _same_ground(store: TileStore, file: RasterFile | None) -> tuple[RasterFile, ...]:
    """Return the GeoTIFF that was written from a store, if it covers the same ground: no old map may show through."""
    if file is None:
        return ()
    a, b = store.grid, file.grid
    apart = max(abs(v - w) for v, w in zip(a.bounds, b.bounds, strict=True))
    if same_crs(a.crs_wkt, b.crs_wkt) and apart <= _SAME_PLACE_PX * a.pixel_size:
        return (file,)
    file.close()
    return ()


def _levels(store: TileStore, files: tuple[RasterFile, ...]) -> list[TileSource]:
    """Return the store's own pixels, and under them the overviews of the GeoTIFF."""
    return [store, *(level for file in files for level in file.levels[1:])]


def _title(stem: str, band_name: str) -> str:
    title = stem.replace("_", " ").replace("-", " ").capitalize()
    return title if band_name in ("", stem) else f"{title}: {band_name}"


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "layer"
