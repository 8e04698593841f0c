"""A field of an algorithm's dialog and the argument of the engine's job that it becomes: one table an algorithm."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterCrs,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterPoint,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
)

from ..translation import tr
from .inputs import WGS84, area_file, file_of_raster, lat_lon

Values = dict
Read = Callable[[Any, Values, QgsProcessingContext], Any]


@dataclass(frozen=True)
class Field:
    """``make`` gives the parameter, ``read`` its value for the job's ``argument``; ``None`` is not given."""

    key: str
    argument: str
    make: Callable[[], QgsProcessingParameterDefinition]
    read: Read
    advanced: bool = False
    help: str = ""

    def parameter(self) -> QgsProcessingParameterDefinition:
        """Return a new parameter for an algorithm."""
        made = self.make()
        if self.advanced:
            made.setFlags(made.flags() | QgsProcessingParameterDefinition.Flag.FlagAdvanced)
        if self.help:
            made.setHelp(self.help)
        return made


def number(key: str, argument: str, words: str, low=None, high=None, default=None, **more) -> Field:
    """A number; not given where it is left empty."""
    bounds = {name: value for name, value in (("minValue", low), ("maxValue", high)) if value is not None}
    kind = QgsProcessingParameterNumber.Type.Double

    def make():
        return QgsProcessingParameterNumber(key, words, kind, default, optional=default is None, **bounds)

    return Field(key, argument, make, _given(key, lambda a, v, c: a.parameterAsDouble(v, key, c), default), **more)


def whole(key: str, argument: str, words: str, low=None, high=None, default=None, **more) -> Field:
    """A whole number; not given where it is left empty."""
    bounds = {name: value for name, value in (("minValue", low), ("maxValue", high)) if value is not None}
    kind = QgsProcessingParameterNumber.Type.Integer

    def make():
        return QgsProcessingParameterNumber(key, words, kind, default, optional=default is None, **bounds)

    return Field(key, argument, make, _given(key, lambda a, v, c: a.parameterAsInt(v, key, c), default), **more)


def text(key: str, argument: str, words: str, optional: bool = True, default=None, **more) -> Field:
    """Words."""

    def make():
        return QgsProcessingParameterString(key, words, default, optional=optional)

    return Field(key, argument, make, lambda a, v, c: a.parameterAsString(v, key, c).strip() or None, **more)


def switch(key: str, argument: str, words: str, default: bool = False, **more) -> Field:
    """Yes or no."""

    def make():
        return QgsProcessingParameterBoolean(key, words, default)

    return Field(key, argument, make, lambda a, v, c: True if a.parameterAsBool(v, key, c) else None, **more)


def choice(key: str, argument: str, words: str, options: Sequence[str], default=None, **more) -> Field:
    """One of the engine's own words; in ``qgis_process`` and models they are given as they are."""

    def make():
        made = QgsProcessingParameterEnum(key, words, list(options), False, default, optional=default is None)
        made.setUsesStaticStrings(True)
        return made

    return Field(key, argument, make, lambda a, v, c: a.parameterAsEnumString(v, key, c) or None, **more)


def file(key: str, argument: str, words: str, optional: bool = True, filter: str = "", **more) -> Field:
    """An existing file."""

    def make():
        return QgsProcessingParameterFile(
            key, words, QgsProcessingParameterFile.Behavior.File, optional=optional, fileFilter=filter
        )

    return Field(key, argument, make, lambda a, v, c: a.parameterAsFile(v, key, c) or None, **more)


def folder(key: str, argument: str, words: str, optional: bool = False, **more) -> Field:
    """An existing folder."""

    def make():
        return QgsProcessingParameterFile(key, words, QgsProcessingParameterFile.Behavior.Folder, optional=optional)

    return Field(key, argument, make, lambda a, v, c: a.parameterAsFile(v, key, c) or None, **more)


def raster(key: str, argument: str, words: str, optional: bool = False, **more) -> Field:
    """A raster layer, as its file."""

    def make():
        return QgsProcessingParameterRasterLayer(key, words, optional=optional)

    def read(algorithm, values, context):
        layer = algorithm.parameterAsRasterLayer(values, key, context)
        if layer is None:
            if values.get(key):
                raise QgsProcessingException(tr("{}: {} is no raster that QGIS can read.").format(words, values[key]))
            return None
        return file_of_raster(layer)

    return Field(key, argument, make, read, **more)


def rasters(key: str, argument: str, words: str, **more) -> Field:
    """Several raster layers, as their files."""

    def make():
        return QgsProcessingParameterMultipleLayers(key, words, QgsProcessing.SourceType.TypeRaster, optional=True)

    def read(algorithm, values, context):
        return [file_of_raster(layer) for layer in algorithm.parameterAsLayerList(values, key, context)] or None

    return Field(key, argument, make, read, **more)


def polygons(key: str, argument: str, words: str, optional: bool = False, **more) -> Field:
    """A polygon layer of any CRS (or its selected features), as a file in WGS 84."""

    def make():
        kind = [QgsProcessing.SourceType.TypeVectorPolygon]
        return QgsProcessingParameterFeatureSource(key, words, kind, optional=optional)

    def read(algorithm, values, context):
        source = algorithm.parameterAsSource(values, key, context)
        if source is None:
            if not optional or values.get(key):
                raise QgsProcessingException(algorithm.invalidSourceError(values, key))
            return None
        return area_file(source, words, context)

    return Field(key, argument, make, read, **more)


def place(key: str, argument: str, words: str, **more) -> Field:
    """A point, in degrees."""

    def make():
        return QgsProcessingParameterPoint(key, words, optional=True)

    def read(algorithm, values, context):
        if not values.get(key):
            return None
        return lat_lon(algorithm.parameterAsPoint(values, key, context, QgsCoordinateReferenceSystem(WGS84)))

    return Field(key, argument, make, read, **more)


def crs(key: str, argument: str, words: str, **more) -> Field:
    """A CRS by its authority's name, or as WKT where it has none."""

    def make():
        return QgsProcessingParameterCrs(key, words, optional=True)

    def read(algorithm, values, context):
        chosen = algorithm.parameterAsCrs(values, key, context)
        return (chosen.authid() or chosen.toWkt()) if chosen.isValid() else None

    return Field(key, argument, make, read, **more)


def further_options() -> Field:
    """Any other options of the command, as JSON: what the dialog has no field for."""
    key = "OPTIONS"

    def make():
        words = tr('Further options of the command, as JSON: {"workers": 2}')
        return QgsProcessingParameterString(key, words, None, True, True)

    def read(algorithm, values, context):
        given = algorithm.parameterAsString(values, key, context).strip()
        try:
            options = json.loads(given) if given else {}
        except ValueError:
            options = None
        if not isinstance(options, dict):
            raise QgsProcessingException(tr('Further options: write a JSON object such as {"workers": 2}.'))
        return options

    return Field(key, "", make, read, advanced=True)


def _given(key: str, read: Read, default: Any) -> Read:
    """Read a number only where there is one: empty numbers read as 0."""
    return lambda a, v, c: None if v.get(key) is None and default is None else read(a, v, c)
