"""``map_flight``: the one place that knows the order of the stages."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.posegraph import PointKind
from photomap_gis.georef import plane_view
from photomap_gis.parallel import check_scheduler
from photomap_gis.pipeline.align import aligned, track_shifts
from photomap_gis.pipeline.control import (
    ControlRequest,
    judge_points,
    keep_request,
    misses_its_points,
    moved,
    nudge_motion,
    read_request,
    words_on,
    words_on_checks,
)
from photomap_gis.pipeline.deliver import deliver
from photomap_gis.pipeline.draw import draw_maps
from photomap_gis.pipeline.in_space import solve_in_space
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import open_mission
from photomap_gis.pipeline.prepare import SpectrumShelf, prepare_frames
from photomap_gis.pipeline.reference import take_references
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.pipeline.solve import lag_warnings, solve_mission
from photomap_gis.pipeline.solved import Solved
from photomap_gis.pipeline.summary import MapSummary, ReferenceSummary
from photomap_gis.pipeline.terrain import terrain_under
from photomap_gis.store import ControlRecord, Mission

logger = logging.getLogger(__name__)

MORE_LOOPS = 3
"""So many times more, at most, loops are sought that a newer solution shows."""


class StageClock:
    """Adds up seconds a stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Count the block's time to a stage."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - started


def map_flight(
    sources: Sequence[str | Path],
    folder: Path,
    settings: MapSettings | None = None,
    *,
    add: bool = False,
    control: ControlRequest | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Turn photos or videos into a mission folder with its map, and return what there is to tell about it.

    Frames are read and judged, registered each to its predecessor, solved with GPS, registered again wherever the
    solution says that they overlap, solved again, drawn and exported. Ground control enters the last solution alone:
    what is registered does not hang on it, so that solving again with other points comes to the same map. With ``add``
    the sources extend the mission in ``folder``; without it a mission of the same sources and settings is resumed.
    Ground control that is asked for takes the place of what the mission has of it; without it that holds. Raises
    ``PhotomapError`` children.
    """
    clock = StageClock()
    read_request(control)
    if settings is not None and settings.scheduler is not None:
        check_scheduler(settings.scheduler)  # told before anyone waits
    with clock("ingest"):
        mission, settings = open_mission(
            sources, folder, settings or MapSettings(), add=add, on_progress=on_progress,
            with_control=control is not None and control.file is not None,
        )  # fmt: skip
    with mission:
        frames = tuple(mission.frames)
        keep_request(mission, control, frames, settings.crs)
        views = {f.index: plane_view(f) for f in frames}
        with clock("read"):
            prepared = prepare_frames(mission, frames, views, settings, on_progress)
        measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
        with clock("register"):
            measurements.take_sequential(frames)
        # Ground control and existing imagery come in last: until then a run goes its way as if there were none.
        with clock("solve"):
            shifts_s: dict[int, float] = {}
            if settings.ingest.track_offset_s is None:
                shifts_s = track_shifts(mission, frames, measurements.accepted, prepared)
                frames = aligned(mission, frames, shifts_s)
            solved = solve_mission(
                mission, frames, views, measurements, settings, with_control=False, shifts_s=shifts_s
            )
        rounds = (measurements.take_loops, measurements.take_missing, *[measurements.take_loops] * MORE_LOOPS)
        for n, more in enumerate(rounds):
            with clock("loops"):
                gained = more(solved.clusters(views))
            if gained:
                with clock("solve"):
                    solved = solve_mission(
                        mission, frames, views, measurements, settings, with_control=False, shifts_s=shifts_s
                    )
            elif n > 1:
                break  # a solution that is as it was shows nothing new
        solve = partial(solve_mission, mission, frames, views, measurements, settings, shifts_s=shifts_s)
        if mission.load_control() != ControlRecord():
            with clock("solve"):
                solved = solve()
        with clock("reference"):
            solved = take_references(
                mission, solved, solve, [Path(r) for r in settings.references],
                sigma_m=settings.reference_sigma_m, on_progress=on_progress,
            )  # fmt: skip
        with clock("solve"):
            solved = settle(mission, frames, views, measurements, settings, solved)
        return finish(mission, solved, measurements, settings, clock, on_progress)


def settle(
    mission: Mission,
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    measurements: Measurements,
    settings: MapSettings,
    solved: Solved,
) -> Solved:
    """Return the last solution posed in space, corrected by hand, and with what its known points make of it."""
    # Behind the control points lie the ties to imagery, which tell of themselves.
    points = [p for p in solved.points if p.kind is PointKind.CONTROL]
    rejected = () if solved.solution is None else solved.solution.rejected_points
    aside = {k for k in rejected if k < len(points)}
    flat = solved
    terrain, holes = None, list[str]()
    if settings.dem is not None and solved.georeferenced and solved.trajectory.placements:
        terrain, holes = terrain_under(Path(settings.dem), solved.trajectory, solved.map_frame)
    solved = solve_in_space(
        frames, views, measurements, solved, antenna_offset_m=settings.antenna_offset_m, terrain=terrain
    )
    on_flat, on_posed = (judge_points(points, aside, s.trajectory) for s in (flat, solved))
    if misses_its_points(on_posed, on_flat):
        logger.info("cameras posed in space miss the control points: the flat solution stands")
        solved = flat
    used_terrain = terrain is not None and solved is not flat
    nudges = mission.load_control().nudges
    if nudges and solved.georeferenced:
        motion = nudge_motion(nudges, solved.map_frame)
        solved = replace(solved, trajectory=moved(solved.trajectory, motion))
    results = judge_points(points, aside, solved.trajectory)
    names = {f.index: f.name for f in frames}
    words = holes + lag_warnings(mission, solved.fix_lags)
    words += words_on(results, points, sorted(aside), names)
    words += words_on_checks(points, solved.trajectory, names)
    if settings.dem is not None and not used_terrain:
        words.append("--dem was not used: it needs positions, a known lens, and cameras that could be posed in space")
    return replace(solved, control=results, warnings=(*solved.warnings, *words))


def finish(
    mission: Mission,
    solved: Solved,
    measurements: Measurements,
    settings: MapSettings,
    clock: StageClock,
    on_progress: Progress,
) -> MapSummary:
    """Keep a solution, draw and export its map, and return what there is to tell about it."""
    folder = mission.folder
    with clock("solve"):
        solved.save(mission)
    with clock("render"):
        maps = draw_maps(mission, solved, settings, on_progress)
    with clock("export"):
        outputs = deliver(mission, solved, maps, on_progress, layers=bool(settings.layers))
    first = maps[0]
    return MapSummary(
        mission=str(folder),
        map=str(folder / "map.tif"),
        crs=solved.crs_name(settings.crs),
        georeferenced=solved.georeferenced,
        gsd_m_per_px=first.gsd_m_per_px,
        area_m2=first.area if solved.georeferenced else None,
        bounds=first.store.grid.bounds,
        size_m=(first.store.grid.width * first.gsd_m_per_px, first.store.grid.height * first.gsd_m_per_px),
        frames={"total": len(solved.frames), **solved.count_by_status()},
        registrations=measurements.count_accepted(),
        segments=solved.segments,
        fit_to_gps_rms_m=solved.fit_to_gps_rms_m,
        predicted_ce90_m=solved.predicted_ce90_m,
        seconds=clock.seconds,
        warnings=(*mission.header.warnings, *solved.warnings),
        reasons=solved.count_reasons(),
        outputs=tuple(str(p) for p in outputs),
        track_lags=solved.track_lags({f.id: f.name for f in mission.flights}),
        references=tuple(ReferenceSummary.of(r) for r in mission.references),
        lenses=solved.lenses,
        control=solved.control,
        nudges=mission.load_control().nudges,
    )
