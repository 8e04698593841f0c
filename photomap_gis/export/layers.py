"""A map's layers as cloud-optimised GeoTIFFs on the map's exact grid: a file a layer, its units in its tags.

Where the map is written in another CRS, layers follow by the nearest pixel: a frame's number or a time must not be
mixed with its neighbour's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rasterio
import rasterio.shutil

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.layer import LAYERS, Layer, LayerSource, empty
from photomap_gis.export.crs import needs_place, point_map, same_crs
from photomap_gis.export.draft import BLOCK_PX, draft_dataset, strips
from photomap_gis.export.geotiff import (
    LOCAL_CRS_WKT,
    NOT_GEOREFERENCED,
    check_cog,
)
from photomap_gis.export.publish import file_in_place_of, folder_in_place_of
from photomap_gis.export.warp import lattice
from photomap_gis.parallel import give_back_memory

OnProgress = Callable[[int, int], None]

_CACHE_BYTES = 32 << 20  # blocks are written once and read once, in the same order


def write_layers(
    source: LayerSource,
    folder: Path | str,
    *,
    grid: MapGrid | None = None,
    metadata: Mapping[str, str] | None = None,
    on_progress: OnProgress | None = None,
) -> list[Path]:
    """Write every layer as ``<layer>.tif`` into a folder, all of them or none, and return the files.

    ``grid`` is that of the written map, by default the layers' own. A folder that holds anything else than layers is
    not touched.
    """
    folder = Path(folder).absolute()
    if grid is not None and grid != source.grid:
        source = NearestLayers(source, grid)
    windows = len(list(strips(source.grid.width, source.grid.height)))
    names = {_file_name(layer) for layer in LAYERS}

    def ours(existing: Path) -> bool:
        return all(path.name in names or path.name.removesuffix(".aux.xml") in names for path in existing.iterdir())

    with folder_in_place_of(folder, ours=ours) as fresh:
        for k, layer in enumerate(LAYERS):

            def told(done: int, k: int = k) -> None:
                if on_progress is not None:
                    on_progress(k * windows + done, len(LAYERS) * windows)

            write_layer(source, layer, fresh / _file_name(layer), metadata=metadata, on_window=told)
    return [folder / _file_name(layer) for layer in LAYERS]


def write_layer(
    source: LayerSource,
    layer: Layer,
    path: Path,
    *,
    metadata: Mapping[str, str] | None = None,
    on_window: Callable[[int], None] = lambda done: None,
) -> None:
    """Write one layer as a COG, lossless; bands carry names and units."""
    spec, grid = LAYERS[layer], source.grid
    tags = {"AREA_OR_POINT": "Area", **(metadata or {}), "LAYER": str(layer)}
    tags |= {f"UNIT_{band.name.upper()}": band.unit for band in spec.bands}
    tags |= {f"MEANING_{band.name.upper()}": band.words for band in spec.bands}
    if grid.crs_wkt is None:
        tags["GEOREFERENCE"] = NOT_GEOREFERENCED
    profile = {
        "width": grid.width, "height": grid.height, "count": len(spec.bands), "dtype": spec.dtype,
        "nodata": spec.nodata, "crs": grid.crs_wkt or LOCAL_CRS_WKT, "transform": rasterio.Affine(*grid.transform),
    }  # fmt: skip
    with (
        file_in_place_of(path, lambda p: check_cog(p, path)) as temporary,
        rasterio.Env(GDAL_CACHEMAX=_CACHE_BYTES),
    ):
        draft = temporary.with_name("draft.tif")
        with draft_dataset(draft, profile) as out:
            out.dataset.update_tags(**tags)
            for number, band in enumerate(spec.bands, start=1):
                out.dataset.set_band_description(number, band.name)
                out.dataset.set_band_unit(number, band.unit)
            for done, window in enumerate(strips(grid.width, grid.height), start=1):
                out.write(source.read(layer, window), window)
                on_window(done)
        options = {
            "BLOCKSIZE": str(BLOCK_PX), "COMPRESS": "DEFLATE", "LEVEL": "6", "PREDICTOR": "YES",
            "OVERVIEWS": "IGNORE_EXISTING", "OVERVIEW_RESAMPLING": "AVERAGE" if spec.averaged else "NEAREST",
            "BIGTIFF": "IF_SAFER", "NUM_THREADS": "ALL_CPUS",
        }  # fmt: skip
        rasterio.shutil.copy(str(draft), str(temporary), driver="COG", **options)
        draft.unlink()
    give_back_memory()


@dataclass(frozen=True, slots=True)
class NearestLayers:
    """The same layers on another grid, each pixel that of the layers' own grid in which its centre lies."""

    source: LayerSource
    grid: MapGrid

    def read(self, layer: Layer, window: Window) -> npt.NDArray[Any]:
        """``(bands, height, width)`` of the layer; its nodata beyond the source."""
        old, out = self.source.grid, empty(layer, window.height, window.width)
        x, y = lattice(self._to_source, window)
        with np.errstate(invalid="ignore"):
            inside = (x >= -0.5) & (x < old.width - 0.5) & (y >= -0.5) & (y < old.height - 0.5)
        if not inside.any():
            return out
        cols, rows = (np.rint(v[inside]).astype(int) for v in (x, y))
        near = Window(int(cols.min()), int(rows.min()), int(np.ptp(cols)) + 1, int(np.ptp(rows)) + 1)
        out[:, inside] = self.source.read(layer, near)[:, rows - near.row_off, cols - near.col_off]
        return out

    def _to_source(self, xy_px: npt.ArrayLike) -> npt.NDArray[np.float64]:
        old, on_ground = self.source.grid, self.grid.to_crs(xy_px)
        if not same_crs(old.crs_wkt, self.grid.crs_wkt):
            what = "a layer in another coordinate reference system"
            wkts = needs_place(self.grid.crs_wkt, what), needs_place(old.crs_wkt, what)
            corners = self.grid.to_crs(np.array([[0.0, 0.0], [self.grid.width, self.grid.height]]))
            on_ground = point_map(*wkts, around_xy=corners)(on_ground)
        return old.to_px(on_ground)


def _file_name(layer: Layer) -> str:
    return f"{layer}.tif"
