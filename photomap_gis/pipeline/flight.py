"""``map_flight``: the one place that knows the order of the stages."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from photomap_gis.core.errors import DataError
from photomap_gis.georef import plane_view
from photomap_gis.pipeline.deliver import deliver
from photomap_gis.pipeline.draw import draw_maps
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import kept_settings, open_mission
from photomap_gis.pipeline.prepare import SpectrumShelf, prepare_frames
from photomap_gis.pipeline.reference import take_references
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.pipeline.solve import Solved, solve_mission
from photomap_gis.pipeline.summary import MapSummary, ReferenceSummary
from photomap_gis.store import Mission


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
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Turn photos or videos into a mission folder with its map, and return what there is to tell about it.

    Frames are read and judged, registered each to its predecessor, solved with GPS, registered again wherever the
    solution says that they overlap, solved again, drawn and exported. With ``add`` the sources extend the mission in
    ``folder``; without it a mission of the same sources and settings is resumed. Raises ``PhotomapError`` children.
    """
    clock = StageClock()
    with clock("ingest"):
        mission, settings = open_mission(sources, folder, settings or MapSettings(), add=add, on_progress=on_progress)
    with mission:
        frames = tuple(mission.frames)
        views = {f.index: plane_view(f) for f in frames}
        with clock("read"):
            prepared = prepare_frames(mission, frames, views, settings, on_progress)
        measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
        with clock("register"):
            measurements.take_sequential(frames)
        # Ties to existing imagery come in last: until then a run goes its way as if there were none.
        with clock("solve"):
            solved = solve_mission(mission, frames, views, measurements, settings, references=())
        for more in (measurements.take_loops, measurements.take_missing):
            with clock("loops"):
                gained = more(solved.clusters(views))
            if gained:
                with clock("solve"):
                    solved = solve_mission(mission, frames, views, measurements, settings, references=())
        solve_again = partial(solve_mission, mission, frames, views, measurements, settings)
        with clock("reference"):
            solved = take_references(
                mission, solved, solve_again, [Path(r) for r in settings.references],
                sigma_m=settings.reference_sigma_m, on_progress=on_progress,
            )  # fmt: skip
        return finished(mission, solved, measurements, settings, clock, on_progress)


def reference_mission(
    folder: Path,
    references: Sequence[Path],
    *,
    sigma_m: float | None = None,
    workers: int | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> MapSummary:
    """Lay a mission that was mapped already on existing imagery: nothing is read or registered again.

    The map is solved with the new ties and drawn and exported anew.
    """
    clock = StageClock()
    with Mission.open(folder) as mission:
        settings = replace(kept_settings(mission), workers=workers)
        frames = tuple(mission.frames)
        views = {f.index: plane_view(f) for f in frames}
        prepared = {p.frame: p for p in mission.prepared}
        if any(f.index not in prepared for f in frames):
            raise DataError(f"{folder} was not mapped to the end: run 'photomap map' on its sources again first")
        measurements = Measurements(mission, SpectrumShelf(mission), prepared, settings, on_progress)
        measurements.take_recorded()
        solve_again = partial(solve_mission, mission, frames, views, measurements, settings)
        with clock("solve"):
            solved = solve_again()
        with clock("reference"):
            solved = take_references(mission, solved, solve_again, references, sigma_m=sigma_m, on_progress=on_progress)
        return finished(mission, solved, measurements, settings, clock, on_progress)


def finished(
    mission: Mission,
    solved: Solved,
    measurements: Measurements,
    settings: MapSettings,
    clock: StageClock,
    on_progress: Progress,
) -> MapSummary:
    """Keep a solution, draw its map, write the files that every run leaves, and tell what there is to tell."""
    folder = mission.folder
    with clock("solve"):
        solved.save(mission)
    with clock("render"):
        maps = draw_maps(mission, solved, settings, on_progress)
    with clock("export"):
        outputs = deliver(mission, solved, maps, on_progress)
    first = maps[0]
    return MapSummary(
        mission=str(folder),
        map=str(folder / "map.tif"),
        crs=solved.crs_name(settings.crs),
        georeferenced=solved.georeferenced,
        gsd_m_per_px=first.store.grid.pixel_size,
        area_m2=first.area if solved.georeferenced else None,
        bounds=first.store.grid.bounds,
        frames={"total": len(solved.frames), **solved.count_by_status()},
        registrations=measurements.count_accepted(),
        segments=solved.segments,
        fit_to_gps_rms_m=solved.fit_to_gps_rms_m,
        predicted_ce90_m=solved.predicted_ce90_m,
        seconds=clock.seconds,
        warnings=(*mission.header.warnings, *solved.warnings),
        reasons=solved.count_reasons(),
        outputs=tuple(str(p) for p in outputs),
        references=tuple(ReferenceSummary.of(r) for r in mission.references),
    )
