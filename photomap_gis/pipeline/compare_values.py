"""What may be asked of a comparison of two maps, where its files go, and what it tells."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from photomap_gis.core.errors import OutputError, UsageError


@dataclass(frozen=True, slots=True)
class CompareSettings:
    """Choices of a comparison.

    ``gsd_m_per_px`` is its pixel (``None``: the coarser one's), ``crs`` its CRS (``None``: NEW's where it is in metres
    and true to scale, else UTM), ``threshold`` the score from which ground counts as changed, ``min_area_m2`` the
    smallest polygon (``None``: 1 m2 or 40 pixels, whichever is more).
    """

    crs: str | None = None
    gsd_m_per_px: float | None = None
    threshold: float = 0.5
    min_area_m2: float | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        if self.gsd_m_per_px is not None and not (math.isfinite(self.gsd_m_per_px) and self.gsd_m_per_px > 0):
            raise UsageError(f"--gsd must be a positive number of metres a pixel, got {self.gsd_m_per_px:g}")
        if not 0.0 < self.threshold < 1.0:
            raise UsageError(f"--threshold must lie between 0 and 1, got {self.threshold:g}")
        if self.min_area_m2 is not None and not (math.isfinite(self.min_area_m2) and self.min_area_m2 >= 0.0):
            raise UsageError(f"--min-area must be 0 or more square metres, got {self.min_area_m2:g}")


@dataclass(frozen=True, slots=True)
class LaidOn:
    """How old and new were laid on each other.

    ``agreed`` of the ``places`` that both show told one motion; its shift (old minus new, at the middle) is in metres.
    ``residual_px`` is how far neighbouring local shifts disagree after that (one sigma), ``share`` of them could be
    measured. ``sure`` is false where no motion was agreed on: then the files' own georeference is taken.
    """

    sure: bool
    places: int
    agreed: int
    shift_east_m: float
    shift_north_m: float
    residual_px: float | None
    share: float


@dataclass(frozen=True, slots=True)
class CompareSummary:
    """What a comparison found; areas are in square metres, ``compared_m2`` is what both show."""

    old: str
    new: str
    crs: str
    gsd_m_per_px: float
    bounds: tuple[float, float, float, float]
    compared_m2: float
    changed_m2: float
    areas: int
    threshold: float
    min_area_m2: float
    registration: LaidOn
    outputs: tuple[str, ...]
    warnings: tuple[str, ...] = field(default=())

    def as_document(self) -> dict[str, Any]:
        """Return the JSON document of ``photomap compare --json``."""
        share = self.changed_m2 / self.compared_m2 if self.compared_m2 else 0.0
        return asdict(self) | {"bounds": list(self.bounds), "changed_share": share}


@dataclass(frozen=True, slots=True)
class CompareOutputs:
    """The files of a comparison: scores as GeoTIFF, changed areas as GeoJSON or GeoPackage, a picture."""

    raster: Path
    polygons: Path
    picture: Path

    @classmethod
    def of(cls, out: Path | None, polygons: Path | None = None, picture: Path | None = None) -> CompareOutputs:
        """Return the files for ``-o``: a GeoTIFF (the others beside it), a polygon file, or a folder."""
        if out is None or out.suffix == "" or out.is_dir():
            folder = out or Path()
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(f"{folder} cannot be made: {error.strerror}; choose another folder by -o") from error
            raster = folder / "change.tif"
        elif out.suffix.lower() in (".tif", ".tiff"):
            raster = out
        elif out.suffix.lower() in (".geojson", ".json", ".gpkg") and polygons is None:
            raster, polygons = out.with_suffix(".tif"), out
        else:
            raise UsageError(f"-o {out} must be a folder or end in .tif, .geojson or .gpkg")
        polygons = polygons or raster.with_suffix(".geojson")
        if polygons.suffix.lower() not in (".geojson", ".json", ".gpkg"):
            raise UsageError(f"--polygons {polygons} must end in .geojson or .gpkg")
        picture = picture or raster.with_suffix(".png")
        if picture.suffix.lower() != ".png":
            raise UsageError(f"--picture {picture} must end in .png")
        return cls(raster, polygons, picture)
