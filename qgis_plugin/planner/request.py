"""What is asked of the planner, as a value: from the form's fields to the arguments of the engine's job ``plan``.

No Qt here: what a field means to ``photomap plan`` is tested without QGIS.
"""

from __future__ import annotations

from dataclasses import dataclass

SURVEY, CROSSHATCH, CORRIDOR = "survey", "crosshatch", "corridor"
FROM_DATUM = ("expanding-square", "sector", "spiral", "orbit")
FROM_AREA = ("parallel", "creeping", "perimeter")
FROM_LINE = ("trackline",)
SEARCHES = (*FROM_DATUM, *FROM_AREA, *FROM_LINE)
NEED_A_LINE = (CORRIDOR, *FROM_LINE)


@dataclass(frozen=True)
class Camera:
    """A known camera by its name, or one by numbers where ``name`` is empty.

    ``fov_deg`` is the horizontal field of view; a known camera that takes several lenses needs it too.
    """

    name: str = ""
    fov_deg: float | None = None
    width_px: int | None = None
    height_px: int | None = None


@dataclass(frozen=True)
class PlanRequest:
    """A flight as it is wished. Empty strings and ``None`` leave a thing to the planner.

    ``area`` and ``avoid`` are GeoJSON files in WGS 84. Exactly one of ``target``, ``gsd_m`` (metres a pixel) and
    ``height_m`` (above ground) says how fine to look.
    """

    pattern: str = SURVEY
    area: str = ""
    avoid: str = ""
    camera: Camera = Camera()
    target: str = "card"
    gsd_m: float | None = None
    height_m: float | None = None
    front_overlap_percent: float = 80.0
    side_overlap_percent: float = 65.0
    speed_m_s: float = 10.0
    wind_m_s: float = 0.0
    wind_from_deg: float = 0.0
    endurance_min: float | None = None
    home_lat_lon: tuple[float, float] | None = None
    datum_lat_lon: tuple[float, float] | None = None
    radius_m: float = 300.0
    corridor_width_m: float = 50.0
    angle_deg: float | None = None
    inset: bool = False
    transit_height_m: float | None = None
    lands: bool = False
    dem: str = ""
    dem_vertical: str = ""
    geoid_m: float | None = None
    autopilot: str = "ardupilot"

    @property
    def missing(self) -> str:
        """What must still be given before anything can be planned: ``area``, ``line``, ``datum`` or nothing."""
        if self.pattern in FROM_DATUM:
            return "" if self.datum_lat_lon is not None else "datum"
        if self.area:
            return ""
        return "line" if self.pattern in NEED_A_LINE else "area"

    def arguments(self, *, output: str = "", drawing: str = "") -> dict[str, object]:
        """Return the job's arguments by the names of ``photomap plan``'s parameters."""
        found: dict[str, object] = {"autopilot": self.autopilot, "speed": self.speed_m_s}
        if self.pattern in SEARCHES:
            found |= self._of_search()
        else:
            found |= self._of_survey()
        found |= self._of_camera() | self._of_terrain()
        if self.area and self.pattern not in FROM_DATUM:
            found["area"] = self.area
        if self.avoid:
            found["avoid"] = [self.avoid]
        if self.wind_m_s > 0:
            found["wind"] = f"{self.wind_m_s:g},{self.wind_from_deg:g}"
        if self.endurance_min:
            found["endurance_min"] = self.endurance_min
        if self.home_lat_lon is not None:
            found["home"] = _place(self.home_lat_lon)
        if self.transit_height_m:
            found["transit_height"] = self.transit_height_m
        if self.lands:
            found["end"] = "land"
        if output:
            found["output"] = output
        if drawing:
            found["drawing"] = drawing
        return found

    def _of_survey(self) -> dict[str, object]:
        found: dict[str, object] = {
            "front_overlap": self.front_overlap_percent,
            "side_overlap": self.side_overlap_percent,
        }
        if self.pattern == CROSSHATCH:
            found["crosshatch"] = True
        if self.pattern == CORRIDOR:
            found["corridor_width"] = self.corridor_width_m
        elif self.angle_deg is not None:
            found["angle"] = self.angle_deg
        if self.inset:
            found["inset"] = True
        return found

    def _of_search(self) -> dict[str, object]:
        found: dict[str, object] = {"pattern": self.pattern}
        if self.pattern in FROM_DATUM and self.datum_lat_lon is not None:
            found |= {"datum": _place(self.datum_lat_lon), "radius": self.radius_m}
        if self.angle_deg is not None:
            found["first_leg"] = self.angle_deg
        return found

    def _of_camera(self) -> dict[str, object]:
        found: dict[str, object] = {}
        if self.camera.name:
            found["camera"] = self.camera.name
        elif self.camera.width_px and self.camera.height_px:
            found |= {"image_width": self.camera.width_px, "image_height": self.camera.height_px}
        if self.camera.fov_deg is not None:
            found["fov_deg"] = self.camera.fov_deg
        if self.height_m is not None:
            found["height"] = self.height_m
        elif self.gsd_m is not None:
            found["gsd"] = f"{self.gsd_m:.6g}m"
        else:
            found["target"] = self.target
        return found

    def _of_terrain(self) -> dict[str, object]:
        if not self.dem:
            return {}
        found: dict[str, object] = {"dem": self.dem}
        if self.dem_vertical:
            found["dem_vertical"] = self.dem_vertical
        if self.geoid_m is not None:
            found["geoid_m"] = self.geoid_m
        return found


def _place(lat_lon: tuple[float, float]) -> str:
    return f"{lat_lon[0]:.8f},{lat_lon[1]:.8f}"
