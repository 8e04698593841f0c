"""Publishing with GDAL as the writer: its failures are told like those of the disk."""

from __future__ import annotations

from functools import partial

from rasterio._err import CPLE_BaseError  # rasterio lets some of GDAL's own errors through
from rasterio.errors import RasterioError

from photomap_gis import publish

_FAILURES = (RasterioError, CPLE_BaseError)

file_in_place_of = partial(publish.file_in_place_of, failures=_FAILURES)
folder_in_place_of = partial(publish.folder_in_place_of, failures=_FAILURES)
output_errors = partial(publish.output_errors, failures=_FAILURES)
