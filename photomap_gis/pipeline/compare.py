"""A change map: old imagery and a new map brought on one grid, laid on each other, and scored."""

from __future__ import annotations

import contextlib
import json
import math
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.windows import Window as RasterWindow
from shapely.geometry import MultiPolygon, mapping
from shapely.geometry.polygon import orient

from photomap_gis import __version__
from photomap_gis.compare import (
    NODATA,
    ChangedArea,
    ColourPatch,
    Imagery,
    LaidPair,
    Pair,
    ShiftField,
    change_picture,
    coarser,
    field_on,
    fine_field,
    look_at_pair,
    outlines,
    sample_windows,
    score_window,
    score_windows,
    scored,
)
from photomap_gis.core.errors import DataError, NotGeoreferencedError, OutputError, UsageError
from photomap_gis.core.frame import GpsFix
from photomap_gis.core.grid import MapFrame, MapGrid, Window
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.export.crs import crs_label
from photomap_gis.export.draft import draft_dataset
from photomap_gis.export.footprint import to_wgs84, write_geojson
from photomap_gis.export.geotiff import SIDE_SUFFIXES, bounded_cache, check_cog, draft_to_cog
from photomap_gis.export.vectors import VectorLayer, write_empty_layer, write_vectors
from photomap_gis.georef import choose_map_frame
from photomap_gis.parallel import map_jobs
from photomap_gis.pipeline.compare_values import CompareOutputs, CompareSettings, CompareSummary, LaidOn
from photomap_gis.pipeline.reference import register_patches
from photomap_gis.pipeline.settings import Progress
from photomap_gis.publish import file_in_place_of, output_errors, write_file
from photomap_gis.reference import Expected, Patch
from photomap_gis.reference.agree import agreeing
from photomap_gis.reference.pictures import Look, seen_as
from photomap_gis.store import Mission

LEAST_PX = 48
"""A common ground smaller than this shows nothing."""
MOST_PX = 4 * 10**9
PLACE_PX, PLACE_M = 320, 60.0
LARGEST_PLACE_PX = 480
PLACES_A_SIDE = 4
LEAST_SEEN = 0.3
OFFSET_SIGMA_M = 5.0
"""How far two maps of one place lie apart, one sigma an axis: what GPS leaves."""
DRIFT_M = 1.5
"""How far the drift between them may be off one motion of the whole."""
WEAK = 0.3
PICTURE_PX = 900
SMALLEST_AREA_M2 = 1.0
SMALLEST_AREA_PX = 40.0
"""By default polygons smaller than both of these are left out: they are noise."""


def compare_maps(
    old: Path,
    new: Path,
    outputs: CompareOutputs,
    settings: CompareSettings | None = None,
    *,
    on_progress: Progress = lambda stage, done, total: None,
) -> CompareSummary:
    """Compare old imagery with a new map (GeoTIFFs or mission folders) and write what changed; return the summary.

    Memory does not grow with the files. Raises ``DataError`` where they do not overlap or cannot be read.
    """
    settings = settings or CompareSettings()
    old_path, new_path = imagery_of(old), imagery_of(new)
    for path in (outputs.raster, outputs.polygons, outputs.picture):
        if not path.absolute().parent.is_dir():
            raise OutputError(f"{path} cannot be written: the folder {path.parent} does not exist; create it")
        if path.exists() and any(path.samefile(p) for p in (old_path, new_path)):
            raise UsageError(f"{path} is an input of the comparison: name another file by -o")
    with Imagery(old_path) as before, Imagery(new_path) as after, bounded_cache(), _single_threaded_opencv():
        grid, warnings = common_grid(before, after, settings)
        laid, told = _laid(before, after, grid, settings, on_progress)
        pair = _look(laid, has_colour=not (before.is_grey or after.is_grey))
        if not told.sure:
            warnings.append(
                "old and new could not be laid on each other: no motion between them was agreed on, their own "
                "georeference is taken; scores may be those of misplaced imagery"
            )
        if before.is_grey or after.is_grey:
            warnings.append("one of the two is grey: colours tell nothing, changes of colour alone are not found")
        default_m2 = max(SMALLEST_AREA_M2, SMALLEST_AREA_PX * grid.pixel_size**2)
        least_m2 = default_m2 if settings.min_area_m2 is None else settings.min_area_m2
        with _drafts(outputs.raster) as (score_path, mask_path):
            compared_px = _score(laid, pair, settings, score_path, mask_path, on_progress)
            if not compared_px:
                raise DataError(f"{old} and {new} show no common ground: nothing to compare")
            areas = _areas(grid, score_path, mask_path, least_m2)
            tags = {
                "TIFFTAG_SOFTWARE": f"photomap {__version__}",
                "TIFFTAG_IMAGEDESCRIPTION": f"Change between {old_path.name} and {new_path.name}: score 0 to 1, the "
                "probability that a pixel has changed",
                "REGISTERED": "yes" if told.sure else "no",
                "THRESHOLD": f"{settings.threshold:g}",
            }
            picture = _picture(laid, score_path, areas)
            _write_raster(score_path, outputs.raster, tags)
        write_areas(areas, grid, outputs.polygons, source=outputs.raster.name)
        write_file(outputs.picture, picture)
    on_progress("write", 1, 1)
    return CompareSummary(
        str(old), str(new), crs_label(grid.crs_wkt), grid.pixel_size, grid.bounds,
        compared_px * grid.pixel_size**2, sum(a.area_m2 for a in areas), len(areas), settings.threshold, least_m2, told,
        tuple(str(p) for p in (outputs.raster, outputs.polygons, outputs.picture)), tuple(warnings),
    )  # fmt: skip


def imagery_of(path: Path) -> Path:
    """Return the raster of a GeoTIFF's or a mission's path; ``DataError`` with the way out where there is none."""
    if not path.is_dir():
        return path
    with Mission.open(path) as mission:
        if mission.header.map_frame.crs_wkt is None:
            raise NotGeoreferencedError(
                f"{path} has no place on Earth: give it one by 'photomap georeference {path} --pick ...' first"
            )
    raster = path / "map.tif"
    if not raster.is_file():
        raise DataError(f"{path} holds no map.tif: write it by 'photomap export {path} --geotiff'")
    return raster


def common_grid(before: Imagery, after: Imagery, settings: CompareSettings) -> tuple[MapGrid, list[str]]:
    """Return the grid of the ground that both outlines cover, and what a user should know of it."""
    warnings: list[str] = []
    middle = [GpsFix(*after.middle_lat_lon())]
    if settings.crs is not None:
        frame = choose_map_frame(middle, settings.crs)
    else:
        try:
            frame = choose_map_frame(middle, after.crs_wkt)
        except UsageError:  # a CRS of its own that is made for elsewhere: the work is done in UTM
            frame = choose_map_frame(middle)
    wkt = str(frame.crs_wkt)
    gsds = before.gsd_m_per_px(wkt), after.gsd_m_per_px(wkt)
    pixel = settings.gsd_m_per_px or max(gsds)
    if pixel < 0.9 * max(gsds):
        warnings.append(f"--gsd {pixel:g} is finer than the coarser imagery ({max(gsds):.3g} m): it adds no detail")
    boxes = [i.bounds(wkt) for i in (before, after)]
    west, south = (max(b[k] for b in boxes) for k in (0, 1))
    east, north = (min(b[k] for b in boxes) for k in (2, 3))
    if not (east > west and north > south):
        raise DataError(
            f"{before.path} and {after.path} do not overlap: they lie {_apart_m(*boxes):.0f} m apart; "
            "compare imagery of one place"
        )
    if (east - west) * (north - south) / pixel**2 > MOST_PX:
        raise UsageError(f"the comparison would have more than {MOST_PX:.0e} pixels: choose a coarser --gsd")
    corners = np.array([(west, south), (east, north)])
    grid = MapGrid.covering(corners, MapFrame(wkt), pixel_size=pixel)
    if min(grid.width, grid.height) < LEAST_PX:
        raise DataError(
            f"the two share {grid.width} x {grid.height} pixels of {pixel:.3g} m only, at least {LEAST_PX} are needed: "
            "compare finer imagery or a larger area"
        )
    return grid, warnings


def _apart_m(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return math.hypot(*(max(a[k] - b[k + 2], b[k] - a[k + 2], 0.0) for k in (0, 1)))


def _laid(
    before: Imagery, after: Imagery, grid: MapGrid, settings: CompareSettings, on_progress: Progress
) -> tuple[LaidPair, LaidOn]:
    """Return the two laid on each other: one motion of the whole by places, then local shifts from coarse to fine."""
    T, tried, agreed = _motion(before, after, grid, partial(on_progress, "lay"))
    laid = LaidPair(before, after, grid, ShiftField.none(grid, T or Similarity2D()))
    levels = [f for f in (16, 8, 4, 2) if f * grid.pixel_size * 5.0 <= DRIFT_M * 2.0]
    for factor in levels:
        rough = coarser(grid, factor)
        if min(rough.width, rough.height) < 3 * LEAST_PX:
            continue
        there = LaidPair(before, after, rough, field_on(laid.field, grid, rough))
        found = fine_field(there, rounds=(1.6, 1.2), workers=settings.workers)
        laid = LaidPair(before, after, grid, field_on(found, rough, grid))
    found = fine_field(laid, workers=settings.workers, on_progress=partial(on_progress, "fit"))
    laid = LaidPair(before, after, grid, found)
    middle = Window(grid.width // 2, grid.height // 2, 1, 1)
    x, y = (float(v[0, 0]) for v in found.at(middle))
    residual = found.sigma_px if math.isfinite(found.sigma_px) else None
    return laid, LaidOn(
        T is not None or (found.share > 0.3 and residual is not None and residual < 0.5), tried, agreed,
        (x - middle.col_off) * grid.pixel_size, -(y - middle.row_off) * grid.pixel_size, residual, found.share,
    )  # fmt: skip


def _motion(
    before: Imagery, after: Imagery, grid: MapGrid, on_done: Callable[[int, int], None]
) -> tuple[Similarity2D | None, int, int]:
    """Return the motion of the grid's pixels that places of it agree on, how many were tried and how many agreed."""
    side_m = max(PLACE_PX * grid.pixel_size, PLACE_M)
    size_m = [min(side_m, n * grid.pixel_size) for n in (grid.width, grid.height)]
    pixel = max(grid.pixel_size, max(size_m) / LARGEST_PLACE_PX)
    width, height = (max(LEAST_PX, round(s / pixel)) for s in size_m)
    whole = grid.width * grid.pixel_size, grid.height * grid.pixel_size
    counts = [max(1, min(PLACES_A_SIDE, round(w / s))) for w, s in zip(whole, size_m, strict=True)]
    predicted, measured, tolerance, weight = [], [], [], []
    points: list[tuple[FloatArray, FloatArray]] = []
    tried, total = 0, counts[0] * counts[1]
    for number in range(total):
        c, r = number % counts[0], number // counts[0]
        west = grid.west + (whole[0] - size_m[0]) * (c / max(1, counts[0] - 1))
        north = grid.north - (whole[1] - size_m[1]) * (r / max(1, counts[1] - 1))
        place = MapGrid(grid.crs_wkt, west, north, pixel, width, height)
        on_done(number + 1, total)
        old, new = (_patch(i.read(place)) for i in (before, after))
        if float((old.mask & new.mask).mean()) < LEAST_SEEN:
            continue
        tried += 1
        expected = Expected(max(OFFSET_SIGMA_M / pixel, 3.0), 0.015, 0.015)
        best = None
        for look in Look:
            found = register_patches(seen_as(old, look), seen_as(new, look), expected)
            if best is None or found.probability > best.probability:
                best = found
            if best.accepted:
                break
        if best is None or best.probability < WEAK:
            continue
        xy = np.array([(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)]) * (width, height)
        there, here = (grid.to_px(place.to_crs(p)) for p in (best.T_a_b.apply(xy), xy))
        points.append((there, here))
        predicted.append(here.mean(axis=0))
        measured.append(there.mean(axis=0))
        tolerance.append(3.0 * pixel / grid.pixel_size + DRIFT_M / grid.pixel_size)
        weight.append(float(best.probability))
    if not points:
        return None, tried, 0
    kept = agreeing(np.array(predicted), np.array(measured), tolerance, weight)
    if not kept.any():
        return None, tried, 0
    there, here = (np.concatenate([p[k] for p, good in zip(points, kept, strict=True) if good]) for k in (0, 1))
    if kept.sum() >= 3:
        return fit_similarity(there, here), tried, int(kept.sum())
    return Similarity2D.translation_of(*np.median(there - here, axis=0)), tried, int(kept.sum())


def _patch(colours: ColourPatch) -> Patch:
    grey = colours.rgb @ np.array([0.299, 0.587, 0.114], np.float32)
    picture = cv2.add(grey * np.float32(255.0), 0.0, dtype=cv2.CV_8U)
    return Patch(np.asarray(picture, np.uint8), colours.mask)


def _look(laid: LaidPair, *, has_colour: bool) -> Pair:
    samples = [laid.read(w) for w in sample_windows(laid.grid)]
    try:
        return look_at_pair(samples, has_colour=has_colour)
    except ValueError:
        raise DataError("the two show no common ground where their outlines overlap: nothing to compare") from None


@contextlib.contextmanager
def _drafts(beside: Path) -> Iterator[tuple[Path, Path]]:
    """Yield names for the drafts of score and mask; they vanish at the end."""
    with (
        output_errors(beside),
        tempfile.TemporaryDirectory(prefix=".photomap-", dir=beside.absolute().parent) as scratch,
    ):
        yield Path(scratch) / "score.tif", Path(scratch) / "mask.tif"


def _score(
    laid: LaidPair, pair: Pair, settings: CompareSettings, score_path: Path, mask_path: Path, on_progress: Progress
) -> int:
    """Write the drafts of score and of what counts as changed; return how many pixels were compared."""
    grid = laid.grid
    common = {"width": grid.width, "height": grid.height, "count": 1, "crs": grid.crs_wkt,
              "transform": rasterio.Affine(*grid.transform)}  # fmt: skip
    windows = score_windows(grid)
    compared = 0
    with (
        draft_dataset(score_path, {**common, "dtype": "float32", "nodata": NODATA}) as scores,
        draft_dataset(mask_path, {**common, "dtype": "uint8"}) as mask,
    ):
        results = map_jobs(partial(score_window, laid, pair), windows, workers=settings.workers)
        for done, (window, score) in enumerate(zip(windows, results, strict=True), start=1):
            scores.write(score, window)
            mask.write((score >= settings.threshold).astype(np.uint8), window)
            compared += int((score >= 0.0).sum())
            on_progress("score", done, len(windows))
    return compared


def _areas(grid: MapGrid, score_path: Path, mask_path: Path, least_m2: float) -> list[ChangedArea]:
    """Return the changed areas, the largest first."""
    with rasterio.open(score_path) as scores, rasterio.open(mask_path) as mask:

        def read(window: Window) -> npt.NDArray[np.float32]:
            return np.asarray(scores.read(1, window=RasterWindow(*window)), np.float32)

        found = [
            scored(outline, grid, read) for outline in outlines(rasterio.band(mask, 1), grid, min_area_m2=least_m2)
        ]
    return sorted((a for a in found if a.area_m2 >= least_m2), key=lambda a: -a.area_m2)


def _write_raster(draft: Path, path: Path, tags: dict[str, str]) -> None:
    with rasterio.open(draft, "r+") as dataset:
        dataset.update_tags(**tags)
    with file_in_place_of(path, lambda p: check_cog(p, path), side_suffixes=SIDE_SUFFIXES) as temporary:
        draft_to_cog(draft, temporary, compression="DEFLATE")


def _picture(laid: LaidPair, score_path: Path, areas: list[ChangedArea]) -> bytes:
    grid = laid.grid
    factor = max(1, -(-max(grid.width, grid.height) // PICTURE_PX))
    small = coarser(grid, factor)
    there = LaidPair(laid.old, laid.new, small, field_on(laid.field, grid, small))
    old, new, both = there.read(Window(0, 0, small.width, small.height))
    with rasterio.open(score_path) as scores:
        score = scores.read(
            1, out_shape=(small.height, small.width), 
            window=RasterWindow(0, 0, small.width * factor, small.height * factor), boundless=True, fill_value=NODATA,
        )  # fmt: skip
    seen = laid.new.read(small).mask
    return change_picture(ColourPatch(old, both), ColourPatch(new, seen), score, small, areas)


def write_areas(areas: list[ChangedArea], grid: MapGrid, path: Path, *, source: str) -> None:
    """Write changed areas as GeoJSON (longitude and latitude) or as a GeoPackage (the grid's CRS), by the suffix."""
    rows = [
        {
            "id": n, "score": round(a.score, 3), "score_max": round(a.score_max, 3), "area_m2": round(a.area_m2, 2),
            "raster": source,
        }
        for n, a in enumerate(areas, start=1)
    ]  # fmt: skip
    if path.suffix.lower() == ".gpkg":
        if not areas:
            kinds = {"id": int, "score": float, "score_max": float, "area_m2": float, "raster": str}
            write_empty_layer(path, "change", geometry_type="Polygon", fields=kinds, crs_wkt=grid.crs_wkt)
            return
        layer = VectorLayer("change", tuple(a.outline for a in areas), tuple(rows))
        write_vectors([layer], path, crs_wkt=grid.crs_wkt)
        return
    features = []
    for area, row in zip(areas, rows, strict=True):
        degrees = to_wgs84(MultiPolygon([area.outline]), grid.crs_wkt)
        parts = [orient(p, 1.0) for p in degrees.geoms]
        geometry = mapping(parts[0] if len(parts) == 1 else MultiPolygon(parts))
        features.append({"type": "Feature", "id": row["id"], "properties": row, "geometry": geometry})
    write_geojson(json.loads(json.dumps({"type": "FeatureCollection", "features": features})), path)


@contextlib.contextmanager
def _single_threaded_opencv() -> Iterator[None]:
    """Keep OpenCV from starting threads of its own under ours."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
