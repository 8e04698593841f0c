"""From a mission's map to files for other programs: after a mapping run, and whenever an export is asked for."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from photomap_gis.core.errors import NotGeoreferencedError, PhotomapError
from photomap_gis.export.area import parse_bbox
from photomap_gis.export.cutline import read_cutline
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.draw import DrawnMap
from photomap_gis.pipeline.formats import DEFAULT_NAMES, NEEDS_PLACE, ExportOptions, Format, check_request, targets
from photomap_gis.pipeline.inputs import input_files, inputs_document
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.words import map_words
from photomap_gis.pipeline.writers import Request, Written, write_format
from photomap_gis.publish import file_in_place_of
from photomap_gis.store import Mission

_PLAIN = ExportOptions()


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
        request = _request(mission, solved, maps[0].store, on_progress, crs=mission.header.settings.get("crs"))
        write_format(Format.GEOTIFF, request, main, on_progress)
        write_format(Format.KML, request, kmz, on_progress)
        _remove_pieces(mission.folder)
        return [
            main,
            kmz,
            *((w.path for w in write_format(Format.LAYERS, request, layers_folder, on_progress)) if layers else ()),
        ]
    numbered = [mission.folder / f"map-{n}.tif" for n in range(1, len(maps) + 1)]
    for path, drawn in zip(numbered, maps, strict=True):
        write_format(Format.GEOTIFF, _request(mission, solved, drawn.store, on_progress), path, on_progress)
    copy_as(numbered[0], main)
    written = [main, *numbered]
    for n, drawn in enumerate(maps if layers else (), start=1):
        folder = layers_folder if n == 1 else layers_folder.with_name(f"{layers_folder.name}-{n}")
        request = _request(mission, solved, drawn.store, on_progress, segment=drawn.segment)
        written += [w.path for w in write_format(Format.LAYERS, request, folder, on_progress)]
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
    options: ExportOptions = _PLAIN,
    on_progress: Progress = lambda stage, done, total: None,
) -> list[Path]:
    """Write a mission's map in the formats asked for and return the files; see ``export_files``."""
    written = export_files(
        folder, formats, out=out, over=over, crs=crs, gsd=gsd, options=options, on_progress=on_progress
    )
    return [w.path for w in written]


def export_files(
    folder: Path,
    formats: Sequence[Format],
    *,
    out: Path | None = None,
    over: Path | None = None,
    crs: str | None = None,
    gsd: float | None = None,
    options: ExportOptions = _PLAIN,
    on_progress: Progress = lambda stage, done, total: None,
) -> list[Written]:
    """Write a mission's map in the formats asked for and return what was written; nothing is measured or drawn again.

    ``out`` names the file where one format is asked and the folder where several are. ``gsd`` is in units of the CRS of
    the format, in metres on the ground where those are degrees. Every format is tried; where some could not be written,
    the first one's error is raised at the end.
    """
    check_request(formats, over, crs, gsd, options)
    with Mission.open(folder) as mission:
        solved = Solved.load(mission)
        store = TileStore(mission.mosaic_folder())
        asked = crs or mission.header.settings.get("crs")
        request = _request(mission, solved, store, on_progress, crs=asked, gsd=gsd, over=over, options=options)
        errors: list[PhotomapError] = []
        written: list[Written] = []
        for wanted, path in targets(folder, formats, out, over):
            try:
                if wanted in NEEDS_PLACE and not solved.georeferenced:
                    raise NotGeoreferencedError(
                        f"--{wanted} needs a place on Earth, and this mission has no GPS: map it again with --track "
                        "FILE or --gcp FILE, or pick two places by 'photomap georeference'; --geotiff, --worldfile, "
                        "--gpkg, --vectors, --layers and --poses work in local units"
                    )
                written += write_format(wanted, replace(request, written=tuple(written)), path, on_progress)
            except PhotomapError as error:
                errors.append(error)
    if errors:
        if len(errors) > 1:
            raise type(errors[0])("; ".join(str(e) for e in errors))
        raise errors[0]
    return written


def _request(
    mission: Mission,
    solved: Solved,
    store: TileStore,
    on_progress: Progress,
    *,
    crs: str | None = None,
    gsd: float | None = None,
    over: Path | None = None,
    options: ExportOptions = _PLAIN,
    segment: int | None = None,
) -> Request:
    inputs = inputs_document(input_files(mission, solved.frames, partial(on_progress, "inputs")))
    area = None
    if options.bbox is not None:
        area = parse_bbox(options.bbox, options.bbox_crs, store.grid.crs_wkt)
    elif options.cutline is not None:
        area = read_cutline(options.cutline)
    asked = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(options).items()}
    settings = {**mission.header.settings, "export": {k: v for k, v in asked.items() if v not in (None, "")}}
    if gsd is not None:
        settings["export"]["gsd"] = gsd
    words = map_words(solved, settings, inputs, attribution=options.attribution)
    return Request(mission, solved, store, words, crs, gsd, over, segment, area, options)


def copy_as(source: Path, target: Path) -> None:
    """Give a file a second name: a hard link where the disk can, else a copy; replaced whole."""
    with file_in_place_of(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
