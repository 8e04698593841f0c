"""A plan in whatever format the file's name asks for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from photomap_gis.core.errors import UsageError
from photomap_gis.core.mission import Autopilot, RallyPoint
from photomap_gis.core.plan import SurveyPlan
from photomap_gis.mission_planner.files.dji import plan_wpml_kmz
from photomap_gis.mission_planner.files.geojson import plan_geojson
from photomap_gis.mission_planner.files.kml import plan_kml, plan_kmz
from photomap_gis.mission_planner.files.missions import write_mission
from photomap_gis.mission_planner.files.tables import plan_csv, plan_gpx
from photomap_gis.mission_planner.items import FENCE_MARGIN_M, to_mission
from photomap_gis.publish import write_file

PLAN_FORMATS = ("plan", "waypoints", "kml", "kmz", "geojson", "gpx", "csv", "wpml")
"""What ``write_plan`` can write: by these names, or by the suffix of the file (``.json`` is GeoJSON)."""

_ONE_FILE_A_SORTIE = {"plan", "waypoints", "wpml"}
_ALSO = {"wpl": "waypoints", "txt": "waypoints", "json": "geojson"}


def plan_format(path: Path | str, name: str | None = None) -> str:
    """Return the format that a name, or else the path's suffix, asks for (``x.wpml.kmz`` is DJI's).

    Raises ``UsageError`` where there is no such format.
    """
    path = Path(path)
    if name is None:
        suffixes = [s.lower() for s in path.suffixes[-2:]]
        name = "wpml" if suffixes == [".wpml", ".kmz"] else path.suffix.lower().lstrip(".").replace("wpml", "")
    name = _ALSO.get(name.lower(), name.lower())
    if name not in PLAN_FORMATS:
        raise UsageError(
            f"{path.name}: a plan is written as {', '.join('.' + f for f in PLAN_FORMATS if f != 'wpml')}, "
            "or .wpml.kmz for DJI (or say which with --format)"
        )
    return name


def write_plan(
    path: Path | str,
    plan: SurveyPlan,
    *,
    file_format: str | None = None,
    autopilot: Autopilot = Autopilot.ARDUPILOT,
    rally: Sequence[RallyPoint] = (),
    fence_margin_m: float = FENCE_MARGIN_M,
) -> list[Path]:
    """Write a plan and return the files written.

    Several sorties become ``name-1``, ``name-2``, ... where the format holds one flight (missions, DJI), else one file
    holds all. Every file is written whole or not at all. Raises ``UsageError`` for a format that is not known or that
    cannot say what the plan holds, ``OutputError`` where the disk refuses.
    """
    path = Path(path)
    form = plan_format(path, file_format)
    if form in _ONE_FILE_A_SORTIE:
        paths = _paths(path, len(plan.sorties), form)
        if form == "wpml":
            archives = [plan_wpml_kmz(plan, i) for i in range(len(plan.sorties))]
            for each, archive in zip(paths, archives, strict=True):
                write_file(each, archive)
            return paths
        missions = [
            to_mission(plan, i, autopilot, rally=rally, fence_margin_m=fence_margin_m) for i in range(len(plan.sorties))
        ]
        for each, mission in zip(paths, missions, strict=True):
            write_mission(each, mission, file_format=form)
        return paths
    write_file(path, _whole(plan, form, path.stem))
    return [path]


def _whole(plan: SurveyPlan, form: str, name: str) -> bytes:
    if form == "kmz":
        return plan_kmz(plan, name)
    if form == "kml":
        return plan_kml(plan, name).encode()
    if form == "geojson":
        return plan_geojson(plan).encode()
    return (plan_csv(plan) if form == "csv" else plan_gpx(plan, name)).encode()


def _paths(path: Path, sorties: int, form: str) -> list[Path]:
    if sorties < 2:
        return [path]
    ending = "".join(path.suffixes[-2:]) if form == "wpml" and path.suffixes[-2:-1] == [".wpml"] else path.suffix
    stem = path.name.removesuffix(ending)
    return [path.with_name(f"{stem}-{i}{ending}") for i in range(1, sorties + 1)]
