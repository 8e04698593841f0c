"""From a mission's map to files for other programs: the formats, their names, and who may have them."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from functools import partial
from pathlib import Path

from photomap_gis import __version__
from photomap_gis.core.errors import NotGeoreferencedError, PhotomapError, UsageError
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.export import pose_rows, write_geotiff, write_kmz, write_mbtiles, write_over, write_poses, write_tiles
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.control import checked, residual_rms_m
from photomap_gis.pipeline.draw import DrawnMap
from photomap_gis.pipeline.layers import write_map_layers
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.publish import file_in_place_of
from photomap_gis.store import Mission


class Format(StrEnum):
    """The formats of ``photomap export``; each is a flag of that name."""

    GEOTIFF = "geotiff"
    KML = "kml"
    TILES = "tiles"
    MBTILES = "mbtiles"
    POSES = "poses"
    LAYERS = "layers"


DEFAULT_NAMES = {
    Format.GEOTIFF: "map.tif",
    Format.KML: "map.kmz",
    Format.TILES: "tiles",
    Format.MBTILES: "map.mbtiles",
    Format.POSES: "poses.csv",
    Format.LAYERS: "layers",
}

SUFFIXES = {
    Format.GEOTIFF: (".tif", ".tiff"),
    Format.KML: (".kmz", ".kml"),
    Format.TILES: ("",),
    Format.MBTILES: (".mbtiles",),
    Format.POSES: (".csv", ".geojson", ".json"),
    Format.LAYERS: ("",),
}

FOLDERS = {Format.TILES, Format.LAYERS}
"""Formats that are folders of files."""

NEEDS_PLACE = {Format.KML, Format.TILES, Format.MBTILES}


def deliver(
    mission: Mission, solved: Solved, maps: Sequence[DrawnMap], on_progress: Progress, *, layers: bool = False
) -> list[Path]:
    """Write what every mapping run leaves: ``map.tif``, ``map.kmz``; without GPS ``map-1.tif``, ... and ``map.tif``.

    With ``layers``, or where an earlier run left some, ``layers/`` too; of pieces without GPS also ``layers-2/``, ...
    """
    layers_folder = mission.folder / DEFAULT_NAMES[Format.LAYERS]
    layers = layers or layers_folder.is_dir()  # layers of the map as it was would not be true any more
    main = mission.folder / DEFAULT_NAMES[Format.GEOTIFF]
    if solved.georeferenced:
        kmz = mission.folder / DEFAULT_NAMES[Format.KML]
        request = _Request(mission, solved, maps[0].store, crs=mission.header.settings.get("crs"))
        _write(Format.GEOTIFF, request, main, on_progress)
        _write(Format.KML, request, kmz, on_progress)
        _remove_pieces(mission.folder)
        return [main, kmz, *(_write(Format.LAYERS, request, layers_folder, on_progress) if layers else ())]
    numbered = [mission.folder / f"map-{n}.tif" for n in range(1, len(maps) + 1)]
    for path, drawn in zip(numbered, maps, strict=True):
        _write(Format.GEOTIFF, _Request(mission, solved, drawn.store), path, on_progress)
    copy_as(numbered[0], main)
    written = [main, *numbered]
    for n, drawn in enumerate(maps if layers else (), start=1):
        folder = layers_folder if n == 1 else layers_folder.with_name(f"{layers_folder.name}-{n}")
        written += _write(
            Format.LAYERS, _Request(mission, solved, drawn.store, segment=drawn.segment), folder, on_progress
        )
    return written


def _remove_pieces(folder: Path) -> None:
    """Remove the maps of single pieces that a mission leaves while it has no place on Earth: they are one map now."""
    for path in folder.iterdir():
        if re.fullmatch(r"map-\d+\.tif", path.name) and path.is_file():
            path.unlink()
        elif re.fullmatch(r"(mosaic|layers)-\d+", path.name) and path.is_dir():
            shutil.rmtree(path, ignore_errors=True)


def export_mission(
    folder: Path,
    formats: Sequence[Format],
    *,
    out: Path | None = None,
    over: Path | None = None,
    crs: str | None = None,
    gsd: float | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> list[Path]:
    """Write a mission's map in the formats asked for and return the files; nothing is measured or drawn again.

    ``out`` names the file where one format is asked and the folder where several are. Every format is tried; where
    some could not be written, the first one's error is raised at the end.
    """
    if over is not None and formats != [Format.GEOTIFF]:
        raise UsageError("--over goes with --geotiff alone: it writes a raster on OLD's grid")
    if over is not None and (crs is not None or gsd is not None):
        raise UsageError("--over takes CRS and pixel from OLD: leave --crs and --gsd away")
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        asked = crs or mission.header.settings.get("crs")
        request = _Request(mission, solved, TileStore(mission.mosaic_folder()), asked, gsd, over)
        targets = _targets(folder, formats, out, over)
        errors: list[PhotomapError] = []
        written: list[Path] = []
        for wanted, path in targets:
            try:
                if wanted in NEEDS_PLACE and not solved.georeferenced:
                    raise NotGeoreferencedError(
                        f"--{wanted} needs a place on Earth, and this mission has no GPS: map it again with --track "
                        "FILE or --gcp FILE; --geotiff and --poses work in local units"
                    )
                written += _write(wanted, request, path, on_progress)
            except PhotomapError as error:
                errors.append(error)
    if errors:
        if len(errors) > 1:
            raise type(errors[0])("; ".join(str(e) for e in errors))
        raise errors[0]
    return written


@dataclass(frozen=True, slots=True)
class _Request:
    """What is exported; ``crs`` is what the user of the mission or of the export wrote."""

    mission: Mission
    solved: Solved
    store: TileStore
    crs: str | None = None
    gsd: float | None = None
    over: Path | None = None
    segment: int | None = None

    @property
    def trajectory(self) -> Trajectory:
        """The placements of the map's frames: all, or those of the piece that it shows."""
        if self.solved.georeferenced:
            return self.solved.trajectory
        return self.solved.trajectory.segment(self.solved.segment_numbers[0] if self.segment is None else self.segment)


def _targets(folder: Path, formats: Sequence[Format], out: Path | None, over: Path | None) -> list[tuple[Format, Path]]:
    names = dict(DEFAULT_NAMES)
    if over is not None:
        names[Format.GEOTIFF] = f"{over.stem}-updated.tif"  # map.tif stays the map
    if out is None:
        return [(f, folder / names[f]) for f in formats]
    if len(formats) > 1 or (out.is_dir() and formats[0] not in FOLDERS):
        if len(formats) > 1 and out.is_file():
            raise UsageError(f"{out} is a file: with several formats -o names the folder for them")
        return [(f, out / names[f]) for f in formats]
    if formats[0] not in FOLDERS and out.suffix.lower() not in SUFFIXES[formats[0]]:
        raise UsageError(f"-o {out} must end in {' or '.join(SUFFIXES[formats[0]])} for --{formats[0]}")
    return [(formats[0], out)]


def _write(wanted: Format, request: _Request, path: Path, on_progress: Progress) -> list[Path]:
    """Write one format and return its files."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return _WRITERS[wanted](request, path, partial(on_progress, str(wanted)))


def _geotiff(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    if r.over is not None:
        footprint = path.with_name(f"{path.stem}-footprint.geojson")
        write_over(
            r.store, r.over, path, date=_flown(r.solved), ce90_m=r.solved.predicted_ce90_m, footprint_path=footprint,
            on_progress=on_progress,
        )  # fmt: skip
        return [path, footprint]
    write_geotiff(r.store, path, crs=r.crs, pixel_size=r.gsd, metadata=_tags(r.solved), on_progress=on_progress)
    return [path]


def _kml(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    write_kmz(r.store, path, name=_title(r.solved), description=_words(r.solved), when=_flown(r.solved),
              on_progress=on_progress)  # fmt: skip
    return [path]


def _tiles(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    write_tiles(r.store, path, name=_title(r.solved), description=_words(r.solved), on_progress=on_progress)
    return [path]


def _mbtiles(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    write_mbtiles(r.store, path, name=_title(r.solved), description=_words(r.solved), on_progress=on_progress)
    return [path]


def _poses(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    s = r.solved
    rows = pose_rows(s.frames, s.trajectory, s.map_frame, statuses=s.statuses, reasons=s.reasons)
    write_poses(rows, path, crs_wkt=s.map_frame.crs_wkt)
    on_progress(1, 1)
    return [path]


def _layers(r: _Request, path: Path, on_progress: Callable[[int, int], None]) -> list[Path]:
    write_map_layers(
        r.solved, r.trajectory, r.store, path, crs=r.crs if r.solved.georeferenced else None, pixel_size=r.gsd,
        tags=_tags(r.solved), on_progress=on_progress,
    )  # fmt: skip
    return [path]


_WRITERS: dict[Format, Callable[[_Request, Path, Callable[[int, int], None]], list[Path]]] = {
    Format.GEOTIFF: _geotiff,
    Format.KML: _kml,
    Format.TILES: _tiles,
    Format.MBTILES: _mbtiles,
    Format.POSES: _poses,
    Format.LAYERS: _layers,
}


def _flown(solved: Solved) -> str | None:
    """Return the date of the newest frame, ISO 8601, or ``None``."""
    times = [f.time_s for f in solved.frames if f.time_s is not None]
    return datetime.fromtimestamp(max(times), UTC).strftime("%Y-%m-%dT%H:%M:%SZ") if times else None


def _title(solved: Solved) -> str:
    flown = _flown(solved)
    return f"photomap {flown[:10]}" if flown else "photomap"


def _words(solved: Solved) -> str:
    parts = [f"Photo map of {len(solved.trajectory.placements)} frames"]
    if flown := _flown(solved):
        parts.append(f"newest frame {flown}")
    if solved.predicted_ce90_m is not None:
        parts.append(f"predicted CE90 {solved.predicted_ce90_m:.1f} m")
    if (found := checked(solved.control)) is not None:
        parts.append(f"NSSDA {found.nssda_95_m:.2f} m at 95 % by {found.method}")
    if not solved.georeferenced:
        parts.append("NOT GEOREFERENCED: local units")
    return "; ".join(parts)


def _tags(solved: Solved) -> dict[str, str]:
    tags = {"TIFFTAG_SOFTWARE": f"photomap {__version__}", "TIFFTAG_IMAGEDESCRIPTION": _words(solved)}
    if flown := _flown(solved):
        tags["TIFFTAG_DATETIME"] = flown[:19].replace("-", ":").replace("T", " ")
    if solved.predicted_ce90_m is not None:
        tags["PREDICTED_CE90_M"] = f"{solved.predicted_ce90_m:.2f}"
    if solved.fit_to_gps_rms_m is not None:
        tags["FIT_TO_GPS_RMS_M"] = f"{solved.fit_to_gps_rms_m:.2f}"
    if (rms := residual_rms_m(solved.control)) is not None:
        tags["CONTROL_POINTS"] = str(sum(r.used and not r.check for r in solved.control))
        tags["CONTROL_RESIDUAL_RMS_M"] = f"{rms:.3f}"
    if (found := checked(solved.control)) is not None:
        tags |= {
            "CHECK_POINTS": str(found.n),
            "CHECK_RMSE_X_M": f"{found.rmse_x_m:.3f}",
            "CHECK_RMSE_Y_M": f"{found.rmse_y_m:.3f}",
            "CHECK_RMSE_R_M": f"{found.rmse_r_m:.3f}",
            "CHECK_CE90_M": f"{found.ce90_m:.3f}",
            "CHECK_NSSDA_95_M": f"{found.nssda_95_m:.3f}",
            "CHECK_METHOD": found.method,
        }
    return tags


def copy_as(source: Path, target: Path) -> None:
    """Give a file a second name: a hard link where the disk can, else a copy; replaced whole."""
    with file_in_place_of(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
