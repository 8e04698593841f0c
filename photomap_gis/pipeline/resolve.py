"""A mission solved again from its journals: with other ground control, places picked on the map, moved by hand.

Nothing is registered again. The pictures are read once more, to draw the map where it lies now.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from photomap_gis.core.control import ControlPoint, Nudge, Sighting
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.elevation import open_dem
from photomap_gis.georef import crs_to_lonlat, fix_to_map, map_to_lonlat, plane_view
from photomap_gis.pipeline.align import aligned
from photomap_gis.pipeline.control import ControlRequest, checks_of, keep_control, keep_request, read_request
from photomap_gis.pipeline.flight import StageClock, finish, settle
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import keep_dem, keep_drawing, kept_settings
from photomap_gis.pipeline.prepare import SpectrumShelf
from photomap_gis.pipeline.reference import take_references
from photomap_gis.pipeline.settings import Drawing, MapSettings, Progress
from photomap_gis.pipeline.solve import solve_mission
from photomap_gis.pipeline.solved import PASTED, Solved
from photomap_gis.pipeline.summary import MapSummary
from photomap_gis.store import ControlRecord, Mission

PICK_SIGMA_M = 0.5
PICK_SIGMA_PX = 2.0
"""One sigma per axis of a place picked by hand: on the reference map, and on ours."""
PICTURES_A_PICK = 3
MIN_PICKS_APART_PX = 10.0
WGS84 = "EPSG:4326"


@dataclass(frozen=True, slots=True)
class Pick:
    """A place picked on the map, in the units of its CRS (x right or east, y up or north), and where it is in truth.

    A pick for the ``check`` tests the map: it has no part in the fit.
    """

    x: float
    y: float
    lat_deg: float
    lon_deg: float
    check: bool = False


def solve_again(
    folder: Path,
    control: ControlRequest | None = None,
    *,
    drawing: Drawing | None = None,
    dem: Path | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Solve a finished mission again from its journals, draw and export its map, and return what there is to tell.

    Ground control that is asked for takes the place of what the mission has of it; without it that holds; likewise how
    the map is drawn. ``dem`` is a file of the ground's heights, kept in the mission too. Where nothing could be placed,
    the mission is left as it was. Raises ``PhotomapError`` children.
    """
    read_request(control)
    if dem is not None:
        open_dem(dem)  # is it one?

    def change(mission: Mission, solved: Solved, settings: MapSettings) -> None:
        keep_request(mission, control, solved.frames, settings.crs)
        keep_dem(mission, None if dem is None else str(dem.absolute()))

    return _solved_after(change, folder, on_progress, drawing or Drawing())


def georeference(
    folder: Path,
    *,
    picks: Sequence[Pick] = (),
    nudge: tuple[float, float, float] | None = None,
    piece: int = 1,
    reset: bool = False,
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Give a mission's map its place by picks, or move it by hand; then solve, draw and export it again.

    ``nudge`` is metres east, metres north, degrees clockwise about the map's middle, on top of earlier ones. ``piece``
    counts the maps of a mission without a place (``map-1.tif``, ...). ``reset`` first forgets earlier picks and nudges.
    Picks make earlier nudges void. Raises ``PhotomapError`` children.
    """
    if not (picks or nudge or reset):
        raise UsageError("say where the map lies: --pick X,Y=LAT,LON (two or more), or --nudge EAST,NORTH[,DEG]")
    if picks and nudge:
        raise UsageError("--pick and --nudge go one after the other: pick first, look at the map, then nudge")

    def change(mission: Mission, solved: Solved, settings: MapSettings) -> None:
        kept = mission.load_control()
        if reset:
            kept = replace(kept, picks=(), nudges=(), check_picks=())
        if picks:
            kept = _with_picks(kept, picks, solved, settings, piece)
        if nudge is not None:
            if not solved.georeferenced:
                raise UsageError("a map without a place on Earth cannot be nudged: give it one by --pick or --gcp")
            lon, lat = _middle(solved)
            kept = replace(kept, nudges=(*kept.nudges, Nudge(*nudge, pivot_lat_deg=lat, pivot_lon_deg=lon)))
        keep_control(mission, kept, solved.frames, settings.crs)

    return _solved_after(change, folder, on_progress)


def reference_mission(
    folder: Path,
    references: Sequence[Path],
    *,
    sigma_m: float | None = None,
    workers: int | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Lay a finished mission on existing imagery, draw and export its map, and return what there is to tell.

    Its frames are read once more to be found in the imagery, and none is registered to another again. ``sigma_m`` is
    the imagery's own constant error per axis (``None``: one of its pixels). Raises ``PhotomapError`` children.
    """
    clock = StageClock()
    with Mission.open(folder) as mission:
        before, settings = Solved.load(mission), replace(kept_settings(mission), workers=workers)
        frames = before.frames
        prepared = {p.frame: p for p in mission.prepared}
        if any(f.index not in prepared for f in frames):
            raise DataError(f"{folder} is not finished: run 'photomap map' on its sources again first")
        _check_sources(mission, frames)
        views = {f.index: plane_view(f) for f in frames}
        frames = aligned(mission, frames, before.track_shifts_s)
        measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
        measurements.take_kept()
        shifts_s = before.track_shifts_s
        solve = partial(solve_mission, mission, frames, views, measurements, settings, shifts_s=shifts_s)
        with clock("solve"):
            solved = solve()
        with clock("reference"):
            solved = take_references(mission, solved, solve, references, sigma_m=sigma_m, on_progress=on_progress)
        with clock("solve"):
            solved = settle(mission, frames, views, measurements, settings, solved)
        return finish(mission, solved, measurements, settings, clock, on_progress)


def _solved_after(
    change: Callable[[Mission, Solved, MapSettings], None],
    folder: Path,
    on_progress: Progress,
    drawing: Drawing = Drawing(),  # noqa: B008  (frozen)
) -> MapSummary:
    """Change a mission's ground control and finish it anew; where nothing can be placed, leave it as it was."""
    clock = StageClock()
    with Mission.open(folder) as mission:
        before, settings = Solved.load(mission), drawing.applied_to(kept_settings(mission))
        frames = before.frames
        prepared = {p.frame: p for p in mission.prepared}
        if any(f.index not in prepared for f in frames):
            raise DataError(f"{folder} is not finished: run 'photomap map' on its sources again first")
        _check_sources(mission, frames)
        header, control = mission.header, mission.load_control()
        views = {f.index: plane_view(f) for f in frames}
        frames = aligned(mission, frames, before.track_shifts_s)
        measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
        measurements.take_kept()
        with clock("solve"):
            try:
                change(mission, before, settings)
                settings = drawing.applied_to(kept_settings(mission))
                solved = solve_mission(mission, frames, views, measurements, settings, shifts_s=before.track_shifts_s)
                solved = settle(mission, frames, views, measurements, settings, solved)
                if not solved.segment_numbers:
                    raise DataError("nothing could be placed by what was given; the mission is left as it was")
            except Exception:
                mission.save_control(control)
                mission.save_header(header)
                raise
        kept = mission.load_control()
        if kept.nudges and (kept.points or kept.picks):
            word = "the map is nudged by hand on top of its control points: 'photomap georeference --reset' drops that"
            solved = replace(solved, warnings=(*solved.warnings, word))
        settings = keep_drawing(mission, settings)
        return finish(mission, solved, measurements, settings, clock, on_progress)


def _with_picks(
    control: ControlRecord, picks: Sequence[Pick], solved: Solved, settings: MapSettings, piece: int
) -> ControlRecord:
    """Return the ground control with picks: each is a point that the pictures which show it there have seen."""
    trajectory, map_frame = solved.trajectory, solved.map_frame
    if not solved.georeferenced:
        numbers = solved.segment_numbers
        if not 1 <= piece <= len(numbers):
            raise UsageError(f"--piece {piece}: the mission has {len(numbers)} piece(s), map-1.tif is the first")
        trajectory = trajectory.segment(numbers[piece - 1])
    at = np.array([(p.x, p.y) for p in picks])
    if solved.georeferenced and settings.crs is not None:
        lonlat = crs_to_lonlat(settings.crs, at)
        xy = fix_to_map(map_frame, lonlat[:, 1], lonlat[:, 0])
    else:
        xy = (map_frame if solved.georeferenced else MapFrame(None)).from_crs(at)
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1)) + np.diag(np.full(len(xy), np.inf))
    if apart.min() < MIN_PICKS_APART_PX * trajectory.gsd_m_per_px:
        raise UsageError("two picks lie at the same place of the map: pick places far apart")
    names = {p.name for p in (*control.points, *control.picks)}
    fresh = {False: _names("pick", names), True: _names("check", names)}
    added = tuple(
        ControlPoint(
            next(fresh[p.check]), WGS84, p.lon_deg, p.lat_deg,
            sigma_m=PICK_SIGMA_M, sightings=_seen_at(trajectory, place, p),
        )
        for p, place in zip(picks, xy, strict=True)
    )  # fmt: skip
    checks = (point.name for p, point in zip(picks, added, strict=True) if p.check)
    control = replace(control, picks=(*control.picks, *added), nudges=(), check_picks=(*control.check_picks, *checks))
    if not solved.georeferenced and len(control.picks) + len(control.points) - len(checks_of(control)) < 2:
        raise UsageError("one pick cannot place a map: give two or more --pick X,Y=LAT,LON, far apart")
    return control


def _names(word: str, taken: set[str]) -> Iterator[str]:
    return (f"{word}-{n}" for n in count(1) if f"{word}-{n}" not in taken)


def _seen_at(trajectory: Trajectory, xy_map: FloatArray, pick: Pick) -> tuple[Sighting, ...]:
    """Return which pictures show a place of the map, and where in them: those that have it nearest their middle."""
    found = []
    for p in trajectory.placements:
        if p.status not in PASTED:
            continue
        px = p.camera_to_map.unproject(xy_map[None])[0]
        off = float(np.abs((px - p.centre_xy_px[0]) / (p.width_px, p.height_px)).max())
        if off <= 0.5:
            found.append((off, p.frame, Sighting(f"#{p.frame}", (float(px[0]), float(px[1])), PICK_SIGMA_PX)))
    if not found:
        option = "--check-pick" if pick.check else "--pick"
        raise UsageError(
            f"{option} {pick.x:g},{pick.y:g} is not on the map: X,Y are coordinates as a GIS shows them on map.tif"
        )
    return tuple(s for _, _, s in sorted(found, key=lambda f: f[:2])[:PICTURES_A_PICK])


def _middle(solved: Solved) -> tuple[float, float]:
    """Longitude and latitude of the middle of the placed frames."""
    centres = np.array([p.centre_xy_map_m for p in solved.trajectory.placements if p.status in PASTED])
    lon, lat = map_to_lonlat(solved.map_frame, (centres.min(axis=0) + centres.max(axis=0)) / 2.0)[0].tolist()
    return lon, lat


def _check_sources(mission: Mission, frames: Sequence[FrameRef]) -> None:
    """Raise ``DataError`` where pictures that the map is drawn from are gone."""
    gone = [
        f.source
        for f in frames
        if f.problem is None
        and not Path(f.source).exists()
        and not (f.frame_number is not None and mission.video_frame_path(f.index).is_file())
    ]
    if gone:
        raise DataError(
            f"{len(gone)} of {len(frames)} pictures are no longer where they were ({gone[0]}, ...): "
            "the map is drawn from them, so bring them back first"
        )
