"""Opening a mission: made from sources, resumed where a run was stopped, or extended by more sources."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter

from photomap_gis import __version__
from photomap_gis.core.errors import UsageError
from photomap_gis.core.frame import Footage
from photomap_gis.core.grid import MapFrame
from photomap_gis.elevation import open_dem
from photomap_gis.georef import choose_map_frame, resolve_crs
from photomap_gis.ingest import open_sources
from photomap_gis.pipeline.add_track import add_track, lend_positions, split_tracks
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.reference import ReferenceImage
from photomap_gis.store import Mission, MissionHeader

_SETTINGS = TypeAdapter(MapSettings)


def open_mission(
    sources: Sequence[str | Path],
    folder: Path,
    settings: MapSettings,
    *,
    add: bool,
    on_progress: Progress,
    with_control: bool = False,
) -> tuple[Mission, MapSettings]:
    """Return the mission in ``folder`` and the settings that hold for it.

    A folder that holds a mission of the same sources and settings is resumed; of others it is a ``UsageError``.
    ``with_control`` says that ground control will give a map without positions its place; existing imagery may too.
    """
    if settings.crs is not None:
        resolve_crs(settings.crs)  # a wrong name is told before anyone waits
    for reference in settings.references:
        with ReferenceImage(Path(reference)):
            pass  # so is a file that cannot be used
    if settings.dem is not None:
        open_dem(Path(settings.dem))  # is it one?
    with_control = with_control or bool(settings.references)
    look = partial(on_progress, "look")
    if add:
        mission = Mission.open(folder)
        known = kept_settings(mission)
        settings = replace(settings, crs=settings.crs or known.crs, work_size_px=known.work_size_px,
                           antenna_offset_m=settings.antenna_offset_m if any(settings.antenna_offset_m)
                           else known.antenna_offset_m, dem=settings.dem or known.dem)  # fmt: skip
        keep_dem(mission, settings.dem)
        pictures, tracks = split_tracks(sources)
        if pictures:
            known_flights = {f.id for f in mission.flights}
            _extend(mission, pictures, settings, look, with_control or bool(mission.load_control().points))
            lend_positions(mission, [f for f in mission.flights if f.id not in known_flights], settings, on_progress)
        for track in tracks:
            add_track(mission, track, settings, on_progress)
        return mission, keep_drawing(mission, settings)
    names = tuple(str(Path(s).absolute()) for s in sources)
    if Mission.exists(folder):
        mission = Mission.open(folder)
        if mission.header.sources[: len(names)] != names or _shaping(mission.header.settings) != _shaping(
            _SETTINGS.dump_python(settings, mode="json")
        ):
            raise UsageError(
                f"{folder} holds a mission of other sources or settings: extend it by --add, "
                "or choose another folder by -o"
            )
        settings = replace(settings, dem=settings.dem or kept_settings(mission).dem)
        keep_dem(mission, settings.dem)
        return mission, keep_drawing(mission, settings)
    footage = open_sources(sources, settings.ingest, on_progress=look)
    header = MissionHeader(
        sources=names,
        settings=_SETTINGS.dump_python(replace(settings, scheduler=None), mode="json"),  # a scheduler is of one run
        map_frame=_map_frame(footage, settings, with_control=with_control),
        created_utc=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        product=f"photomap {__version__}",
        warnings=footage.warnings,
    )
    return Mission.create(folder, header, footage), settings


def kept_settings(mission: Mission) -> MapSettings:
    """Return the settings that a mission was made with."""
    return _SETTINGS.validate_python(mission.header.settings)


def keep_drawing(mission: Mission, settings: MapSettings) -> MapSettings:
    """Have the mission keep how its map is drawn, and return the settings; what they leave open is as it was."""
    known = kept_settings(mission)
    prefer = known.prefer if settings.prefer is None else settings.prefer
    layers = known.layers if settings.layers is None else settings.layers
    if (prefer, layers) != (known.prefer, known.layers):
        kept = _SETTINGS.dump_python(replace(known, prefer=prefer, layers=layers), mode="json")
        mission.save_header(replace(mission.header, settings=kept))
    return replace(settings, prefer=prefer, layers=layers)


def keep_dem(mission: Mission, dem: str | None) -> None:
    """Write down the ground's heights by which a mission is solved from now on; ``None`` changes nothing."""
    if dem is not None and dem != kept_settings(mission).dem:
        mission.save_header(replace(mission.header, settings={**mission.header.settings, "dem": dem}))


def _extend(
    mission: Mission,
    sources: Sequence[str | Path],
    settings: MapSettings,
    look: Callable[[int, int], None],
    with_control: bool,
) -> None:
    frames, flights = tuple(mission.frames), tuple(mission.flights)
    footage = open_sources(
        sources,
        settings.ingest,
        first_index=1 + max((f.index for f in frames), default=-1),
        first_flight=1 + max((f.id for f in flights), default=-1),
        on_progress=look,
    )
    known = {(f.source, f.frame_number) for f in frames}
    fresh = tuple(f for f in footage.frames if (f.source, f.frame_number) not in known)
    header = mission.header
    warnings = header.warnings + footage.warnings
    if len(fresh) < len(footage.frames):
        warnings += (f"{len(footage.frames) - len(fresh)} frames were in the mission already and were not added again",)
    used = {f.flight for f in fresh}
    mission.add_footage(replace(footage, frames=fresh, flights=tuple(f for f in footage.flights if f.id in used)))
    map_frame = header.map_frame
    if map_frame.crs_wkt is None:
        map_frame = _map_frame(replace(footage, frames=frames + fresh), settings, with_control=with_control)
    names = tuple(n for n in (str(Path(s).absolute()) for s in sources) if n not in header.sources)
    mission.save_header(
        replace(header, sources=header.sources + names, warnings=tuple(dict.fromkeys(warnings)), map_frame=map_frame)
    )


def _map_frame(footage: Footage, settings: MapSettings, *, with_control: bool = False) -> MapFrame:
    fixes = [f.fix for f in footage.frames if f.fix is not None]
    if not fixes:
        if settings.crs is not None and not with_control:
            raise UsageError(
                "--crs needs positions, and the sources have none: leave it away or give --track FILE or --gcp FILE"
            )
        return MapFrame(None)
    return choose_map_frame(fixes, settings.crs)


def _shaping(settings: dict[str, object]) -> dict[str, object]:
    """Return the settings that shape measurements: a resumed run may use other threads, memory and pixels.

    References come in after all measuring, and the mission keeps what they say; so does the ground's shape.
    """
    free = {
        "workers", "scheduler", "memory_mb", "gsd_m_per_px", "references", "reference_sigma_m", "prefer", "layers",
        "dem",
    }  # fmt: skip
    return {k: v for k, v in settings.items() if k not in free}
