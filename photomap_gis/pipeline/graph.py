"""A mission's pose graph, taken from its journals again, for other programs and for the eye."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.export import SolvedGraph, write_g2o, write_graph_geojson, write_graph_picture
from photomap_gis.georef import plane_view
from photomap_gis.pipeline.align import aligned
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.pipeline.solve import FLAT, graph_builder, leanings_of, observe_control, settled_view
from photomap_gis.slam import edge_misfits, slopes_of_frames, solve
from photomap_gis.store import Mission

_WRITERS: dict[str, Callable[[SolvedGraph, Path], None]] = {
    ".png": write_graph_picture,
    ".geojson": write_graph_geojson,
    ".g2o": write_g2o,
}
DEFAULT_NAME = "graph.png"


def export_graph(
    folder: Path, out: Path | None = None, *, on_progress: Progress = lambda stage, done, total: None
) -> Path:
    """Write a mission's pose graph as the name of ``out`` says (.png, .geojson, .g2o) and return the file."""
    path = folder / DEFAULT_NAME if out is None else out
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise UsageError(f"-o {path} must end in {', '.join(_WRITERS)}: the ending says the format")
    with Mission.open(folder) as mission:
        solved = solved_graph(mission, on_progress)
    writer(solved, path)
    return path


def solved_graph(mission: Mission, on_progress: Progress) -> SolvedGraph:
    """Solve a mission's graph with its loops and without; ``DataError`` where it has no registration."""
    prepared = {p.frame: p for p in mission.prepared}
    frames = [f for f in mission.frames if f.index in prepared and prepared[f.index].usable]
    taken = frames  # as they were registered
    shifts_s = mission.load_solution().summary.get("track_shifts_s", {})
    frames = list(aligned(mission, frames, {int(flight): float(shift) for flight, shift in shifts_s.items()}))
    known = {f.index for f in frames}
    # a failure after a success does not undo it
    newest = {(min(r.a, r.b), max(r.a, r.b)): r for r in mission.registrations if r.accepted}
    accepted = [r for r in newest.values() if {r.a, r.b} <= known]
    if not accepted:
        raise DataError(f"{mission.folder} holds no registration yet: run 'photomap map' on its sources again")
    leanings = leanings_of({f.index: f for f in frames}, accepted, prepared)
    settings = TypeAdapter(MapSettings).validate_python(mission.header.settings)
    map_frame = mission.header.map_frame
    builder = graph_builder(frames, accepted, prepared, map_frame, leanings, antenna_offset_m=settings.antenna_offset_m)
    slopes = slopes_of_frames(builder.snapshot().edges)
    tilts = {f: leaning.tilt_rad for f, leaning in leanings.items()}
    views = {f.index: settled_view(plane_view(f), tilts.get(f.index, FLAT), slopes.get(f.index, FLAT)) for f in taken}
    observe_control(builder, mission, frames, views, map_frame, accepted)
    graph = builder.snapshot()
    on_progress("solve", 0, 2)
    chain = replace(graph, edges=tuple(e for e in graph.edges if e.kind is EdgeKind.SEQUENTIAL))
    # without fixes: they would hide by how much the chain drifts
    sequential = solve(replace(chain, positions=(), scales=(), headings=(), points=()))
    on_progress("solve", 1, 2)
    solution = solve(graph, find_lag=settings.ingest.track_offset_s is None)
    on_progress("solve", 2, 2)
    names = {f.index: f.name for f in frames}
    return SolvedGraph(graph, solution, sequential, edge_misfits(graph, solution), map_frame, names)
