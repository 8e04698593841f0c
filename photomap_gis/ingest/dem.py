"""Heights of the ground from an elevation model (GeoTIFF and whatever GDAL reads), any CRS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio.errors import RasterioError
from rasterio.warp import transform as warp_points
from rasterio.windows import Window

from photomap_gis.core.errors import DataError

FloatArray = npt.NDArray[np.float64]
MAX_WINDOW_SIDE_PX = 8192


def check_dem(path: Path) -> None:
    """Raise ``DataError`` where a file is no georeferenced raster."""
    if not path.is_file():
        raise DataError(f"no such elevation model: {path}")
    try:
        with rasterio.open(path) as dataset:
            if dataset.crs is None:
                raise DataError(f"{path} does not say where it lies (no CRS): give a georeferenced elevation model")
    except (RasterioError, OSError) as error:
        raise DataError(f"cannot read the elevation model {path}: {str(error).splitlines()[0]}") from error


def read_heights(path: Path, lonlat_deg: FloatArray) -> FloatArray:
    """Return ``(N,)`` heights of the model at ``(N, 2)`` WGS84 longitudes and latitudes, in its own units of height.

    Linear between pixel centres; NaN where the model has no data. Raises ``DataError`` where it cannot be read, says
    not where it lies, or does not reach any of the places.
    """
    check_dem(path)
    try:
        with rasterio.open(path) as dataset:
            x, y = warp_points("EPSG:4326", dataset.crs, lonlat_deg[:, 0].tolist(), lonlat_deg[:, 1].tolist())
            column, row = (np.asarray(v) - 0.5 for v in ~dataset.transform * (np.array(x), np.array(y)))
            near = (column > -1.0) & (row > -1.0) & (column < dataset.width) & (row < dataset.height)
            if not near.any():
                raise DataError(f"{path} does not reach the flight: give the elevation model of the same place")
            first_column, first_row = (max(0, int(np.floor(v[near].min())) - 1) for v in (column, row))
            last_column = min(dataset.width, int(np.ceil(column[near].max())) + 2)
            last_row = min(dataset.height, int(np.ceil(row[near].max())) + 2)
            side = max(last_column - first_column, last_row - first_row)
            step = max(1.0, side / MAX_WINDOW_SIDE_PX)
            shape = tuple(max(1, round(n / step)) for n in (last_row - first_row, last_column - first_column))
            window = Window(first_column, first_row, last_column - first_column, last_row - first_row)
            band = dataset.read(1, window=window, out_shape=shape, masked=True).astype(np.float64)
    except (RasterioError, OSError) as error:
        raise DataError(f"cannot read the elevation model {path}: {str(error).splitlines()[0]}") from error
    heights = band.filled(np.nan)
    heights[~np.isfinite(heights)] = np.nan
    out = np.full(len(lonlat_deg), np.nan)
    u = (column[near] - first_column + 0.5) * shape[1] / window.width - 0.5
    v = (row[near] - first_row + 0.5) * shape[0] / window.height - 0.5
    out[near] = _bilinear(heights, u, v)
    return out


def _bilinear(heights: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return heights at columns and rows, those of the border half a pixel beyond it too."""
    u, v = np.clip(u, 0.0, heights.shape[1] - 1.0), np.clip(v, 0.0, heights.shape[0] - 1.0)
    i, j = np.floor(u).astype(np.intp), np.floor(v).astype(np.intp)
    i2, j2 = np.minimum(i + 1, heights.shape[1] - 1), np.minimum(j + 1, heights.shape[0] - 1)
    p, q = u - i, v - j
    corners = ((j, i, (1 - p) * (1 - q)), (j, i2, p * (1 - q)), (j2, i, (1 - p) * q), (j2, i2, p * q))
    # a corner without weight must not spread its lack of data
    return np.sum([np.where(w > 0.0, heights[r, c] * w, 0.0) for r, c, w in corners], axis=0)
