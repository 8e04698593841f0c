"""One writer a format: what a request means for each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from shapely.geometry import Point

from photomap_gis import __version__
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.atak import write_atak
from photomap_gis.export.crs import WGS84, parse_crs, point_map
from photomap_gis.export.finds import Find, read_finds
from photomap_gis.export.flight_layers import Link, flight_layers
from photomap_gis.export.footprint import footprint
from photomap_gis.export.geopackage import write_geopackage
from photomap_gis.export.geopdf import write_geopdf
from photomap_gis.export.geotiff import write_geotiff
from photomap_gis.export.kml import write_kmz
from photomap_gis.export.mbtiles import write_mbtiles
from photomap_gis.export.over import write_over
from photomap_gis.export.picture import write_picture
from photomap_gis.export.pmtiles import write_pmtiles
from photomap_gis.export.poses import pose_rows, write_poses
from photomap_gis.export.stac import write_stac_item
from photomap_gis.export.tiles import write_tiles
from photomap_gis.export.vectors import VectorLayer, write_vectors
from photomap_gis.export.warp import ground_pixel_m, pixel_steps, target_grid
from photomap_gis.export.words import MapWords
from photomap_gis.find_store import FINDS_FILE
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.formats import DEFAULT_NAMES, ExportOptions, Format
from photomap_gis.pipeline.layers import write_map_layers
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.words import geotiff_tags
from photomap_gis.publish import output_errors
from photomap_gis.store import Mission

OnProgress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Written:
    """An output; ``gsd_m_per_px`` is the finest pixel of its pictures on the ground, where it has some and a place."""

    format: Format
    path: Path
    gsd_m_per_px: float | None = None
    note: str = ""

    @property
    def bytes(self) -> int:
        """Its size, of a folder that of all files in it."""
        files = self.path.rglob("*") if self.path.is_dir() else [self.path]
        return sum(f.stat().st_size for f in files if f.is_file())


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What is exported; ``crs`` is what the user of the mission or of the export wrote."""

    mission: Mission
    solved: Solved
    store: TileStore
    words: MapWords
    crs: str | None = None
    gsd: float | None = None
    over: Path | None = None
    segment: int | None = None
    area: Area | None = None
    options: ExportOptions = field(default_factory=ExportOptions)
    written: tuple[Written, ...] = ()

    @property
    def trajectory(self) -> Trajectory:
        """The placements of the map's frames: all, or those of the piece that it shows."""
        if self.solved.georeferenced:
            return self.solved.trajectory
        return self.solved.trajectory.segment(self.solved.segment_numbers[0] if self.segment is None else self.segment)

    @property
    def pixel_size(self) -> float | None:
        """The pixel asked for, in units of the CRS; metres on the ground become degrees where those are its units."""
        grid = self.store.grid
        if self.gsd is None or grid.crs_wkt is None:
            return self.gsd
        target = parse_crs(self.crs or grid.crs_wkt)
        if not target.is_geographic:
            return self.gsd
        return min(pixel_steps(grid, target.to_wkt())) * self.gsd / ground_pixel_m(grid)

    @property
    def grid(self) -> MapGrid:
        """The grid of the formats that follow ``crs`` and ``gsd``."""
        return target_grid(self.store.grid, self.crs if self.solved.georeferenced else None, self.pixel_size, self.area)

    @property
    def source_key(self) -> str | None:
        """What names the pixels that are exported: the drawn map and what is cut out of it."""
        if not self.store.fingerprint:
            return None
        area = "" if self.area is None else f"{self.area.crs_wkt}{self.area.outline.wkb_hex}{self.area.masks}"
        return f"{__version__}|{self.store.fingerprint}|{self.store.revision}|{self.store.grid}|{area}"

    @property
    def finds(self) -> tuple[Find, ...]:
        """What was found: in the file named by the user, else in the mission's, else nothing."""
        if self.options.finds is not None:
            return read_finds(self.options.finds)
        own = self.mission.folder / FINDS_FILE
        return read_finds(own, may_be_none=True) if own.is_file() else ()


def write_format(wanted: Format, request: Request, path: Path, on_progress: Progress) -> list[Written]:
    """Write one format and return what was written."""
    with output_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    return _WRITERS[wanted](request, path, partial(on_progress, str(wanted)))


def _of_grid(wanted: Format, path: Path, grid: MapGrid, note: str = "") -> Written:
    return Written(wanted, path, None if grid.crs_wkt is None else ground_pixel_m(grid), note)


def _geotiff(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    if r.over is not None:
        outline = path.with_name(f"{path.stem}-footprint.geojson")
        write_over(
            r.store, r.over, path, date=r.words.last_utc, ce90_m=r.solved.predicted_ce90_m, footprint_path=outline,
            on_progress=on_progress,
        )  # fmt: skip
        return [Written(Format.GEOTIFF, path), Written(Format.GEOTIFF, outline)]
    o = r.options
    grid = write_geotiff(
        r.store, path, crs=r.crs, pixel_size=r.pixel_size, area=r.area, compression=o.compress, quality=o.quality,
        metadata=geotiff_tags(r.solved, r.words), on_progress=on_progress,
    )  # fmt: skip
    return [_of_grid(Format.GEOTIFF, path, grid)]


def _kml(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    write_kmz(
        r.store, path, gsd_m=r.gsd, area=r.area, quality=r.options.quality, words=r.words, on_progress=on_progress
    )
    return [Written(Format.KML, path)]


def _tiles(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    return _folder_of_tiles(r, path, on_progress, tms=False)


def _tms(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    return _folder_of_tiles(r, path, on_progress, tms=True)


def _folder_of_tiles(r: Request, path: Path, on_progress: OnProgress, *, tms: bool) -> list[Written]:
    o = r.options
    write_tiles(
        r.store, path, min_zoom=o.min_zoom, max_zoom=o.max_zoom, gsd_m=r.gsd, area=r.area, image_format=o.tile_format,
        quality=o.quality, tms=tms, words=r.words, source_key=r.source_key, on_progress=on_progress,
    )  # fmt: skip
    return [Written(Format.TMS if tms else Format.TILES, path)]


def _mbtiles(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    o = r.options
    write_mbtiles(
        r.store, path, min_zoom=o.min_zoom, max_zoom=o.max_zoom, gsd_m=r.gsd, area=r.area, image_format=o.tile_format,
        quality=o.quality, words=r.words, source_key=r.source_key, on_progress=on_progress,
    )  # fmt: skip
    return [Written(Format.MBTILES, path)]


def _pmtiles(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    o = r.options
    write_pmtiles(
        r.store, path, min_zoom=o.min_zoom, max_zoom=o.max_zoom, gsd_m=r.gsd, area=r.area, image_format=o.tile_format,
        quality=o.quality, words=r.words, source_key=r.source_key, on_progress=on_progress,
    )  # fmt: skip
    return [Written(Format.PMTILES, path)]


def _gpkg(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    write_geopackage(
        r.store, path, crs=r.crs if r.solved.georeferenced else None, pixel_size=r.pixel_size, area=r.area,
        image_format=r.options.tile_format, quality=r.options.quality, words=r.words, source_key=r.source_key,
        on_progress=on_progress,
    )  # fmt: skip
    return [_of_grid(Format.GPKG, path, r.grid)]


def _worldfile(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    files = write_picture(
        r.store, path, crs=r.crs if r.solved.georeferenced else None, pixel_size=r.pixel_size, area=r.area,
        quality=r.options.quality, words=r.words, on_progress=on_progress,
    )  # fmt: skip
    beside = [Written(Format.WORLDFILE, path.with_name(f.name)) for f in files[1:]]
    return [_of_grid(Format.WORLDFILE, path, r.grid), *beside]


def _geopdf(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    grid = write_geopdf(
        r.store, path, crs=r.crs, pixel_size=r.pixel_size, area=r.area, quality=r.options.quality, words=r.words,
        on_progress=on_progress,
    )  # fmt: skip
    shrunk = round(grid.pixel_size / r.grid.pixel_size)
    note = f"shrunk {shrunk} times to fit a page; --bbox keeps more detail" if shrunk > 1 else ""
    return [_of_grid(Format.GEOPDF, path, grid, note)]


def _atak(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    write_atak(
        r.store, path, now=datetime.now(UTC), finds=r.finds, gsd_m=r.gsd, area=r.area,
        image_format=r.options.tile_format, quality=r.options.quality, words=r.words, on_progress=on_progress,
    )  # fmt: skip
    return [Written(Format.ATAK, path)]


def _vectors(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    s = r.solved
    rows = pose_rows(s.frames, s.trajectory, s.map_frame, statuses=s.statuses, reasons=s.reasons)
    outline = footprint(clipped(r.store, r.area))
    about = {
        "name": r.words.title, "date": r.words.last_utc, "predicted_ce90_m": r.words.ce90_m,
        "attribution": r.words.attribution or None,
    }  # fmt: skip
    # the master may be drawn in another CRS than the frames are placed in
    map_crs, drawn_crs = s.map_frame.crs_wkt, r.store.grid.crs_wkt
    shown = VectorLayer("outline", (outline,) if not outline.is_empty else (), () if outline.is_empty else (about,))
    layers = [
        *flight_layers(s.frames, r.trajectory, s.map_frame, rows, _links(r.mission)),
        shown.moved(drawn_crs, map_crs),
    ]
    if (finds := r.finds) and map_crs is not None:
        lon_lat = [(f.lon_deg, f.lat_deg) for f in finds]
        places = point_map(WGS84, map_crs, around_xy=lon_lat)(lon_lat)
        found = tuple(
            {"name": f.name, "ce90_m": f.ce90_m, "time_utc": f.time_utc, "remarks": f.remarks, "kind": f.kind or None}
            for f in finds
        )
        layers.append(VectorLayer("finds", tuple(Point(p) for p in places), found))
    crs = r.crs if s.georeferenced and path.suffix.lower() == ".gpkg" else None
    write_vectors(layers, path, crs_wkt=map_crs, crs=crs, area=r.area, words=r.words)
    on_progress(1, 1)
    return [Written(Format.VECTORS, path)]


def _links(mission: Mission) -> list[Link]:
    """Return the registrations, one a pair: the accepted one where it was tried again."""
    best: dict[tuple[int, int], Link] = {}
    for g in mission.registrations:
        link = Link(g.a, g.b, g.kind.value, g.accepted, g.method, g.probability, g.overlap)
        if (g.a, g.b) not in best or link.accepted:
            best[g.a, g.b] = link
    return list(best.values())


def _poses(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    s = r.solved
    rows = pose_rows(s.frames, s.trajectory, s.map_frame, statuses=s.statuses, reasons=s.reasons)
    write_poses(rows, path, crs_wkt=s.map_frame.crs_wkt)
    on_progress(1, 1)
    return [Written(Format.POSES, path)]


def _layers(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    write_map_layers(
        r.solved, r.trajectory, r.store, path, crs=r.crs if r.solved.georeferenced else None, pixel_size=r.pixel_size,
        tags=geotiff_tags(r.solved, r.words), on_progress=on_progress,
    )  # fmt: skip
    return [Written(Format.LAYERS, path)]


def _stac(r: Request, path: Path, on_progress: OnProgress) -> list[Written]:
    assets = [w.path for w in r.written]
    grid = r.grid if any(w.format is Format.GEOTIFF for w in r.written) else r.store.grid
    own = r.mission.folder / DEFAULT_NAMES[Format.GEOTIFF]
    if not assets and own.is_file():
        assets, grid = [own], target_grid(r.store.grid, r.mission.header.settings.get("crs"))
    write_stac_item(r.store, path, assets, now=datetime.now(UTC), asset_grid=grid, area=r.area, words=r.words)
    on_progress(1, 1)
    return [Written(Format.STAC, path)]


_WRITERS: dict[Format, Callable[[Request, Path, OnProgress], list[Written]]] = {
    Format.GEOTIFF: _geotiff,
    Format.KML: _kml,
    Format.TILES: _tiles,
    Format.MBTILES: _mbtiles,
    Format.PMTILES: _pmtiles,
    Format.GPKG: _gpkg,
    Format.VECTORS: _vectors,
    Format.ATAK: _atak,
    Format.GEOPDF: _geopdf,
    Format.TMS: _tms,
    Format.WORLDFILE: _worldfile,
    Format.POSES: _poses,
    Format.LAYERS: _layers,
    Format.STAC: _stac,
}
