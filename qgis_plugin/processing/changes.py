"""The algorithm that says what has changed between old imagery and a new map."""

from __future__ import annotations

from qgis.core import (
    QgsProcessing,
    QgsProcessingOutputNumber,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterVectorDestination,
)

from ..translation import tr
from .algorithm import EngineAlgorithm
from .fields import Field, crs, number, raster


class CompareAlgorithm(EngineAlgorithm):
    """``photomap compare``."""

    kind = "compare"
    title = "What has changed"
    summary = "Compares old imagery with a new map: the probability of change of each pixel, and changed areas."
    words = (
        "Any CRS, pixel size, grey or colour: the two are laid on each other first and freed of light and season.",
        "The raster holds 0 to 1, and -1 where either shows nothing.",
    )

    def fields(self) -> tuple[Field, ...]:
        """Return the two imageries and what counts as a change."""
        return (
            raster("OLD", "old", tr("Old imagery")),
            raster("NEW", "new", tr("New map")),
            number("THRESHOLD", "threshold", tr("Score from which ground has changed"), low=0, high=1, default=0.5),
            number("MIN_AREA", "min_area", tr("Smallest area, square metres"), low=0),
            number("GSD", "gsd", tr("Pixel of the comparison, metres (default: the coarser one's)"), low=0.0001),
            crs("CRS", "crs", tr("CRS of the comparison"), advanced=True),
        )

    def add_outputs(self) -> None:
        """Add raster and areas."""
        self.addParameter(QgsProcessingParameterRasterDestination("OUTPUT", tr("Probability of change")))
        kind = QgsProcessing.SourceType.TypeVectorPolygon
        self.addParameter(QgsProcessingParameterVectorDestination("POLYGONS", tr("Changed areas"), kind))
        self.addOutput(QgsProcessingOutputNumber("AREAS", tr("Number of changed areas")))
        self.addOutput(QgsProcessingOutputNumber("CHANGED_M2", tr("Changed ground, square metres")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """Both go where they were asked for."""
        arguments["output"] = self.parameterAsOutputLayer(values, "OUTPUT", context)
        arguments["polygons"] = self.parameterAsOutputLayer(values, "POLYGONS", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the layers and the numbers."""
        return {
            "OUTPUT": arguments["output"],
            "POLYGONS": arguments["polygons"],
            "AREAS": result["areas"],
            "CHANGED_M2": result["changed_m2"],
        }
