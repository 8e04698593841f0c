"""Algorithms around a flight: plan it, put it onto the vehicle, simulate it."""

from __future__ import annotations

from qgis.core import (
    QgsProcessingException,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingOutputVectorLayer,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingUtils,
)

from ..translation import tr
from .algorithm import EngineAlgorithm, load_when_done
from .fields import Field, choice, file, number, place, polygons, raster, switch, text, whole
from .maps import load_switch

AUTOPILOTS = ("ardupilot", "px4")
PLAN_FILTER = (
    "QGroundControl (*.plan);;Mission Planner (*.waypoints);;KML (*.kml);;KMZ (*.kmz);;GeoJSON (*.geojson);;"
    "GPX (*.gpx);;CSV (*.csv);;DJI WPML (*.wpml.kmz)"
)


class PlanAlgorithm(EngineAlgorithm):
    """``photomap plan`` over an area."""

    kind = "plan"
    title = "Plan a coverage flight"
    summary = "Plans flights that are sure to see all of an area, with proof of what they see."
    words = (
        "The area may have any CRS. Give one of pixel, height and target; without a camera a usual one is assumed, and "
        "a warning says so.",
        "The file's ending says its format: .plan, .waypoints, .kml, .kmz, .geojson, .gpx, .csv, .wpml.kmz (DJI).",
    )

    def fields(self) -> tuple[Field, ...]:
        """Return where, with what, how finely, and then the flight."""
        return (
            polygons("AREA", "area", tr("Area")),
            polygons("AVOID", "avoid", tr("Never fly here"), optional=True),
            text("CAMERA", "camera", tr("Camera, as FC6310 or Mavic 3E")),
            number("GSD", "gsd", tr("Ground sampling distance, metres a pixel"), low=0.0001, high=1),
            number("HEIGHT", "height", tr("Height above ground, metres, instead"), low=1, high=10_000),
            text("TARGET", "target", tr("What must be seen, instead (person, card, 0.4x0.3)")),
            number("FRONT", "front_overlap", tr("Front overlap, percent"), low=0, high=97, default=80),
            number("SIDE", "side_overlap", tr("Side overlap, percent"), low=0, high=97, default=65),
            number("ANGLE", "angle", tr("Heading of the lanes, degrees (default: the fastest)"), low=-360, high=360),
            number("SPEED", "speed", tr("Speed, metres a second"), low=0.1, high=100, default=10),
            text("WIND", "wind", tr("Wind: metres a second and where from, as 5,270")),
            number("ENDURANCE", "endurance_min", tr("Minutes that one battery flies"), low=0.5, high=10_000),
            place("HOME", "home", tr("Take-off place")),
            raster("DEM", "dem", tr("Elevation model: keep the height above it"), optional=True),
            switch("CROSSHATCH", "crosshatch", tr("A second sweep across the first"), advanced=True),
            switch("INSET", "inset", tr("Never leave the area"), advanced=True),
            choice("AUTOPILOT", "autopilot", tr("Autopilot"), AUTOPILOTS, default="ardupilot"),
        )

    def add_outputs(self) -> None:
        """Add the plan, what a map shows of it, and its numbers."""
        self.addParameter(QgsProcessingParameterFileDestination("OUTPUT", tr("Plan"), PLAN_FILTER))
        self.addParameter(load_switch())
        self.addOutput(QgsProcessingOutputVectorLayer("DRAWING", tr("Lanes, footprints, coverage, waypoints")))
        self.addOutput(QgsProcessingOutputNumber("COVERED_SHARE", tr("Share of the area that is sure to be seen")))
        self.addOutput(QgsProcessingOutputNumber("DURATION_S", tr("Time of flight in seconds")))
        self.addOutput(QgsProcessingOutputNumber("PHOTOS", tr("Photos")))
        self.addOutput(QgsProcessingOutputNumber("SORTIES", tr("Sorties")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """The plan goes where it was asked for, its drawing into a temporary file."""
        if "gsd" in arguments:
            arguments["gsd"] = f"{arguments['gsd']!r}m"
        if "avoid" in arguments:
            arguments["avoid"] = [arguments["avoid"]]
        arguments["output"] = self.parameterAsFileOutput(values, "OUTPUT", context)
        arguments["drawing"] = QgsProcessingUtils.generateTempFilename("plan.geojson")
        self._load = self.parameterAsBool(values, "LOAD", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the plan, its drawing and its numbers."""
        drawing = arguments["drawing"]
        if self._load:
            for kind, shape in (("footprint", "Polygon"), ("lane", "LineString"), ("waypoint", "Point")):
                uri = f"{drawing}|geometrytype={shape}|subset=\"kind\" = '{kind}'"
                load_when_done(uri, tr(kind), "DRAWING", context)
        return {
            "OUTPUT": arguments["output"],
            "DRAWING": drawing,
            "COVERED_SHARE": result["covered_share"],
            "DURATION_S": result["duration_s"],
            "PHOTOS": result["photos"],
            "SORTIES": len(result["sorties"]),
        }


class UploadAlgorithm(EngineAlgorithm):
    """``photomap upload``."""

    kind = "upload"
    title = "Upload a plan to the vehicle"
    summary = "Uploads a plan over MAVLink, reads it back, and puts the old mission back where it is not the same."
    words = (
        "Nothing is armed, no mode is changed, no mission is started. What the vehicle held before is kept in a file.",
    )

    def fields(self) -> tuple[Field, ...]:
        """Return plan and link."""
        return (
            file("PLAN", "plan", tr("Plan (.plan or .waypoints)"), optional=False),
            text("CONNECT", "connect", tr("Connection"), optional=False, default="udpin:0.0.0.0:14550"),
            whole("SYSTEM", "system", tr("System id, where several vehicles are on the link"), low=1, high=255),
            number("TIMEOUT", "timeout", tr("Give up after so many seconds"), low=1, high=3600, default=60),
            number("MAX_HEIGHT", "max_height", tr("Refuse items higher above home, metres"), low=1, default=120),
            number("MAX_DISTANCE", "max_distance", tr("Refuse items farther from home, metres"), low=1, default=5000),
            switch("WAIT_MODE", "wait_mode", tr("Wait while the vehicle flies its mission"), advanced=True),
        )

    def add_outputs(self) -> None:
        """Add what became of it."""
        self.addOutput(QgsProcessingOutputString("OUTCOME", tr("Outcome")))
        self.addOutput(QgsProcessingOutputNumber("ITEMS", tr("Items")))
        self.addOutput(QgsProcessingOutputString("SAVED", tr("What the vehicle held before")))

    def outputs_of(self, result, arguments, context) -> dict:
        """Return the outcome: ``verified``, since all else is an exception."""
        return {"OUTCOME": result["outcome"], "ITEMS": result["items"], "SAVED": result.get("saved_previous") or ""}


class SimulateAlgorithm(EngineAlgorithm):
    """``photomap simulate``."""

    kind = "simulate"
    title = "Simulate a flight"
    summary = "Simulates a drone's photos or video over any imagery, with the true poses: to try things and to train."
    words = ("Without imagery a made scene with relief is flown over.",)

    def fields(self) -> tuple[Field, ...]:
        """Return the ground and the flight."""
        return (
            Field("GROUND", "ground", raster("GROUND", "", tr("Imagery to fly over"), optional=True).make, _ground),
            whole("FRAMES", "frames", tr("Photos, or frames of the video"), low=1, default=80),
            number("ALTITUDE", "altitude", tr("Height above ground, metres (default: the ground is filled)"), low=1),
            whole("WIDTH", "width", tr("Width of a frame, pixels"), low=64, default=1600),
            whole("HEIGHT", "frame_height", tr("Height of a frame, pixels"), low=64, default=1200),
            switch("VIDEO", "video", tr("A video instead of photos")),
            number("GPS_SIGMA", "gps_sigma", tr("Error of the GPS, metres"), low=0, default=2, advanced=True),
            number("JITTER", "jitter_deg", tr("Sigma of roll and pitch, degrees"), low=0, default=1, advanced=True),
            whole("SEED", "seed", tr("Seed: the same one gives the same flight"), default=0, advanced=True),
        )

    def add_outputs(self) -> None:
        """Add the folder and what is in it."""
        self.addParameter(QgsProcessingParameterFolderDestination("OUTPUT", tr("Folder")))
        self.addOutput(QgsProcessingOutputString("SOURCE", tr("Photos, or the video")))
        self.addOutput(QgsProcessingOutputNumber("GSD_M", tr("Pixel in metres")))

    def arguments_for_outputs(self, values, context, arguments) -> None:
        """All of it goes into the chosen folder."""
        arguments["output"] = self.parameterAsString(values, "OUTPUT", context)

    def outputs_of(self, result, arguments, context) -> dict:
        """Return where the photos or the video are."""
        return {"OUTPUT": arguments["output"], "SOURCE": result["source"], "GSD_M": result["gsd_m_per_px"]}


def _ground(algorithm, values, context) -> str:
    found = raster("GROUND", "", tr("Imagery to fly over"), optional=True).read(algorithm, values, context)
    if found == "procedural":  # the engine's word for the made scene
        raise QgsProcessingException(tr("Give the imagery another name than “procedural”."))
    return found or "procedural"
