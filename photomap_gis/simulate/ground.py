"""The ground that a simulated flight looks at: a picture with a place, a pixel size, and perhaps heights."""

from __future__ import annotations

import logging
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rasterio
from pyproj import CRS
from rasterio.enums import Resampling
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.warp import reproject
from rasterio.warp import transform as warp_points
from rasterio.windows import Window as RasterWindow

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.grid import MapGrid
from photomap_gis.simulate.geodesy import DEFAULT_ORIGIN_LAT_LON, GeoFrame, utm_wkt

logger = logging.getLogger(__name__)

FloatImage = npt.NDArray[np.float32]

PICTURE_PIXEL_SIZE_M = 0.1
"""What a pixel of a picture without a georeference is taken to measure."""

MAX_SIDE_PX = 12000
"""Larger grounds are cut to their middle: a simulated flight needs no more, and memory does not grow with them."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A north-up orthophoto with optional heights.

    ``colour`` is ``(H, W, 3)`` BGR uint8; ``height_m`` is ``(H, W)`` float32 above any level, ``None`` where the ground
    is flat; ``west``, ``north`` are the outer corner of the first pixel in ``crs_wkt`` (projected, metres).
    """

    colour: ImageArray
    height_m: FloatImage | None
    pixel_size_m: float
    west: float
    north: float
    crs_wkt: str

    def __post_init__(self) -> None:
        if self.colour.dtype != np.uint8 or self.colour.ndim != 3 or self.colour.shape[2] != 3:
            raise ValueError(f"colour must be (H, W, 3) uint8, got {self.colour.shape} {self.colour.dtype}")
        if self.height_m is not None and self.height_m.shape != self.colour.shape[:2]:
            raise ValueError(f"height_m must be {self.colour.shape[:2]}, got {self.height_m.shape}")
        if not self.pixel_size_m > 0:
            raise ValueError(f"pixel_size_m must be positive, got {self.pixel_size_m}")

    @property
    def grid(self) -> MapGrid:
        """The raster's place."""
        h, w = self.colour.shape[:2]
        return MapGrid(self.crs_wkt, self.west, self.north, self.pixel_size_m, w, h)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (east) and height (north) in metres."""
        h, w = self.colour.shape[:2]
        return w * self.pixel_size_m, h * self.pixel_size_m

    @property
    def centre_en_m(self) -> tuple[float, float]:
        """Easting and northing of the middle."""
        w, h = self.size_m
        return self.west + w / 2.0, self.north - h / 2.0

    def heights_at(self, en_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """``(N,)`` heights in metres under ``(N, 2)`` eastings, northings (bilinear, clamped at the border)."""
        p = self.grid.to_px(np.atleast_2d(np.asarray(en_m, dtype=np.float64)))
        if self.height_m is None:
            return np.zeros(len(p))
        xy = np.clip(p, 0, np.array(self.height_m.shape[::-1]) - 1.0)
        x0 = np.minimum(xy.astype(int), np.maximum(np.array(self.height_m.shape[::-1]) - 2, 0))
        f = xy - x0
        x1 = np.minimum(x0 + 1, np.array(self.height_m.shape[::-1]) - 1)
        h = self.height_m
        top = h[x0[:, 1], x0[:, 0]] * (1 - f[:, 0]) + h[x0[:, 1], x1[:, 0]] * f[:, 0]
        bottom = h[x1[:, 1], x0[:, 0]] * (1 - f[:, 0]) + h[x1[:, 1], x1[:, 0]] * f[:, 0]
        return np.asarray(top * (1 - f[:, 1]) + bottom * f[:, 1], dtype=np.float64)


def placed_ground(
    colour: ImageArray,
    height_m: FloatImage | None,
    *,
    pixel_size_m: float,
    origin_lat_lon: tuple[float, float] = DEFAULT_ORIGIN_LAT_LON,
) -> Ground:
    """Return a ground whose middle lies at a place on Earth, in that place's UTM zone, its corner on a whole metre."""
    wkt = utm_wkt(*origin_lat_lon)
    easting, northing = GeoFrame(wkt).from_lon_lat([origin_lat_lon[::-1]])[0]
    h, w = colour.shape[:2]
    west, north = round(easting - w * pixel_size_m / 2.0), round(northing + h * pixel_size_m / 2.0)
    return Ground(colour, height_m, pixel_size_m, float(west), float(north), wkt)


def load_ground(
    path: Path | str,
    *,
    pixel_size_m: float | None = None,
    origin_lat_lon: tuple[float, float] = DEFAULT_ORIGIN_LAT_LON,
    height_path: Path | str | None = None,
    max_side_px: int = MAX_SIDE_PX,
) -> Ground:
    """Return the ground of a GeoTIFF (its own place is kept) or of any picture (laid at ``origin_lat_lon``).

    ``pixel_size_m`` says what a picture's pixel measures, and resamples a raster that has a place. Rasters in degrees,
    feet, or turned are warped to their UTM zone. ``height_path`` is a height raster in metres: georeferenced, or of the
    picture's own outline. ``DataError`` where a file cannot be read.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"no such ground: {path} (give a picture, a GeoTIFF, or the word 'procedural')")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path) as dataset:
                if dataset.crs is not None and not dataset.transform.is_identity:
                    ground = _read_placed(dataset, pixel_size_m, max_side_px)
                else:
                    window = _middle(dataset.width, dataset.height, max_side_px)
                    colour = _read_colour(dataset, window)
                    ground = placed_ground(
                        colour,
                        None,
                        pixel_size_m=pixel_size_m or PICTURE_PIXEL_SIZE_M,
                        origin_lat_lon=origin_lat_lon,
                    )
            if height_path is None:
                return ground
            return _with_heights(ground, Path(height_path))
    except (RasterioError, OSError) as error:
        raise DataError(f"cannot read the ground {path}: {str(error).splitlines()[0]}") from error


def write_ground(ground: Ground, colour_path: Path, height_path: Path) -> None:
    """Write the colours as RGB GeoTIFF and, where there are any, the heights as float32 GeoTIFF."""
    h, w = ground.colour.shape[:2]
    profile: dict[str, Any] = dict(
        driver="GTiff", width=w, height=h, crs=ground.crs_wkt, transform=rasterio.Affine(*ground.grid.transform),
        tiled=True, blockxsize=512, blockysize=512, compress="deflate", zlevel=1, bigtiff="if_safer",
    )  # fmt: skip
    try:
        with rasterio.open(colour_path, "w", count=3, dtype="uint8", predictor=2, photometric="rgb", **profile) as out:
            out.write(np.ascontiguousarray(ground.colour[..., ::-1].transpose(2, 0, 1)))
        if ground.height_m is not None:
            with rasterio.open(height_path, "w", count=1, dtype="float32", predictor=3, **profile) as out:
                # a millimetre is finer than any use, and compresses threefold
                out.write(np.round(ground.height_m, 3), 1)
    except (RasterioError, OSError) as error:
        raise OutputError(f"cannot write the true ground to {colour_path.parent}: {error}") from error


def read_ground(colour_path: Path, height_path: Path | None = None) -> Ground:
    """Read back what ``write_ground`` wrote."""
    try:
        with rasterio.open(colour_path) as dataset:
            colour = np.ascontiguousarray(dataset.read([1, 2, 3]).transpose(1, 2, 0)[..., ::-1])
            transform, wkt = dataset.transform, dataset.crs.to_wkt()
        height = None
        if height_path is not None and height_path.is_file():
            with rasterio.open(height_path) as dataset:
                height = dataset.read(1)
    except (RasterioError, OSError) as error:
        raise DataError(f"cannot read the true ground {colour_path}: {error}") from error
    return Ground(colour, height, float(transform.a), float(transform.c), float(transform.f), wkt)


def _middle(width: int, height: int, max_side_px: int) -> RasterWindow:
    """Return the window in the middle of a raster that is not longer than allowed on either side."""
    w, h = min(width, max_side_px), min(height, max_side_px)
    if (w, h) != (width, height):
        logger.warning("the ground is large: only its middle (%d x %d of %d x %d pixels) is used", w, h, width, height)
    return RasterWindow((width - w) // 2, (height - h) // 2, w, h)


def _read_placed(dataset: Any, pixel_size_m: float | None, max_side_px: int) -> Ground:
    """Read a georeferenced raster, warped where its grid is not north-up, square and in metres."""
    crs = CRS.from_wkt(dataset.crs.to_wkt())
    t = dataset.transform
    metric = crs.is_projected and all(a.unit_conversion_factor == 1.0 for a in crs.axis_info)
    square = t.b == 0 and t.d == 0 and t.a > 0 and t.e < 0 and math.isclose(t.a, -t.e, rel_tol=1e-6)
    if metric and square and (pixel_size_m is None or math.isclose(pixel_size_m, t.a, rel_tol=1e-6)):
        window = _middle(dataset.width, dataset.height, max_side_px)
        west, north = _corner(window, t)
        return Ground(_read_colour(dataset, window), None, float(t.a), west, north, dataset.crs.to_wkt())
    wkt = dataset.crs.to_wkt() if metric else _utm_of(dataset)
    with WarpedVRT(dataset, crs=wkt) as guess:
        size = pixel_size_m or math.sqrt(abs(guess.transform.a * guess.transform.e))
        left, bottom, right, top = guess.bounds
    transform = rasterio.Affine(size, 0.0, left, 0.0, -size, top)
    width, height = max(1, int((right - left) / size)), max(1, int((top - bottom) / size))
    with WarpedVRT(
        dataset, crs=wkt, transform=transform, width=width, height=height, resampling=Resampling.bilinear
    ) as vrt:
        window = _middle(width, height, max_side_px)
        west, north = _corner(window, transform)
        return Ground(_read_colour(vrt, window), None, size, west, north, CRS.from_user_input(wkt).to_wkt())


def _corner(window: RasterWindow, transform: rasterio.Affine) -> tuple[float, float]:
    """Return the outer corner of a window's first pixel in a north-up raster."""
    return transform.c + window.col_off * transform.a, transform.f + window.row_off * transform.e


def _utm_of(dataset: Any) -> str:
    """Return the UTM zone of a raster's middle."""
    left, bottom, right, top = dataset.bounds
    lon, lat = warp_points(dataset.crs, "EPSG:4326", [(left + right) / 2.0], [(bottom + top) / 2.0])
    return utm_wkt(lat[0], lon[0])


def _read_colour(dataset: Any, window: RasterWindow) -> ImageArray:
    """``(H, W, 3)`` BGR uint8 of any raster: palettes are looked up, grey is tripled, deep values are stretched."""
    if dataset.count < 3:
        band = dataset.read(1, window=window)
        try:
            table = np.zeros((256, 3), np.uint8)
            for value, rgba in dataset.colormap(1).items():
                table[value & 255] = rgba[2::-1]
            return np.asarray(table[band.astype(np.uint8)])
        except ValueError:  # no palette
            bands = np.repeat(band[None], 3, axis=0)
    else:
        bands = dataset.read([3, 2, 1], window=window)
    if bands.dtype != np.uint8:
        finite = bands[np.isfinite(bands)] if bands.dtype.kind == "f" else bands
        low, high = np.percentile(finite[:: max(1, finite.size // 1_000_000)], (1, 99)) if finite.size else (0.0, 1.0)
        scaled = (np.nan_to_num(bands.astype(np.float32)) - low) * (255.0 / max(float(high - low), 1e-9))
        bands = np.clip(scaled, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(bands.transpose(1, 2, 0))


def _with_heights(ground: Ground, path: Path) -> Ground:
    """Return the ground with heights from a raster: by its place, or stretched over the ground where it has none."""
    if not path.is_file():
        raise DataError(f"no such height raster: {path}")
    shape = ground.colour.shape[:2]
    with rasterio.open(path) as dataset:
        if dataset.crs is not None and not dataset.transform.is_identity:
            heights = np.full(shape, np.nan, np.float32)
            reproject(
                rasterio.band(dataset, 1), heights, dst_transform=rasterio.Affine(*ground.grid.transform),
                dst_crs=ground.crs_wkt, dst_nodata=np.nan, resampling=Resampling.bilinear,
            )  # fmt: skip
        else:
            band = dataset.read(1, masked=True).astype(np.float32).filled(np.nan)
            heights = cv2.resize(band, shape[::-1], interpolation=cv2.INTER_LINEAR)
    known = np.isfinite(heights)
    if not known.any():
        raise DataError(f"the height raster {path} does not overlap the ground")
    heights = np.where(known, heights, np.float32(np.median(heights[known])))
    return Ground(ground.colour, heights, ground.pixel_size_m, ground.west, ground.north, ground.crs_wkt)
