"""Algorithms around a mission: make it, say what is in it, hand it over in any format."""

from __future__ import annotations

import json
from pathlib import Path

from qgis.core import (
    QgsProcessing,
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingOutputNumber,
    QgsProcessingOutputRasterLayer,
    QgsProcessingOutputString,
    QgsProcessingOutputVectorLayer,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
)

from ..formats import COMPRESSIONS, formats
from ..translation import tr
from .algorithm import EngineAlgorithm, load_when_done
from .export_names import RASTERS, VECTORS, named_for
from .fields import Field, choice, crs, file, folder, number, polygons, raster, rasters, switch, text, whole

PREFERENCES = ("nadir", "sharp", "newest")


def sources() -> Field:
    """Photos or videos: a folder, files, or both."""
    return Field("FILES", "sources", _files, _read_sources)


def _files() -> QgsProcessingParameterMultipleLayers:
    kind = QgsProcessing.SourceType.TypeFile
    return QgsProcessingParameterMultipleLayers("FILES", tr("Videos, or single photos"), kind, optional=True)


def _read_sources(algorithm, values, context) -> list[str]:
    found = [
        algorithm.parameterAsFile(values, "FOLDER", context),
        *algorithm.parameterAsFileList(values, "FILES", context),
    ]
    found = [name for name in found if name]
    if not found:
        raise QgsProcessingException(tr("Choose a folder of photos, or videos."))
    return found


def source_folder(words: str) -> Field:
    """The folder of photos; read together with the files."""
    behavior = QgsProcessingParameterFile.Behavior.Folder
    return Field(
        "FOLDER", "", lambda: QgsProcessingParameterFile("FOLDER", words, behavior, optional=True), lambda a, v, c: None
    )


def load_switch() -> QgsProcessingParameterBoolean:
    """Whether the result goes into the project."""
    return QgsProcessingParameterBoolean("LOAD", tr("Add the result to the project"), True)


class MapAlgorithm(EngineAlgorithm):
    """``photomap map``."""

    kind = "map"
    title = "Photo map from photos or video"
    summary = "Makes a georeferenced photo map from a drone's photos or video, with its accuracy."
    words = (
        "Positions come from the photos' EXIF, or from a log beside the video of the same name (.SRT, .gpx ...).",
        "The mission folder then holds map.tif, map.kmz and all that is needed to export again. The same call on the "
        "same folder goes on where it was stopped.",
        "Without any positions the map is relative: it is not georeferenced, and a warning says so.",
    )

    def fields(self) -> tuple[Field, ...]:
        """Return photos first, then what places the map, then how it is drawn."""
        return (
            source_folder(tr("Folder of photos")),
            sources(),
            file("TRACK", "track", tr("Track log of the video, where none lies beside it")),
            crs("CRS", "crs", tr("CRS of the map (default: the right UTM zone)")),
            number("GSD", "gsd", tr("Pixel of the map in metres (default: what the camera saw)"), low=0.0001),
            raster("DEM", "dem", tr("Heights of the ground"), optional=True),
            file("GCP", "gcp", tr("Ground control points (gcp_list.txt or CSV)")),
            crs("GCP_CRS", "gcp_crs", tr("CRS of a CSV of control points that does not say"), advanced=True),
            text("CHECK", "check", tr("Check points: names with commas, or every-third"), advanced=True),
            rasters("REFERENCE", "reference", tr("Existing imagery to lay the map on")),
            number("FOV", "fov_deg", tr("Horizontal field of view, degrees"), low=1, high=170, advanced=True),
            choice("PREFER", "prefer", tr("Of several frames show"), PREFERENCES, default="nadir", advanced=True),
            switch("LAYERS", "layers", tr("Write layers of accuracy, age and coverage too"), advanced=True),
            whole("MEMORY", "memory", tr("Memory for pictures, MB"), low=128, advanced=True),
        )

    def add_outputs(self) -> None:
        """Add the mission's folder, the map and its numbers."""
        self.addParameter(
            QgsProcessingParameterFolderDestination("OUTPUT", tr("Mission folder (a temporary one goes with QGIS)"))
        )
        self.addParameter(load_switch())
        self.addOutput(QgsProcessingOutputRasterLayer("MAP", tr("Photo map")))
        self.addOutput(QgsProcessingOutputNumber("GSD_M", tr("Pixel in metres")))
        self.addOutput(QgsProcessingOutputNumber("CE90_M", tr("Predicted CE90 in metres")))
        self.addOutput(QgsProcessingOutputNumber("REGISTERED", tr("Registered frames")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """The mission goes into the chosen folder."""
        arguments["output"] = self.parameterAsString(values, "OUTPUT", context)
        self._load = self.parameterAsBool(values, "LOAD", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the map and its numbers."""
        if self._load:
            load_when_done(result["map"], Path(result["mission"]).name, "MAP", context)
        return {
            "OUTPUT": result["mission"],
            "MAP": result["map"],
            "GSD_M": result["gsd_m_per_px"],
            "CE90_M": result["predicted_ce90_m"],
            "REGISTERED": result["frames"].get("registered", 0),
        }


class ExportAlgorithm(EngineAlgorithm):
    """``photomap export``, every format."""

    kind = "export"
    title = "Export a photo map"
    summary = "Writes a mission's map as GeoTIFF, KMZ, MBTiles, GeoPackage, ATAK data package, GeoPDF and more."
    words = (
        "Formats that are folders (tiles, layers) take the output as a folder. The output's ending is made to fit.",
        "A layer whose stale pixels are to be replaced (GeoTIFF only) keeps its grid, CRS and bands.",
    )

    def fields(self) -> tuple[Field, ...]:
        """Return mission, format and what may be asked of it."""
        flags = [f.flag for f in formats()]
        return (
            folder("MISSION", "mission", tr("Mission folder")),
            Field(
                "FORMAT", "", choice("FORMAT", "", self._format_words(), flags, default="geotiff").make, lambda *_: None
            ),
            polygons("CUTLINE", "cutline", tr("Only inside these polygons"), optional=True),
            crs("CRS", "crs", tr("CRS (default: the mission's)")),
            number("GSD", "gsd", tr("Finest pixel, in units of the CRS"), low=1e-6),
            choice(
                "COMPRESS", "compress", tr("Compression of the GeoTIFF"), COMPRESSIONS, default="deflate", advanced=True
            ),
            whole("QUALITY", "quality", tr("Quality of JPEG and WEBP"), low=1, high=100, advanced=True),
            raster("OVER", "over", tr("Replace the stale pixels of this layer"), optional=True, advanced=True),
            file("FINDS", "finds", tr("Finds (points) for ATAK and vectors"), advanced=True),
            text("ATTRIBUTION", "attribution", tr("Whom to credit"), advanced=True),
        )

    def add_outputs(self) -> None:
        """Add the file, and the layer that it is."""
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", tr("File, or folder"), tr("All files (*.*)")))
        self.addParameter(load_switch())
        self.addOutput(QgsProcessingOutputRasterLayer("RASTER", tr("Raster layer")))
        self.addOutput(QgsProcessingOutputVectorLayer("VECTOR", tr("Vector layer")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """The format is a switch of its own, and its file ends as it must."""
        self._flag = self.parameterAsEnumString(values, "FORMAT", context)
        self._load = self.parameterAsBool(values, "LOAD", context)
        arguments[self._flag] = True
        arguments["output"] = named_for(self._flag, self.parameterAsFileOutput(values, "OUTPUT", context))
        if self._flag != "geotiff":
            arguments.pop("compress", None)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the file, and as a layer where QGIS reads it as one."""
        path = result["outputs"][0]
        found = {"OUTPUT": path}
        key = "RASTER" if self._flag in RASTERS else "VECTOR" if self._flag in VECTORS else None
        if key is not None:
            found[key] = path
            if self._load:
                load_when_done(path, Path(path).stem, key, context)
        return found

    def shortHelpString(self) -> str:
        """Return the help with a line a format."""
        lines = "".join(f"<br><b>{f.flag}</b>: {f.words}" for f in formats())
        return super().shortHelpString() + f"<p>{tr('Formats:')}{lines}</p>"

    def _format_words(self) -> str:
        return tr("Format")


class PackageAlgorithm(EngineAlgorithm):
    """``photomap package``."""

    kind = "package"
    title = "Package for the incident commander"
    summary = "Packs a mission's map (GeoTIFF, KMZ, MBTiles), vectors, finds and a page of summary into one zip."
    words = ("A largest size, such as 20MB, makes it fit a slow link: with loss, then coarser; what was lost is said.",)

    def fields(self) -> tuple[Field, ...]:
        """Return mission and size."""
        return (
            folder("MISSION", "mission", tr("Mission folder")),
            text("MAX_SIZE", "max_size", tr("Largest size, such as 20MB")),
        )

    def add_outputs(self) -> None:
        """Add the package."""
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", tr("Package"), tr("Zip files (*.zip)")))
        self.addOutput(QgsProcessingOutputNumber("BYTES", tr("Size in bytes")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """The package goes where it was asked for."""
        arguments["output"] = self.parameterAsFileOutput(values, "OUTPUT", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the package and its size."""
        return {"OUTPUT": result["package"], "BYTES": result["bytes"]}


class InfoAlgorithm(EngineAlgorithm):
    """``photomap info``."""

    kind = "info"
    title = "What is in photos, a video or a mission"
    summary = "Says what is in a source before anyone waits for a map: frames, camera, track, overlap, problems."
    words = ("A mission folder tells its place and its accuracy instead.",)

    def fields(self) -> tuple[Field, ...]:
        """Return the sources and how they are read."""
        return (
            source_folder(tr("Folder of photos, or a mission")),
            sources(),
            file("TRACK", "track", tr("Track log of the video, where none lies beside it")),
            number("FOV", "fov_deg", tr("Horizontal field of view, degrees"), low=1, high=170, advanced=True),
        )

    def add_outputs(self) -> None:
        """Add the report."""
        what = tr("JSON files (*.json)")
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", tr("Report"), what, None, True))
        self.addOutput(QgsProcessingOutputFile("OUTPUT", tr("Report")))
        self.addOutput(QgsProcessingOutputString("REPORT", tr("Report as JSON")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """Remember where the report goes: we write it ourselves."""
        self._report = self.parameterAsFileOutput(values, "OUTPUT", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the report as text and as a file."""
        said = json.dumps(result, indent=1)
        if self._report:
            try:
                Path(self._report).write_text(said + "\n", encoding="utf-8")
            except OSError as error:
                words = tr("The report cannot be written to {}: {}; choose another file.")
                raise QgsProcessingException(words.format(self._report, error.strerror)) from error
        return {"OUTPUT": self._report, "REPORT": said}
