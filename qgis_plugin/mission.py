"""What lies in a mission folder that QGIS can show, and what is known of it; no layer is made here."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from osgeo import gdal

RASTER_LAYERS = ("sigma", "last_seen", "searched", "views")
"""Files of ``layers/`` that are shown, in the order of the tree."""
VECTOR_LAYERS = ("track", "cameras", "footprints")
"""Layers of ``vectors.gpkg`` that are shown, in the order of the tree."""


class MissionError(Exception):
    """A folder cannot be shown; the message says what to do."""


@dataclass(frozen=True)
class MapFile:
    """One GeoTIFF of a mission. ``newest_utc`` is when its newest frame was taken; CE90 in metres, on the ground.

    ``ce90_tested`` says that check points stated it; else it is predicted by the solution's covariances.
    """

    path: Path
    georeferenced: bool
    newest_utc: datetime | None
    ce90_m: float | None
    ce90_tested: bool

    @property
    def statement(self) -> str:
        """Return date and accuracy as they stand in a layer's name, such as ``2026-06-15 10:07 UTC, CE90 3.1 m``."""
        words = [self.newest_utc.strftime("%Y-%m-%d %H:%M UTC") if self.newest_utc else "undated"]
        if not self.georeferenced:
            words.append("no place on Earth yet")
        elif self.ce90_m is None:
            words.append("CE90 unknown")
        else:
            words.append(f"CE90 {self.ce90_m:.2g} m" + (" (tested)" if self.ce90_tested else ""))
        return ", ".join(words)


@dataclass(frozen=True)
class MissionFiles:
    """The files of a mission that can be shown: at least one map; the others where they are there."""

    folder: Path
    maps: tuple[MapFile, ...]
    vectors: Path | None
    finds: Path | None
    layers: dict[str, Path]

    @property
    def name(self) -> str:
        """Return the mission's name."""
        return self.folder.name

    @property
    def georeferenced(self) -> bool:
        """Whether the map has a place on Earth."""
        return self.maps[0].georeferenced

    @property
    def title(self) -> str:
        """Return the name of the mission's group in the layer tree."""
        return f"{self.name}: {self.maps[0].statement}"


def read_mission(folder: Path | str) -> MissionFiles:
    """Return what a mission folder holds; ``MissionError`` where there is no finished map in it."""
    folder = Path(folder).absolute()
    if not folder.is_dir():
        raise MissionError(f"{folder} is not there any more: choose the mission's folder again")
    if not (folder / "mission.json").is_file():
        raise MissionError(f"{folder} is no mission: choose a folder that photomap has made (it holds mission.json)")
    pieces = sorted(folder.glob("map-*.tif"), key=_piece)
    pieces = [p for p in pieces if _piece(p)]
    paths = pieces if len(pieces) > 1 else [p for p in (folder / "map.tif", *pieces) if p.is_file()][:1]
    if not paths:
        raise MissionError(f"{folder} holds no finished map: start it again with the same photos, and it goes on")
    layers = {name: folder / "layers" / f"{name}.tif" for name in RASTER_LAYERS}
    return MissionFiles(
        folder,
        tuple(read_map(path) for path in paths),
        _if_there(folder / "vectors.gpkg"),
        _if_there(folder / "finds.geojson"),
        {name: path for name, path in layers.items() if path.is_file()},
    )


def read_map(path: Path | str) -> MapFile:
    """Return what a map's GeoTIFF says of itself in its tags; ``MissionError`` where it cannot be read."""
    try:
        picture = gdal.OpenEx(str(path), gdal.OF_RASTER)
    except RuntimeError:  # where somebody has called gdal.UseExceptions()
        picture = None
    if picture is None:
        raise MissionError(f"{path} cannot be read as a raster: make the map again")
    tags, place = picture.GetMetadata(), picture.GetSpatialRef()
    tested = _number(tags.get("CHECK_CE90_M"))
    return MapFile(
        Path(path),
        place is not None and not place.IsLocal(),  # pixels of a first frame are local units
        _moment(tags.get("TIFFTAG_DATETIME")),
        tested if tested is not None else _number(tags.get("PREDICTED_CE90_M")),
        tested is not None,
    )


def _piece(path: Path) -> int:
    match = re.fullmatch(r"map-(\d+)\.tif", path.name)
    return int(match[1]) if match else 0


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        return None


def _moment(text: str | None) -> datetime | None:
    try:
        return datetime.strptime(text or "", "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc)
    except ValueError:
        return None
