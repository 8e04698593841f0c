"""The map for Google Earth and for whatever reads KML: a superoverlay, sharp where one looks and quick from afar.

One small KML and one picture a tile: 256 pixels, north-up in longitude and latitude, each in its Region, linked from
its parent. ``doc.kml`` leads the archive; it also carries one overlay of the whole map for programs that follow no
links.
"""

from __future__ import annotations

import contextlib
import math
import re
import shutil
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.core.grid import Window
from photomap_gis.core.mosaic import TileSource
from photomap_gis.export.area import Area, clipped
from photomap_gis.export.crs import WGS84, bounds_in, needs_place, parse_crs, same_crs
from photomap_gis.export.encode import TileChoice, TileFormat, encode
from photomap_gis.export.pixel_grid import AffineGrid
from photomap_gis.export.pixels import Rgba
from photomap_gis.export.publish import file_in_place_of, folder_in_place_of
from photomap_gis.export.pyramid import Pyramid, Tile, TileKey
from photomap_gis.export.warp import Resampler, check_size, ground_pixel_m, pixel_steps
from photomap_gis.export.words import MapWords

_TILE_PX = 256
_MIN_LOD_PX = 128
_PREVIEW_TILES = 4  # the overlay of the whole map is at most this many tiles wide
_PREVIEW_HIDES_AT_PX = 512
_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n'

OnProgress = Callable[[int, int], None]
Put = Callable[[str, bytes], None]
_NO_WORDS = MapWords()


def write_kmz(
    source: TileSource,
    path: Path | str,
    *,
    gsd_m: float | None = None,
    area: Area | None = None,
    words: MapWords = _NO_WORDS,
    quality: int | None = None,
    on_progress: OnProgress | None = None,
) -> int:
    """Write the superoverlay and return how many tiles it holds.

    A ``.kmz`` is one archive; a ``.kml`` is a file with a folder of the same name beside it. Tiles with a border are
    PNG (alpha), the others JPEG of ``quality``. ``gsd_m`` is the finest level's pixel on the ground. The date is told
    in the description, not as a KML time: a time slider would hide the map.
    """
    path = Path(path).absolute()
    if path.suffix.lower() not in (".kmz", ".kml"):
        raise UsageError(f"{path.name} must end in .kmz or .kml")
    plan = _plan(clipped(source, area), gsd_m, area)
    if path.suffix.lower() == ".kml":
        # Readers differ on escapes in links: a plain name needs none.
        folder = f"{re.sub(r'[^A-Za-z0-9-]+', '_', path.stem).strip('_') or 'map'}_files"
        with (
            folder_in_place_of(path.parent / folder, ours=lambda f: (f / "0" / "0" / "0.kml").is_file()) as fresh,
            file_in_place_of(path, lambda p: _check_kml(p.read_bytes(), path)) as temporary,
        ):
            count = _write(plan, _put_file(fresh), folder, words, quality, on_progress)
            shutil.move(fresh / "doc.kml", temporary)
        return count
    with (
        file_in_place_of(path, lambda p: _check_kmz(p, path, count)) as temporary,
        zipfile.ZipFile(temporary, "w", allowZip64=True) as archive,
    ):
        count = _write(plan, _put_in(archive), "tiles", words, quality, on_progress)
    return count


def _plan(source: TileSource, gsd_m: float | None, area: Area | None) -> Pyramid:
    """Return the quad tree: its root holds the whole map, its leaves have the map's own resolution along both axes."""
    crs = needs_place(source.grid.crs_wkt, "KML")
    wgs84 = parse_crs(WGS84).to_wkt()
    box = source.grid.bounds if same_crs(crs, wgs84) else bounds_in(source.grid.bounds, crs, wgs84)
    west, south, east, north = box if area is None else area.cut(box, wgs84)  # type: ignore[arg-type]
    # Degrees of longitude are shorter than those of latitude: pixels square on the ground are not so in degrees.
    step_x, step_y = pixel_steps(source.grid, wgs84)
    if gsd_m is not None:
        step_x, step_y = (v * gsd_m / ground_pixel_m(source.grid) for v in (step_x, step_y))
    width, height = math.ceil((east - west) / step_x - 1e-6), math.ceil((north - south) / step_y - 1e-6)
    check_size((width, height), source.grid, f"a KML of {gsd_m:g} m a pixel" if gsd_m is not None else "a KML")
    levels = max(0, math.ceil(math.log2(max(width, height) / _TILE_PX)))
    side = _TILE_PX << levels
    grid = AffineGrid(wgs84, (step_x, 0.0, west, 0.0, -step_y, north), side, side)
    resampler = Resampler(source, grid)
    return Pyramid(resampler, Window(0, 0, max(1, width), max(1, height)), levels, 0, None, _TILE_PX)


def _write(
    plan: Pyramid, put: Put, folder: str, words: MapWords, quality: int | None, on_progress: OnProgress | None
) -> int:
    """Put doc.kml, then every tile's picture and KML; return the number of tiles."""
    root = TileKey(0, 0, 0)
    # doc.kml must come first and names only what is known beforehand.
    put("doc.kml", _document(plan, root, folder, words))
    prefix = "" if folder != "tiles" else "tiles/"
    preview_zoom = min(plan.max_zoom, int(math.log2(_PREVIEW_TILES)))
    preview = np.zeros((_TILE_PX << preview_zoom, _TILE_PX << preview_zoom, 4), np.uint8)
    shown: dict[TileKey, list[TileKey]] = {}
    count = 0

    def made(tile: Tile) -> tuple[TileKey, TileFormat, bytes, Rgba | None]:
        tile_format = TileChoice.MIXED.of(tile.rgba)
        kept = tile.rgba if tile.key.zoom == preview_zoom else None
        return tile.key, tile_format, encode(tile.rgba, tile_format, quality), kept

    for key, tile_format, data, rgba in plan.made(made, on_progress):
        count += 1
        stem = f"{prefix}{key.zoom}/{key.x}/{key.y}"
        put(f"{stem}.{tile_format.value}", data)
        put(f"{stem}.kml", _tile_kml(plan, key, f"{key.y}.{tile_format.value}", shown.pop(key, [])))
        if key.zoom:
            shown.setdefault(TileKey(key.zoom - 1, key.x // 2, key.y // 2), []).append(key)
        if rgba is not None:
            n = _TILE_PX
            preview[key.y * n : (key.y + 1) * n, key.x * n : (key.x + 1) * n] = rgba
    if count == 0:
        raise OutputError("the KML was not written: the map shows nothing")
    put(f"{prefix}overview.png", encode(_cut_to(plan, preview, preview_zoom), TileFormat.PNG))
    return count


def _cut_to(plan: Pyramid, preview: Rgba, zoom: int) -> Rgba:
    width, height = _preview_size(plan, zoom)
    return np.ascontiguousarray(preview[:height, :width])


def _preview_size(plan: Pyramid, zoom: int) -> tuple[int, int]:
    shrink = 1 << (plan.max_zoom - zoom)
    return -(-plan.extent.width // shrink), -(-plan.extent.height // shrink)


def _box(plan: Pyramid, col: float, row: float, width: float, height: float) -> tuple[float, float, float, float]:
    """West, south, east, north in degrees of a rectangle of leaf pixels."""
    corners = _grid(plan).to_crs([[col - 0.5, row - 0.5], [col + width - 0.5, row + height - 0.5]])
    return float(corners[0, 0]), float(corners[1, 1]), float(corners[1, 0]), float(corners[0, 1])


def _grid(plan: Pyramid) -> AffineGrid:
    return cast(AffineGrid, cast(Resampler, plan.resampler).grid)


def _tile_box(plan: Pyramid, key: TileKey) -> tuple[float, float, float, float]:
    span = _TILE_PX << (plan.max_zoom - key.zoom)
    return _box(plan, key.x * span, key.y * span, span, span)


def _document(plan: Pyramid, root: TileKey, folder: str, words: MapWords) -> bytes:
    zoom = min(plan.max_zoom, int(math.log2(_PREVIEW_TILES)))
    width, height = _preview_size(plan, zoom)
    shrink = 1 << (plan.max_zoom - zoom)
    preview = _box(plan, 0, 0, width * shrink, height * shrink)
    west, south, east, north = _box(plan, 0, 0, plan.extent.width, plan.extent.height)
    range_m = max(200.0, 1.2 * math.radians(north - south) * 6378137.0)
    return (
        f"{_HEAD}<Document>\n<name>{escape(words.title)}</name>\n"
        f"<description>{escape(words.paragraph)}</description>\n<open>1</open>\n{_extended_data(words)}"
        f"<LookAt><longitude>{(west + east) / 2:.10f}</longitude><latitude>{(south + north) / 2:.10f}</latitude>"
        f"<altitude>0</altitude><heading>0</heading><tilt>0</tilt><range>{range_m:.1f}</range></LookAt>\n"
        f"<GroundOverlay>\n<name>overview</name>\n<drawOrder>0</drawOrder>\n"
        f"<Icon><href>{folder}/overview.png</href></Icon>\n{_lat_lon_box(preview)}"
        f"{_region(preview, 0, _PREVIEW_HIDES_AT_PX)}</GroundOverlay>\n"
        f"{_network_link(_tile_box(plan, root), f'{folder}/0/0/0.kml', 'tiles', 0)}"
        "</Document>\n</kml>\n"
    ).encode()


def _extended_data(words: MapWords) -> str:
    rows = "".join(
        f'<Data name="{escape(key)}"><value>{escape(value)}</value></Data>\n' for key, value in words.pairs.items()
    )
    return f"<ExtendedData>\n{rows}</ExtendedData>\n" if rows else ""


def _tile_kml(plan: Pyramid, key: TileKey, image: str, children: list[TileKey]) -> bytes:
    box = _tile_box(plan, key)
    least = 0 if key.zoom == 0 else _MIN_LOD_PX
    links = "".join(
        _network_link(_tile_box(plan, c), f"../../{c.zoom}/{c.x}/{c.y}.kml", f"{c.zoom}/{c.x}/{c.y}", _MIN_LOD_PX)
        for c in sorted(children)
    )
    return (
        f"{_HEAD}<Document>\n<name>{key.zoom}/{key.x}/{key.y}</name>\n{_region(box, least, -1)}"
        f"<GroundOverlay>\n<name>{key.zoom}/{key.x}/{key.y}</name>\n<drawOrder>{key.zoom + 1}</drawOrder>\n"
        f"<Icon><href>{image}</href></Icon>\n{_lat_lon_box(box)}</GroundOverlay>\n{links}</Document>\n</kml>\n"
    ).encode()


def _network_link(box: tuple[float, float, float, float], href: str, name: str, least_px: int) -> str:
    return (
        f"<NetworkLink>\n<name>{name}</name>\n{_region(box, least_px, -1)}"
        f"<Link><href>{href}</href><viewRefreshMode>onRegion</viewRefreshMode></Link>\n</NetworkLink>\n"
    )


def _region(box: tuple[float, float, float, float], least_px: int, most_px: int) -> str:
    return (
        f"<Region><LatLonAltBox>{_edges(box)}</LatLonAltBox>"
        f"<Lod><minLodPixels>{least_px}</minLodPixels><maxLodPixels>{most_px}</maxLodPixels></Lod></Region>\n"
    )


def _lat_lon_box(box: tuple[float, float, float, float]) -> str:
    return f"<LatLonBox>{_edges(box)}</LatLonBox>\n"


def _edges(box: tuple[float, float, float, float]) -> str:
    west, south, east, north = box
    # Twelve digits: a millionth of a pixel, even of a millimetre one.
    return f"<north>{north:.12f}</north><south>{south:.12f}</south><east>{east:.12f}</east><west>{west:.12f}</west>"


def _put_in(archive: zipfile.ZipFile) -> Put:
    def put(member: str, data: bytes) -> None:
        packed = zipfile.ZIP_DEFLATED if member.endswith(".kml") else zipfile.ZIP_STORED
        # A fixed date: the same map gives the same bytes.
        info = zipfile.ZipInfo(member, (1980, 1, 1, 0, 0, 0))
        info.compress_type, info.external_attr = packed, 0o644 << 16
        archive.writestr(info, data)

    return put


def _put_file(folder: Path) -> Put:
    def put(member: str, data: bytes) -> None:
        file = folder / member
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)

    return put


def _check_kmz(temporary: Path, path: Path, count: int) -> None:
    with _damage_of(path), zipfile.ZipFile(temporary) as archive:
        names = archive.namelist()
        if archive.testzip() is not None or names[0] != "doc.kml" or len(names) != 2 * count + 2:
            raise OutputError(f"{path} is damaged after writing; check the disk")
        _check_kml(archive.read("doc.kml"), path)


def _check_kml(data: bytes, path: Path) -> None:
    with _damage_of(path):
        ElementTree.fromstring(data)


@contextlib.contextmanager
def _damage_of(path: Path) -> Iterator[None]:
    try:
        yield
    except (zipfile.BadZipFile, ElementTree.ParseError) as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
