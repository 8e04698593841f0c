"""What an incident commander can use at once: the map in the formats of the field, in one file that fits the link."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import math
import re
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import pyogrio

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.export.warp import ground_pixel_m
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.deliver import export_files
from photomap_gis.pipeline.formats import DEFAULT_NAMES, ExportOptions, Format
from photomap_gis.pipeline.handover_page import (
    finds_of,
    frame_numbers,
    map_picture,
    page_of,
    times_of,
    write_finds,
)
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.publish import file_in_place_of
from photomap_gis.report import FlightTimes, PackedFile, page_html
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

SUMMARY, SUMS = "summary.html", "SHA256SUMS"
PICTURE_PX, SMALL_PICTURE_PX = 1400, 700
SMALL_BUDGET_BYTES = 4_000_000
LOSSY_QUALITY = 80
MOST_TRIES = 12
SHRINK_SLACK = 1.06

_PURPOSE = {
    Format.GEOTIFF: "the map for QGIS, ArcGIS, ATAK",
    Format.KML: "the map for Google Earth, ATAK",
    Format.MBTILES: "the map for phones and tablets",
    Format.VECTORS: "track, camera positions, footprints, outline, finds",
    Format.POSES: "one row a frame: place, heading, sigma, status",
}
_ORDER = (SUMMARY, "map.tif", "map.kmz", "map.mbtiles", "vectors.gpkg", "poses.csv")


@dataclass(frozen=True, slots=True)
class PackageSummary:
    """What was packed; ``lost`` says in words what the limit cost, ``gsd_m_per_px`` is the packed map's pixel."""

    mission: str
    package: str
    bytes: int
    max_bytes: int | None
    gsd_m_per_px: float | None
    native_gsd_m_per_px: float | None
    compression: str
    files: tuple[PackedFile, ...]
    lost: tuple[str, ...]
    times: tuple[FlightTimes, ...]
    frames: dict[str, Any]
    warnings: tuple[str, ...] = field(default=())

    def as_document(self) -> dict[str, Any]:
        """Return the JSON document of ``photomap package --json``."""
        return asdict(self) | {"outputs": [str(self.package)]}


@dataclass(frozen=True, slots=True)
class _Form:
    """How the map is packed: formats, whether lossy, how many times coarser than it is, and the KMZ beyond that.

    A KMZ has PNG pictures along the map's border, which are most of its bytes.
    """

    formats: tuple[Format, ...]
    lossy: bool = False
    shrink: float = 1.0
    kmz_shrink: float = 1.0

    @property
    def compression(self) -> str:
        """The GeoTIFF's."""
        return "jpeg" if self.lossy else "deflate"


def parse_size(text: str) -> int:
    """Return the bytes of ``20MB``, ``800 kB``, ``1.5GB``, ``4MiB`` or a number; ``UsageError`` for anything else.

    >>> parse_size("20MB"), parse_size("1.5 kB"), parse_size("1MiB")
    (20000000, 1500, 1048576)
    """
    found = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([kmg]?)(i?)b?\s*", text, re.IGNORECASE)
    if found is None or not float(found[1]) > 0:
        raise UsageError(f"--max-size {text}: write a size such as 20MB, 800kB or 1.5GB")
    base = 1024 if found[3] else 1000
    return int(float(found[1]) * base ** " kmg".index(found[2].lower() or " "))


def package_mission(
    folder: Path,
    out: Path,
    *,
    max_bytes: int | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> PackageSummary:
    """Pack a mission's map, vectors, finds, checksums and a page of summary into one zip, and return what is in it.

    Where that would be larger than ``max_bytes``, the map is packed with loss, then coarser, then in fewer formats. The
    same mission and version give the same bytes. Raises ``OutputError`` where even the smallest is too large.
    """
    if out.suffix.lower() != ".zip":
        raise UsageError(f"-o {out} must end in .zip")
    if not out.absolute().parent.is_dir():
        raise OutputError(f"{out} cannot be written: the folder {out.parent} does not exist; create it")
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        store = TileStore(mission.mosaic_folder())
        times, why_not = times_of(mission)
        finds = finds_of(mission, solved)
    formats = (Format.GEOTIFF, Format.KML, Format.MBTILES) if solved.georeferenced else (Format.GEOTIFF,)
    picture_px = SMALL_PICTURE_PX if max_bytes is not None and max_bytes < SMALL_BUDGET_BYTES else PICTURE_PX
    picture = map_picture(store, picture_px, georeferenced=solved.georeferenced)
    gsd = ground_pixel_m(store.grid) if solved.georeferenced else None
    with tempfile.TemporaryDirectory(prefix=".photomap-", dir=out.absolute().parent) as scratch:
        base = Path(scratch) / "base"
        base.mkdir()
        wanted = [Format.POSES, *([Format.VECTORS] if solved.georeferenced else [])]
        with _fixed_date():
            export_files(folder, wanted, out=base if len(wanted) > 1 else base / "poses.csv")
        snapshots = write_finds(mission.folder, finds, store, base)

        fixed_bytes = sum(p.stat().st_size for p in base.rglob("*") if p.is_file())
        form, size = _first_form(folder, formats, max_bytes), 0
        for tried in range(1, MOST_TRIES + 1):
            maps = Path(scratch) / f"maps-{tried}"
            maps.mkdir()
            _write_maps(folder, form, store, maps, on_progress)
            members = {
                p.relative_to(root).as_posix(): p for root in (maps, base) for p in root.rglob("*") if p.is_file()
            }
            files = tuple(
                PackedFile(name, members[name].stat().st_size, _purpose(name)) for name in sorted(members, key=_rank)
            )
            lost = _lost(form, formats, gsd)
            page = page_of(folder, solved, picture, times, why_not, snapshots, files, lost, gsd, form.shrink, SUMS)
            html = page_html(page).encode("utf-8")
            draft = Path(scratch) / "handover.zip"
            _zip(draft, members, html)
            size = draft.stat().st_size
            logger.info("%s, %.2f times coarser: %d bytes", form.compression, form.shrink, size)
            if max_bytes is None or size <= max_bytes:
                break
            shutil.rmtree(maps)
            beside = fixed_bytes + len(html)
            kmz_bytes = sum(f.bytes for f in files if f.name == DEFAULT_NAMES[Format.KML])
            following = _smaller(form, size, kmz_bytes, max_bytes, beside)
            if following is None or tried == MOST_TRIES:
                least = f"page and vectors alone have {beside}" if beside >= max_bytes else f"the smallest has {size}"
                raise OutputError(f"{folder} cannot be packed into {max_bytes} bytes: {least}; raise --max-size")
            form = following
        with file_in_place_of(out.absolute(), lambda p: _check(p, out)) as temporary:
            shutil.move(draft, temporary)
    return PackageSummary(
        str(folder), str(out), size, max_bytes, None if gsd is None else gsd * form.shrink, gsd, form.compression,
        files, lost, times, frame_numbers(solved), solved.warnings,
    )  # fmt: skip


@contextlib.contextmanager
def _fixed_date() -> Iterator[None]:
    """Have GeoPackages written without the moment of writing: the same mission gives the same bytes."""
    option = "OGR_CURRENT_DATE"
    before = pyogrio.get_gdal_config_option(option)
    pyogrio.set_gdal_config_options({option: "1980-01-01T00:00:00.000Z"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({option: before})


def _first_form(folder: Path, formats: tuple[Format, ...], max_bytes: int | None) -> _Form:
    """Return the map as it is; with loss at once where the map alone is larger than the limit."""
    known = folder / DEFAULT_NAMES[Format.GEOTIFF]
    lossy = max_bytes is not None and known.is_file() and known.stat().st_size > max_bytes
    return _Form(formats, lossy)


def _smaller(form: _Form, size: int, kmz_bytes: int, max_bytes: int, fixed_bytes: int) -> _Form | None:
    """Return what to try next: first loss, then coarser pixels, then fewer formats; ``None`` where nothing is left."""
    if fixed_bytes >= max_bytes:
        return None
    if not form.lossy:
        return replace(form, lossy=True)
    share = (max_bytes - fixed_bytes) / len(form.formats)
    if form.kmz_shrink < _MOST_KMZ_SHRINK and kmz_bytes > share and kmz_bytes > 0.45 * (size - fixed_bytes):
        more = SHRINK_SLACK * math.sqrt(kmz_bytes / share)
        return replace(form, kmz_shrink=min(_MOST_KMZ_SHRINK, form.kmz_shrink * more))
    over = (size - fixed_bytes) / (max_bytes - fixed_bytes)
    shrink = form.shrink * max(SHRINK_SLACK, SHRINK_SLACK * math.sqrt(max(over, 1.0)))
    if shrink <= _MOST_SHRINK[len(form.formats)]:
        return replace(form, shrink=shrink)
    if len(form.formats) == 1:
        return None
    fewer = form.formats[:-1]
    # What was left out had about its share of the bytes.
    return _Form(fewer, True, max(1.0, shrink * math.sqrt(len(fewer) / len(form.formats))), form.kmz_shrink)


_MOST_KMZ_SHRINK = 4.0
_MOST_SHRINK = {3: 4.0, 2: 8.0, 1: 64.0}
"""So many times coarser a map may become before a format is left out instead, by the number of formats."""


def _write_maps(folder: Path, form: _Form, store: TileStore, maps: Path, on_progress: Progress) -> None:
    options = ExportOptions(
        compress=form.compression, quality=LOSSY_QUALITY if form.lossy else None,
        tile_format="webp" if form.lossy else "auto",
    )  # fmt: skip
    for wanted in form.formats:
        shrink = form.shrink * (form.kmz_shrink if wanted is Format.KML else 1.0)
        gsd = None if shrink == 1.0 else store.grid.pixel_size * shrink
        if store.grid.crs_wkt is None and gsd is not None:
            raise OutputError("a map without a place on Earth keeps its own pixels: raise --max-size")
        export_files(folder, [wanted], out=maps / DEFAULT_NAMES[wanted], gsd=gsd, options=options,
                     on_progress=on_progress)  # fmt: skip


def _lost(form: _Form, formats: tuple[Format, ...], gsd: float | None) -> tuple[str, ...]:
    """Say what the limit cost."""
    lost = []
    if form.lossy:
        lost.append(f"pictures are compressed with loss (JPEG in the GeoTIFF, WEBP tiles, quality {LOSSY_QUALITY})")
    if form.shrink > 1.0 and gsd is not None:
        lost.append(
            f"pixels are {100 * gsd * form.shrink:.1f} cm instead of {100 * gsd:.1f} cm: details smaller than "
            f"{200 * gsd * form.shrink:.0f} cm are gone"
        )
    if form.kmz_shrink > 1.0 and gsd is not None and Format.KML in form.formats:
        lost.append(f"map.kmz has pixels of {100 * gsd * form.shrink * form.kmz_shrink:.1f} cm")
    lost += [f"{DEFAULT_NAMES[f]} is left out" for f in formats if f not in form.formats]
    return tuple(lost)


def _purpose(name: str) -> str:
    if name.startswith("finds"):
        return "what was found" if name.endswith(".geojson") else "a find on the map"
    return next((_PURPOSE[f] for f in _PURPOSE if DEFAULT_NAMES[f] == name), "")


def _rank(name: str) -> tuple[int, str]:
    return (_ORDER.index(name) if name in _ORDER else len(_ORDER), name)


def _zip(path: Path, members: dict[str, Path], html: bytes) -> None:
    """Write the archive: the page first, the checksums last, the same bytes from the same files."""
    sums = [f"{hashlib.sha256(html).hexdigest()}  {SUMMARY}"]
    with zipfile.ZipFile(path, "w", allowZip64=True) as archive:
        archive.writestr(_info(SUMMARY), html)
        for name in sorted(members, key=_rank):
            digest = hashlib.sha256()
            with members[name].open("rb") as file, archive.open(_info(name), "w", force_zip64=True) as out:
                while block := file.read(1 << 20):
                    digest.update(block)
                    out.write(block)
            sums.append(f"{digest.hexdigest()}  {name}")
        archive.writestr(_info(SUMS), "\n".join(sums) + "\n")


def _info(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # a fixed date: the same mission gives the same bytes
    info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    return info


def _check(temporary: Path, out: Path) -> None:
    try:
        with zipfile.ZipFile(temporary) as archive:
            if archive.testzip() is None and {SUMMARY, SUMS} <= set(archive.namelist()):
                return
    except zipfile.BadZipFile:
        pass
    raise OutputError(f"{out} is damaged after writing; check the disk")
