"""The options of searches, of terrain and of plan files, for every command that plans a flight."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photomap_gis.core.errors import UsageError
from photomap_gis.core.mission import Autopilot, RallyPoint
from photomap_gis.core.plan import AltitudeFrame

if TYPE_CHECKING:
    from photomap_gis.mission_planner.optics import Optics
    from photomap_gis.pipeline.search import SearchRequest, TerrainRequest

F = TypeVar("F", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """A number within bounds: ``nan`` and ``inf``, which slip through comparisons, are none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


PATTERNS = ("expanding-square", "sector", "parallel", "creeping", "trackline", "spiral", "orbit", "perimeter")
FORMATS = ("plan", "waypoints", "kml", "kmz", "geojson", "gpx", "csv", "wpml")

# fmt: off
_SEARCH = (
    click.option("--pattern", type=click.Choice(PATTERNS),
                 help="Search pattern (IAMSAR): expanding-square (SS), sector (VS), parallel (PS), creeping (CS), "
                      "trackline (TSR); spiral, orbit, perimeter."),
    click.option("--datum", metavar="LAT,LON", help="Where expanding-square, sector, spiral and orbit begin."),
    click.option("--radius", type=FiniteRange(0.1, 200_000), metavar="M",
                 help="How far from the datum to search; an orbit's radius."),
    click.option("--sweep-width", type=FiniteRange(0.01, 100_000), metavar="M",
                 help="Width in which as much is found as is missed outside; default: the camera's swath."),
    click.option("--track-spacing", type=FiniteRange(0.01, 100_000), metavar="M",
                 help="Between tracks; default: sweep width / C."),
    click.option("--coverage-factor", type=FiniteRange(0.01, 100), default=1.0, show_default=True, metavar="C",
                 help="Sweep width over track spacing."),
    click.option("--first-leg", type=FiniteRange(-360, 360), metavar="DEG",
                 help="Heading of the first leg, clockwise from north: down-drift. Of the legs of parallel, creeping."),
    click.option("--passes", type=click.IntRange(1, 100), default=1, show_default=True,
                 help="Sector: 1 or 2; orbit: circles; perimeter: rings; trackline: tracks to each side."),
)
_TERRAIN = (
    click.option("--dem", type=click.Path(path_type=Path), metavar="FILE",
                 help="Elevation model (GeoTIFF, any CRS): keep the height above the ground that is there."),
    click.option("--dem-vertical", type=click.Choice(["egm96", "egm2008", "msl", "ellipsoid"]),
                 help="What the model's heights are above, where the file does not say."),
    click.option("--geoid-m", type=FiniteRange(-150, 150), metavar="M",
                 help="Height of the geoid above the ellipsoid, for models above the ellipsoid."),
    click.option("--terrain-tolerance", type=FiniteRange(0.01, 1000), metavar="M",
                 help="How far height above ground may be off; default: 5 % of it, at least 1 m."),
    click.option("--climb", type=FiniteRange(0.05, 50), default=3.0, show_default=True, metavar="M/S",
                 help="Fastest climb."),
    click.option("--descent", type=FiniteRange(0.05, 50), default=1.5, show_default=True, metavar="M/S",
                 help="Fastest descent."),
    click.option("--altitude-frame", type=click.Choice([f.value for f in AltitudeFrame]),
                 help="What altitudes are above; default: relative (the take-off place). PX4 has no terrain."),
)
_FILES = (
    click.option("--format", "file_format", type=click.Choice(FORMATS),
                 help="Of the output; default: by its suffix (.plan .waypoints .kml .kmz .geojson .gpx .csv, "
                      ".wpml.kmz for DJI)."),
    click.option("--autopilot", type=click.Choice([a.value for a in Autopilot]), default=Autopilot.ARDUPILOT.value,
                 show_default=True, help="Whose commands .plan and .waypoints hold."),
    click.option("--rally", multiple=True, metavar="LAT,LON,M", help="A rally point, metres above home; may repeat."),
    click.option("--fence-margin", type=FiniteRange(1, 10_000), default=50.0, show_default=True, metavar="M",
                 help="Room between the flight and its fence."),
)
# fmt: on


def search_options(function: F) -> F:
    """Add the options of a search pattern; ``search_request`` reads them."""
    return _added(function, _SEARCH)


def terrain_options(function: F) -> F:
    """Add the options of terrain following; ``terrain_request`` reads them."""
    return _added(function, _TERRAIN)


def file_options(function: F) -> F:
    """Add the options of plan files; ``write_files`` reads them."""
    return _added(function, _FILES)


def _added(function: F, options: tuple[Callable[[F], F], ...]) -> F:
    for option in reversed(options):
        function = option(function)
    return function


def search_request(
    chosen: Mapping[str, Any],
    optics: Optics,
    *,
    height_m: float,
    target_m: float | None,
    front_overlap: float | None,
    least_interval_s: float,
) -> SearchRequest:
    """Return what the search options ask for; ``front_overlap`` is a share, None for a search's own."""
    from photomap_gis.mission_planner.patterns import Pattern
    from photomap_gis.pipeline.search import SEARCH_OVERLAP, SearchRequest

    return SearchRequest(
        pattern=Pattern(chosen["pattern"]),
        optics=optics,
        height_m=height_m,
        target_m=target_m,
        radius_m=chosen["radius"],
        track_spacing_m=chosen["track_spacing"],
        sweep_width_m=chosen["sweep_width"],
        coverage_factor=chosen["coverage_factor"],
        heading_deg=chosen["first_leg"],
        passes=chosen["passes"],
        trigger=chosen["trigger"],
        front_overlap=SEARCH_OVERLAP if front_overlap is None else front_overlap,
        least_interval_s=least_interval_s,
    )


def terrain_request(chosen: Mapping[str, Any], height_m: float) -> TerrainRequest | None:
    """Return what the terrain options ask for, None for heights above the take-off place without a model.

    Raises ``UsageError`` for heights above the sea without a model, since nothing is known of them.
    """
    frame = AltitudeFrame(chosen["altitude_frame"] or "relative")
    if chosen["dem"] is None and frame is AltitudeFrame.RELATIVE:
        return None
    if chosen["dem"] is None and frame is AltitudeFrame.AMSL:
        raise UsageError(
            "--altitude-frame amsl needs --dem FILE: without the ground's height nothing is known but heights above "
            "the take-off place"
        )
    from photomap_gis.mission_planner.terrain import FollowSettings, VerticalDatum
    from photomap_gis.pipeline.search import TerrainRequest

    tolerance = chosen["terrain_tolerance"]
    if tolerance is not None and not 0 < tolerance <= height_m / 2:
        most = height_m / 2
        raise UsageError(f"--terrain-tolerance must lie in 0 to half the height ({most:.0f} m), got {tolerance:g}")
    settings = FollowSettings(
        tolerance_m=max(0.05 * height_m, 1.0) if tolerance is None else tolerance,
        climb_m_s=chosen["climb"],
        descent_m_s=chosen["descent"],
        geoid_m=chosen["geoid_m"],
    )
    vertical = chosen["dem_vertical"]
    return TerrainRequest(chosen["dem"], settings, VerticalDatum(vertical) if vertical else None, frame)


def rally_points(texts: tuple[str, ...]) -> tuple[RallyPoint, ...]:
    """Return the points of ``--rally``."""
    found = []
    for text in texts:
        numbers = _numbers(text, 3, "--rally LAT,LON,M")
        lat, lon = lat_lon(",".join(text.split(",")[:2]), "--rally")
        found.append(RallyPoint(lat, lon, round(numbers[2], 2)))
    return tuple(found)


def lat_lon(text: str, option: str) -> tuple[float, float]:
    """Return a place in degrees. Raises ``UsageError`` where it is none."""
    lat, lon = _numbers(text, 2, f"{option} LAT,LON")
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise UsageError(f"{option}: {text} is no place on Earth: latitude first, in degrees")
    return lat, lon


def _numbers(text: str, count: int, what: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(n) < 1e9 for n in numbers):
        raise UsageError(f"{what}: {text!r} is not {count} numbers with commas between them")
    return numbers
