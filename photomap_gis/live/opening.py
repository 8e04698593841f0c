"""From what a user names to a session that can fly: mission, source, what is known of places, the graph's desk."""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from photomap_gis import __version__
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import Flight, Footage, FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.live import FrameSource, LiveTelemetry
from photomap_gis.georef import resolve_crs
from photomap_gis.ingest import open_sources
from photomap_gis.ingest.box_files import is_recording, read_contents
from photomap_gis.ingest.sources import VIDEO_SUFFIXES
from photomap_gis.ingest.stream.opening import STREAM_SUFFIXES
from photomap_gis.live.journal import FOLDER, SESSION, load_session, save_session
from photomap_gis.live.locate import FromLog, FromTelemetry, Locator
from photomap_gis.live.options import LiveOptions
from photomap_gis.pipeline.opening import kept_settings
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import Mission, MissionHeader

ALL_FRAMES_HZ = 1000.0
RECORDING = "recording"
_SETTINGS = TypeAdapter(MapSettings)


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """A mission made for a session, and what tells frames their places."""

    mission: Mission
    locator: Locator
    options: LiveOptions


def is_video_file(source: str) -> bool:
    """Whether a source is a recording that lies on this machine."""
    path = Path(source)
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES


def locator_of(source: str, options: LiveOptions, telemetry: LiveTelemetry | None) -> Locator:
    """Return what tells frames their places: a file's log is read whole, of other sources telemetry comes."""
    if not is_video_file(source) or telemetry is not None:
        return FromTelemetry(telemetry)
    footage = open_sources([source], replace(options.settings.ingest, frame_rate_hz=ALL_FRAMES_HZ))
    return FromLog(footage.frames, flights=footage.flights, tracks=footage.tracks, warnings=footage.warnings)


def refuse_flown(folder: Path) -> None:
    """Raise ``UsageError`` where a folder holds a mission; one that never saw a frame is begun anew."""
    if not Mission.exists(folder):
        return
    if (folder / FOLDER / SESSION).is_file() and not any(folder.glob(f"{RECORDING}/piece-*")):
        with Mission.open(folder) as mission:
            flown = any(True for _ in mission.frames)
        if not flown:
            shutil.rmtree(folder / FOLDER)
            shutil.rmtree(folder / RECORDING, ignore_errors=True)
            (folder / "mission.json").unlink()
            return
    raise UsageError(
        f"{folder} holds a mission already: go on with it by 'photomap live --resume {folder}', "
        "or choose another folder by -o"
    )


def begin_session(
    source: str, folder: Path, stream: FrameSource, options: LiveOptions, telemetry: LiveTelemetry | None = None
) -> Ready:
    """Make the mission of a new session; ``UsageError`` where the folder holds one already."""
    refuse_flown(folder)
    if options.settings.crs is not None:
        resolve_crs(options.settings.crs)
    locator = locator_of(source, options, telemetry)
    flights = tuple(getattr(locator, "flights", ())) or (Flight(0, stream.name, "", kind="video"),)
    header = MissionHeader(
        sources=(str(recorded_at(source, folder)),),
        settings=_SETTINGS.dump_python(replace(options.settings, scheduler=None), mode="json"),
        map_frame=MapFrame(None),
        created_utc=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        product=f"photomap {__version__}",
        warnings=locator.warnings,
    )
    footage = Footage((), flights, locator.warnings, tuple(getattr(locator, "tracks", ())))
    mission = Mission.create(folder, header, footage)
    named = str(Path(source).absolute()) if Path(source).exists() else source
    document = {"source": named, "options": _numbers(options), "part": 0}
    save_session(folder, document)
    return Ready(mission, locator, options)


def resume_session(folder: Path, telemetry: LiveTelemetry | None = None) -> tuple[Ready, str]:
    """Open the mission of a session that was cut off, and return its source; ``DataError`` where there is none."""
    document = load_session(folder)
    mission = Mission.open(folder)
    take_new_names(mission)
    try:
        source = str(document["source"])
        options = LiveOptions(settings=kept_settings(mission), **_options_of(document["options"]))
        part = int(document["part"]) + 1
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder}: its live/session.json is damaged") from error
    if document.get("landed"):
        raise UsageError(f"{folder}: this flight has landed; extend the mission by 'photomap map --add {folder} ...'")
    save_session(folder, {**document, "part": part})
    return Ready(mission, locator_of(source, options, telemetry), options), source


def session_options(folder: Path, mission: Mission) -> LiveOptions:
    """Return the options that a session was flown with."""
    return LiveOptions(settings=kept_settings(mission), **_options_of(load_session(folder)["options"]))


def recorded_at(source: str, folder: Path) -> Path:
    """Return where the recording of a source lies: the file itself, a folder of photos, or the mission's black box."""
    path = Path(source)
    is_file = path.is_file() and path.suffix.lower() not in STREAM_SUFFIXES  # those only say where a stream is
    return path.absolute() if is_file or path.is_dir() else (folder / RECORDING).absolute()


def take_new_names(mission: Mission) -> None:
    """Look for photos under the names that they were given while they were flown."""
    box = mission.folder / RECORDING
    if not is_recording(box):
        return
    names = {str(p["was"]): str(p["path"]) for p in read_contents(box).of_kind("photo") if "was" in p}
    if any(r.source in names for r in mission.frames):
        mission.frames.replace([replace(r, source=names.get(r.source, r.source)) for r in mission.frames])


def whole_keys(mission: Mission) -> list[FrameRef]:
    """Return the key frames whose pixels are there, in order; the journal is cut behind them."""
    refs: list[FrameRef] = []
    for ref in mission.frames:
        kept = ref.frame_number is None or mission.video_frame_path(ref.index).is_file()
        if ref.index != len(refs) or not kept:
            break
        refs.append(ref)
    return refs


def _numbers(options: LiveOptions) -> dict[str, Any]:
    document = asdict(options)
    document.pop("settings")
    return document


def _options_of(document: dict[str, Any]) -> dict[str, Any]:
    area = tuple((float(x), float(y)) for x, y in document.get("area_lon_lat", ()))
    names = ("new_ground", "solve_every", "lost_after_s", "gap_s")
    return {name: document[name] for name in names} | {"area_lon_lat": area}
