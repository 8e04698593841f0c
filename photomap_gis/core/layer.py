"""The layers of a map: what is known of each of its pixels besides its colour, and how a raster of it is written.

Commanders ask how old a spot is, and whether a person would have been seen there: the layers are the answer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapGrid, Window

BLUR_TO_WIDTH = 2.0 * math.sqrt(2.0 * math.log(2.0))
"""Full width at half maximum of a Gaussian over its standard deviation."""

PERSON_WIDTH_M = 0.5
"""A lying or standing person seen from above is about this wide."""


class Layer(StrEnum):
    """What may be known of every pixel; each is a raster of that name."""

    LAST_SEEN = "last_seen"
    SOURCE_FRAME = "source_frame"
    VIEWS = "views"
    SIGMA = "sigma"
    SEARCHED = "searched"


class Searched(StrEnum):
    """The bands of the *searched* layer, in their order; all are of one sighting: the one that shows most."""

    RESOLUTION = "resolution"
    GSD = "gsd"
    BLUR = "blur"
    AGE = "age"


@dataclass(frozen=True, slots=True)
class LayerBand:
    """A band: its name, its unit, and in words what it says."""

    name: str
    unit: str
    words: str


@dataclass(frozen=True, slots=True)
class LayerSpec:
    """How a layer is written. ``averaged``: overviews may hold means, which numbers of frames never may."""

    dtype: Literal["uint16", "uint32", "int32", "float32"]
    nodata: float
    bands: tuple[LayerBand, ...]
    averaged: bool = False


LAYERS: Mapping[Layer, LayerSpec] = MappingProxyType(
    {
        Layer.LAST_SEEN: LayerSpec(
            "uint32", 0, (LayerBand("last_seen", "s since 1970-01-01T00:00:00Z", "when a frame saw the spot last"),)
        ),
        Layer.SOURCE_FRAME: LayerSpec(
            "int32", -1, (LayerBand("source_frame", "frame", "which frame the map shows here; see poses.csv"),)
        ),
        Layer.VIEWS: LayerSpec("uint16", 0, (LayerBand("views", "frames", "how many frames saw the spot"),)),
        Layer.SIGMA: LayerSpec(
            "float32", math.nan,
            (LayerBand("sigma", "m", "predicted one sigma per axis of the place of what the map shows here"),),
            averaged=True,
        ),
        Layer.SEARCHED: LayerSpec(
            "float32", math.nan,
            (
                LayerBand(Searched.RESOLUTION, "m", "smallest detail that the best sighting can show: the larger of "
                          f"gsd and {BLUR_TO_WIDTH:.3f} gsd blur; a person is {PERSON_WIDTH_M:g} m wide"),
                LayerBand(Searched.GSD, "m", "ground sampling distance of that sighting, along its coarser axis"),
                LayerBand(Searched.BLUR, "px", "blur of that frame, one sigma in its own pixels"),
                LayerBand(Searched.AGE, "s", "how much older that sighting is than the mission's newest frame"),
            ),
        ),
    }
)  # fmt: skip


class LayerSource(Protocol):
    """Layers that can be read piece by piece; never whole in memory."""

    @property
    def grid(self) -> MapGrid:
        """The grid of every layer: the map's own."""
        ...

    def read(self, layer: Layer, window: Window) -> npt.NDArray[Any]:
        """``(bands, height, width)`` of the layer's dtype; its nodata where nothing was seen or is known."""
        ...


def empty(layer: Layer, height: int, width: int) -> npt.NDArray[Any]:
    """Return ``(bands, height, width)`` of a layer's nodata."""
    spec = LAYERS[layer]
    return np.full((len(spec.bands), height, width), spec.nodata, dtype=spec.dtype)
