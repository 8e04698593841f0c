"""Compare a written map with the true ground: how far it is off, absolutely and in itself, and what it leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from pyproj import CRS
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.vrt import WarpedVRT

from photomap_gis.core.errors import DataError
from photomap_gis.core.grid import MapGrid
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.matching import BoolArray, GreyImage, coarse_alignment, match_patches
from photomap_gis.simulate.noise import FloatImage
from photomap_gis.simulate.truth import Truth, read_truth

MARGIN_M = 20.0
RAISED_M = 0.6
RAISED_SHARE = 0.05
"""A patch of which more than this share stands more than ``RAISED_M`` above the land, or beside it, is not land."""
LEAN = 0.4
"""How far a wall is taken to lean over the land beside it, as a share of its height: a camera 22 degrees aside."""


@dataclass(frozen=True, slots=True)
class MapErrors:
    """What a map's comparison with the true ground found; metres on the ground, shares of 1.

    Patches are 64 pixels of the map wide, textured, truly seen, covered by the map, and on the land: roofs, crowns and
    rubble lean outward over the land beside them in any mosaic made without a surface model, so both are told apart
    (``raised_``).
    *Absolute* is the distance from the true place; *relative* what is left when the best similarity is removed.
    ``unmatched_share``: patches that correlate nowhere near. ``floor_rmse_m``: the absolute error that a perfect
    relative map would have, aligned to the flight's GPS, over the same patches.
    """

    gsd_m_per_px: float
    true_gsd_m_per_px: float
    patches: int
    unmatched_share: float
    absolute_rmse_m: float
    absolute_median_m: float
    relative_rmse_m: float
    relative_median_m: float
    relative_p95_m: float
    beyond_10_gsd_share: float
    coverage: float
    offset_east_m: float
    offset_north_m: float
    rotation_deg: float
    scale: float
    floor_rmse_m: float | None
    raised_patches: int
    raised_unmatched_share: float
    raised_relative_rmse_m: float

    @property
    def relative_rmse_gsd(self) -> float:
        """Relative RMSE in pixels of the true ground sampling distance."""
        return self.relative_rmse_m / self.true_gsd_m_per_px

    @property
    def ratio_to_floor(self) -> float | None:
        """Absolute RMSE over its floor."""
        return self.absolute_rmse_m / self.floor_rmse_m if self.floor_rmse_m else None

    def as_dict(self) -> Mapping[str, Any]:
        """Return all numbers by name, the derived ones too."""
        return asdict(self) | {"relative_rmse_gsd": self.relative_rmse_gsd, "ratio_to_floor": self.ratio_to_floor}


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Two pictures of one grid, and what is to be expected of each pixel: all that ``measure`` needs."""

    grid: MapGrid
    true: GreyImage
    seen: BoolArray
    raised: BoolArray
    mapped: GreyImage
    alpha: BoolArray


def evaluate_map(map_tif: Path | str, truth_dir: Path | str) -> MapErrors:
    """Compare a GeoTIFF in any projected or geographic CRS with the truth of a simulated flight."""
    truth = read_truth(truth_dir)
    return measure(compare(Path(map_tif), truth, truth.ground()), truth)


def measure(comparison: Comparison, truth: Truth | None = None, *, true_gsd_m_per_px: float | None = None) -> MapErrors:
    """Return the errors of a comparison; the floor needs the truth. NaN where no patch was found."""
    c, size = comparison, comparison.grid.pixel_size
    T = coarse_alignment(c.true, c.seen, c.mapped, c.alpha, pixel_size_m=size)
    matches = match_patches(c.true, c.seen, c.mapped, c.alpha, T)
    centres = np.round(matches.true_xy).astype(int)
    share = cv2.blur(c.raised.astype(np.float32), (64, 64))
    raised = share[centres[:, 1], centres[:, 0]] > RAISED_SHARE if len(centres) else np.zeros(0, bool)
    land, high = matches.found & ~raised, matches.found & raised
    best = _best_similarity(matches.map_xy[land], matches.true_xy[land], T)
    shift = matches.map_xy - matches.true_xy
    absolute = np.hypot(*shift.T) * size
    relative = np.hypot(*(matches.map_xy - best.apply(matches.true_xy)).T) * size
    true_gsd = true_gsd_m_per_px or (truth.gsd_m_per_px if truth is not None else size)
    offset = shift[land].mean(axis=0) * (size, -size) if land.any() else np.full(2, np.nan)
    points = c.grid.to_crs(matches.true_xy[land])
    return MapErrors(
        gsd_m_per_px=size,
        true_gsd_m_per_px=true_gsd,
        patches=int((~raised).sum()),
        unmatched_share=_share(~matches.found & ~raised, ~raised),
        absolute_rmse_m=_rms(absolute[land]),
        absolute_median_m=_median(absolute[land]),
        relative_rmse_m=_rms(relative[land]),
        relative_median_m=_median(relative[land]),
        relative_p95_m=float(np.percentile(relative[land], 95)) if land.any() else float("nan"),
        beyond_10_gsd_share=_share(relative[land] > 10.0 * true_gsd, np.ones(int(land.sum()), bool)),
        coverage=_coverage(c, best),
        offset_east_m=float(offset[0]),
        offset_north_m=float(offset[1]),
        rotation_deg=float(np.degrees(best.angle_rad)),
        scale=best.scale,
        floor_rmse_m=gps_floor(truth, points) if truth is not None and land.any() else None,
        raised_patches=int(raised.sum()),
        raised_unmatched_share=_share(~matches.found & raised, raised),
        raised_relative_rmse_m=_rms(relative[high]),
    )


def gps_floor(truth: Truth, points_en_m: npt.ArrayLike | None = None) -> float | None:
    """Return the absolute RMSE in metres that a perfect relative map would have when laid on this flight's fixes.

    The best similarity from true camera places to reported ones is applied to true ground points, ``(N, 2)`` easting,
    northing (the footprints' outlines by default). ``None`` where the flight has no fix.
    """
    frames = [f for f in truth.frames if f.fix is not None and f.breakage is None]
    if not frames:
        return None
    points = (
        np.concatenate([f.footprint_en_m for f in truth.frames])
        if points_en_m is None
        else np.atleast_2d(np.asarray(points_en_m, dtype=np.float64))
    )
    true = np.array([(f.pose.easting_m, f.pose.northing_m) for f in frames])
    fixes = GeoFrame(truth.crs_wkt).from_lon_lat([(f.fix.lon_deg, f.fix.lat_deg) for f in frames if f.fix])
    middle = true.mean(axis=0)  # about a near origin: UTM northings would cost six digits
    T = _best_similarity(fixes - middle, true - middle, None)
    return _rms(np.hypot(*(T.apply(points - middle) - (points - middle)).T))


def compare(map_tif: Path, truth: Truth, ground: Ground) -> Comparison:
    """Read a map and the true ground onto one grid of the map's pixel size, as far as the flight saw."""
    outlines = [f.footprint_en_m for f in truth.frames if f.breakage is None and len(f.footprint_en_m) >= 3]
    if not outlines:
        raise DataError("the simulated flight has no whole frame: there is nothing to compare a map with")
    corners = np.concatenate(outlines)
    west, south, east, north = ground.grid.bounds
    low = np.maximum(corners.min(axis=0) - MARGIN_M, (west - MARGIN_M, south - MARGIN_M))
    high = np.minimum(corners.max(axis=0) + MARGIN_M, (east + MARGIN_M, north + MARGIN_M))
    try:
        grid, mapped, alpha = _read_map(map_tif, truth.crs_wkt, low, high)
    except (RasterioError, OSError) as error:
        raise DataError(f"cannot read the map {map_tif}: {str(error).splitlines()[0]}") from error
    true, inside = _on_grid(cv2.cvtColor(ground.colour, cv2.COLOR_BGR2GRAY), ground, grid)
    seen = np.zeros(true.shape, np.uint8)
    for outline in outlines:
        cv2.fillPoly(seen, [np.round(grid.to_px(outline) * 16).astype(np.int32)], 1, shift=4)
    raised = np.zeros(true.shape, bool)
    if ground.height_m is not None:
        mask = (raised_mask(ground.height_m, ground.pixel_size_m) * np.uint8(255)).astype(np.uint8)
        raised = _on_grid(mask, ground, grid)[0] > 127
    return Comparison(grid, true, (seen > 0) & inside, raised, mapped, alpha)


def raised_mask(height_m: FloatImage, pixel_size_m: float) -> BoolArray:
    """``(H, W)`` what is not open land: what stands on it, and the strip beside it that it may lean over in a mosaic.

    The land's own surface is found by a wide opening of the heights.
    """
    h, w = height_m.shape
    factor = max(1.0, 0.5 / pixel_size_m)
    cell_m = pixel_size_m * factor
    small = cv2.resize(height_m, (max(2, round(w / factor)), max(2, round(h / factor))), interpolation=cv2.INTER_AREA)
    side = max(3, round(35.0 / cell_m) | 1)
    # odd reflection carries a slope on beyond the border, where the opening would otherwise cut its high end off
    pad = [(min(side, n - 1),) * 2 for n in small.shape]
    wide = np.pad(small, pad, mode="reflect", reflect_type="odd")
    opened = cv2.morphologyEx(wide, cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    land = cv2.GaussianBlur(opened, (0, 0), side / 4.0)
    above = (wide - land)[pad[0][0] : wide.shape[0] - pad[0][0], pad[1][0] : wide.shape[1] - pad[1][0]]
    mask = (above > RAISED_M).astype(np.uint8)
    for height in np.arange(1.0, min(float(above.max(initial=0.0)), 60.0), 1.0):
        reach = round(LEAN * height / cell_m)
        if reach > 0:
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
            mask |= cv2.dilate((above > height).astype(np.uint8), disc)
    return np.asarray(cv2.resize(mask, (w, h), interpolation=cv2.INTER_NEAREST) > 0)


def _read_map(
    path: Path, crs_wkt: str, low_en: FloatArray, high_en: FloatArray
) -> tuple[MapGrid, GreyImage, BoolArray]:
    """Read a map as grey and alpha; the grid keeps the map's own pixels where it has the truth's CRS."""
    with rasterio.open(path) as dataset:
        if dataset.crs is None:
            raise DataError(f"{path} has no CRS: a relative map cannot be compared with the true ground")
        same = CRS.from_wkt(dataset.crs.to_wkt()).equals(CRS.from_wkt(crs_wkt), ignore_axis_order=True)
        if same:
            size, anchor = float(dataset.transform.a), (dataset.transform.c, dataset.transform.f)
        else:
            with WarpedVRT(dataset, crs=crs_wkt) as guess:
                size, anchor = float(guess.transform.a), (guess.transform.c, guess.transform.f)
        c0, r0 = np.floor((low_en[0] - anchor[0]) / size), np.floor((anchor[1] - high_en[1]) / size)
        width, height = (int(np.ceil(v)) + 1 for v in (high_en - low_en) / size)
        if width * height > 400_000_000:
            raise DataError(f"the map {path} is too fine to compare: {width} x {height} pixels")
        grid = MapGrid(crs_wkt, anchor[0] + c0 * size, anchor[1] - r0 * size, size, width, height)
        alpha_band = dataset.count if dataset.count in (2, 4) else None
        bands = [1] if dataset.count < 3 else [1, 2, 3]
        with WarpedVRT(
            dataset, crs=crs_wkt, transform=rasterio.Affine(*grid.transform), width=width, height=height,
            resampling=Resampling.nearest if same else Resampling.cubic, add_alpha=alpha_band is None,
        ) as vrt:  # fmt: skip
            pixels = vrt.read(bands)
            alpha = vrt.read(alpha_band or vrt.count) > 0
    if pixels.dtype != np.uint8:
        raise DataError(f"{path} holds {pixels.dtype} pixels: write the map with 8 bits a band")
    if len(pixels) == 1:
        return grid, pixels[0], alpha
    return grid, cv2.cvtColor(np.ascontiguousarray(pixels.transpose(1, 2, 0)), cv2.COLOR_RGB2GRAY), alpha


def _on_grid(raster: GreyImage, ground: Ground, grid: MapGrid) -> tuple[GreyImage, BoolArray]:
    """Resample a raster of the ground onto a grid; and which pixels lie within it."""
    factor = grid.pixel_size / ground.pixel_size_m
    x0, y0 = ground.grid.to_px(grid.to_crs([[0.0, 0.0]]))[0]
    to_ground = np.array([[factor, 0.0, x0], [0.0, factor, y0]])
    soft = cv2.GaussianBlur(raster, (0, 0), 0.45 * np.sqrt(factor**2 - 1.0)) if factor > 1.2 else raster
    flags = (cv2.INTER_LINEAR if factor > 0.9 else cv2.INTER_CUBIC) | cv2.WARP_INVERSE_MAP
    size = (grid.width, grid.height)
    out = cv2.warpAffine(soft, to_ground, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    x, y = x0 + factor * np.arange(grid.width), y0 + factor * np.arange(grid.height)
    inside = ((y >= 0) & (y <= raster.shape[0] - 1))[:, None] & ((x >= 0) & (x <= raster.shape[1] - 1))[None, :]
    return np.asarray(out), inside


def _coverage(c: Comparison, T_map_true: Similarity2D) -> float:
    """Share of the truly seen ground that the map shows, wherever it shows it."""
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    size = c.true.shape[::-1]
    covered = cv2.warpAffine(c.alpha.astype(np.uint8), T_map_true.matrix[:2], size, flags=flags) > 0
    return _share(covered & c.seen, c.seen)


def _best_similarity(a: FloatArray, b: FloatArray, otherwise: Similarity2D | None) -> Similarity2D:
    """Return the least-squares ``T_a_b``; a mere shift where it is not determined."""
    try:
        return fit_similarity(a, b)
    except ValueError:
        if len(a):
            return Similarity2D.translation_of(*(a - b).mean(axis=0))
        return otherwise or Similarity2D.identity()


def _rms(values: npt.NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _median(values: npt.NDArray[np.floating]) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _share(part: BoolArray, whole: BoolArray) -> float:
    return float(part.sum() / whole.sum()) if whole.any() else float("nan")
