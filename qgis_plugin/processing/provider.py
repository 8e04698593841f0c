"""The provider: photomap's algorithms in the toolbox."""

from __future__ import annotations

from qgis.core import QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from ..translation import tr
from .algorithm import ICON
from .changes import CompareAlgorithm
from .flights import PlanAlgorithm, SimulateAlgorithm, UploadAlgorithm
from .held_engine import release
from .maps import ExportAlgorithm, InfoAlgorithm, MapAlgorithm, PackageAlgorithm

ALGORITHMS = (
    MapAlgorithm,
    ExportAlgorithm,
    PlanAlgorithm,
    UploadAlgorithm,
    SimulateAlgorithm,
    CompareAlgorithm,
    PackageAlgorithm,
    InfoAlgorithm,
)


class PhotomapProvider(QgsProcessingProvider):
    """Offers ``photomap:map``, ``photomap:export`` and so on."""

    def id(self) -> str:
        """Return what stands before an algorithm's name."""
        return "photomap"

    def name(self) -> str:
        """Return the provider's name in the toolbox."""
        return "photomap"

    def longName(self) -> str:
        """Return the name where there is room."""
        return tr("photomap: photo maps from drones")

    def icon(self) -> QIcon:
        """Return photomap's icon."""
        return QIcon(str(ICON))

    def loadAlgorithms(self) -> None:
        """Add the algorithms."""
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())

    def unload(self) -> None:
        """End the engine that algorithms were run by."""
        release()
        super().unload()

    def defaultRasterFileExtension(self) -> str:
        """Return what rasters are: GeoTIFF."""
        return "tif"

    def defaultVectorFileExtension(self, hasGeometry: bool = True) -> str:
        """Return what vectors are: GeoPackage."""
        return "gpkg"

    def supportedOutputRasterLayerExtensions(self) -> list[str]:
        """Return the endings that the engine writes."""
        return ["tif"]

    def supportedOutputVectorLayerExtensions(self) -> list[str]:
        """Return the endings that the engine writes."""
        return ["gpkg", "geojson"]

    def supportsNonFileBasedOutput(self) -> bool:
        """Return no: the engine writes files."""
        return False
