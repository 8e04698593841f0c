"""A track that comes after the pictures: when it was flown, the motion of the pictures tells, or the user does."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.slam.world import CAMERA, EdgeNoise, GpsNoise, Plan, fly, frame_refs, map_frame_here, registration
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import Attitude, Flight, Footage, GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.georef import fix_to_map, map_to_lonlat
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.pipeline.add_track import add_track, lend_positions, split_tracks
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import Mission, MissionHeader, PreparedFrame, RegistrationRecord

PLAN = Plan(120, strip_m=150.0, forward=0.72)
MAP = map_frame_here()
QUIET = GpsNoise(white_m=0.3, drift_m=1.0, bias_m=0.5, blunders=0.0, dropouts=0.0)
FIRST = 30
"""The stream begins when the drone has flown for so many frames."""
VOID = "flight.mp4: no telemetry was found beside or inside this video, so its map has no place on Earth"


@pytest.fixture
def flown_mission(tmp_path: Path):
    """A mission without positions of the later part of a flight; the flight, and a log of all of it as subtitles."""
    with ExitStack() as opened:
        rng = np.random.default_rng(11)
        flown = fly(rng, PLAN)
        refs = [
            replace(f, fix=None, attitude=None, time_s=None, pts_s=f.time_s)
            for f in frame_refs(rng, flown, MAP, QUIET)[FIRST:]
        ]
        start_s = refs[0].pts_s
        refs = [replace(f, pts_s=f.pts_s - start_s) for f in refs]
        header = MissionHeader((), {}, MapFrame(None), "2026-01-01T00:00:00Z", "test", (VOID, "another warning"))
        flight = Flight(0, "flight", "camera", kind="video")
        mission = opened.enter_context(Mission.create(tmp_path / "m", header, Footage(tuple(refs), (flight,))))
        to_plane = Similarity2D.translation_of(*-CAMERA.principal_xy_px)
        mission.prepared.extend(PreparedFrame(f.index, True, None, to_plane) for f in refs)
        noise = EdgeNoise()
        mission.registrations.extend(
            RegistrationRecord.of(registration(rng, flown, f.index, f.index + 1, noise), EdgeKind.SEQUENTIAL)
            for f in refs[:-1]
        )
        log = tmp_path / "later.SRT"
        write_srt(log, flown, rng)
        yield flown, mission, log, start_s - float(flown.path_s[0])


def write_srt(path: Path, flown, rng) -> None:
    """One subtitle a fifth of a second, from the flight's first moment on."""
    when_s = flown.path_s - flown.path_s[0]
    at_s = np.arange(0.0, when_s[-1], 0.2)
    xy = np.stack([np.interp(at_s, when_s, flown.path_m[:, k]) for k in (0, 1)], axis=1)
    lonlat = map_to_lonlat(MAP, xy + rng.normal(0, 0.2, xy.shape))

    def stamp(s: float) -> str:
        ms = round(s * 1000)
        return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"

    path.write_text(
        "".join(
            f"{n + 1}\n{stamp(s)} --> {stamp(s + 0.2)}\nFrameCnt: {n + 1}\n"
            f"[latitude: {q[1]:.7f}] [longitude: {q[0]:.7f}] [rel_alt: 50.000 abs_alt: 150.000]\n\n"
            for n, (s, q) in enumerate(zip(at_s.tolist(), lonlat, strict=True))
        )
    )


def misses_m(flown, frames) -> np.ndarray:
    there = [f for f in frames if f.fix is not None]
    at = fix_to_map(MAP, [f.fix.lat_deg for f in there], [f.fix.lon_deg for f in there])
    return np.linalg.norm(at - flown.xy_m[[f.index for f in there]], axis=1)


def quiet(stage: str, done: int, total: int) -> None:
    pass


def test_the_motion_tells_when_the_track_was_flown(flown_mission) -> None:
    flown, mission, log, missed_s = flown_mission
    assert missed_s > 70.0  # more than clocks are searched for elsewhere
    (said,) = add_track(mission, log, MapSettings(), quiet)
    frames = list(mission.frames)
    assert sum(f.fix is not None for f in frames) == len(frames) and said.startswith("later.SRT: gives 90 of the 90")
    assert np.median(misses_m(flown, frames)) < 4.0  # half a second at 8 m/s: the solver does the rest
    assert frames[5].height_m == 50.0 and all(f.attitude is None for f in frames)
    again = Mission.open(mission.folder)  # all of it is on the disk
    assert again.header.map_frame.crs_wkt is not None and len(list(again.tracks)) == 1
    assert VOID not in again.header.warnings and "another warning" in again.header.warnings
    assert next(iter(again.flights)).track_source.endswith("later.SRT")


def test_the_user_may_tell(flown_mission) -> None:
    flown, mission, log, missed_s = flown_mission
    settings = MapSettings(ingest=IngestOptions(track_offset_s=-missed_s))
    add_track(mission, log, settings, quiet)
    assert np.median(misses_m(flown, list(mission.frames))) < 1.0


def test_where_the_motion_is_silent_that_is_told(flown_mission) -> None:
    _, mission, log, _ = flown_mission
    mission.registrations.replace([])
    warnings = add_track(mission, log, MapSettings(), quiet)
    assert any("does not tell when this track was flown" in w for w in warnings)


def test_pictures_that_were_levelled_stay_so(flown_mission) -> None:
    _, mission, log, _ = flown_mission
    stood = Attitude(1.0, -1.4, 0.0)
    mission.frames.replace([replace(f, attitude=stood) for f in mission.frames])
    add_track(mission, log, MapSettings(), quiet)
    assert all(f.attitude == stood for f in mission.frames)


def test_a_track_replaces_that_of_the_flight_of_its_name_only(flown_mission) -> None:
    _, mission, log, _ = flown_mission
    fix = GpsFix(1.0, 2.0)
    mission.frames.replace([replace(f, fix=fix, flight=f.index % 2) for f in mission.frames])
    mission.flights.replace([Flight(0, "a", "c"), Flight(1, "b", "c")])
    before = list(mission.frames)
    with pytest.raises(UsageError, match="have positions"):
        add_track(mission, log, MapSettings(), quiet)
    assert list(mission.frames) == before
    log = log.rename(log.with_name("B.srt"))
    add_track(mission, log, MapSettings(ingest=IngestOptions(track_offset_s=0.0)), quiet)
    assert all((f.fix == fix) == (f.flight == 0) for f in mission.frames)


def test_what_is_no_track_leaves_the_mission_as_it_was(flown_mission, tmp_path: Path) -> None:
    _, mission, _, _ = flown_mission
    before = list(mission.frames)
    bad = tmp_path / "bad.srt"
    bad.write_text("no subtitles")
    with pytest.raises(DataError):
        add_track(mission, bad, MapSettings(), quiet)
    assert list(mission.frames) == before and mission.header.map_frame.crs_wkt is None


def test_tracks_are_told_from_pictures(tmp_path: Path) -> None:
    for name in ("a.SRT", "b.tlog", "c.jpg"):
        (tmp_path / name).touch()
    sources = [str(tmp_path / n) for n in ("a.SRT", "c.jpg", "b.tlog", "none.srt")]
    assert split_tracks(sources) == ([sources[1], sources[3]], [Path(sources[0]), Path(sources[2])])


def test_the_cards_file_lends_its_positions_to_the_stream(flown_mission) -> None:
    flown, mission, _, _ = flown_mission
    rng = np.random.default_rng(5)
    whole = frame_refs(rng, flown, MAP, QUIET)
    card = [replace(f, index=1000 + f.index, flight=1, time_s=None, pts_s=f.time_s) for f in whole]
    donor = Flight(1, "card", "camera", kind="video")
    mission.add_footage(Footage(tuple(card), (donor,)))
    (said,) = lend_positions(mission, [donor], MapSettings(), quiet)
    assert said.startswith("card: gives 90 of the 90 frames of flight their places")
    stream = [f for f in mission.frames if f.flight == 0]
    assert np.median(misses_m(flown, stream)) < 5.0
    assert lend_positions(mission, [donor], MapSettings(), quiet) == ()  # there is nobody left without


def test_another_flight_lends_nothing(flown_mission) -> None:
    _, mission, _, _ = flown_mission
    other = fly(np.random.default_rng(3), Plan(80, strip_m=60.0, forward=0.6))
    frames = frame_refs(np.random.default_rng(4), other, MAP, QUIET)
    donor = Flight(1, "card", "camera", kind="video")
    mission.add_footage(
        Footage(
            tuple(replace(f, index=1000 + f.index, flight=1, time_s=None, pts_s=f.time_s) for f in frames), (donor,)
        )
    )
    assert lend_positions(mission, [donor], MapSettings(), quiet) == ()
    assert all(f.fix is None for f in mission.frames if f.flight == 0)
