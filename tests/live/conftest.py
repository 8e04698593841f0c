"""A short flight with known truth, as a video file and as frames in memory, flown once for all tests of the room."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from photomap_gis.core.frame import Flight as FlightOf
from photomap_gis.core.frame import Footage, FrameRef, ImageArray
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.live import EndReason, GapKind, LiveFrame, StreamEnd, StreamEvent, StreamGap
from photomap_gis.ingest import IngestOptions, open_sources, read_frames
from photomap_gis.ingest.stream.picture import ArrayPicture
from photomap_gis.live.flight import Flight
from photomap_gis.live.locate import FromTelemetry
from photomap_gis.live.opening import Ready
from photomap_gis.live.options import LiveOptions
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.simulate import FlightSpec, procedural_scene
from photomap_gis.simulate.flight import required_size_m
from photomap_gis.simulate.spec import Motion
from photomap_gis.simulate.truth import Truth
from photomap_gis.simulate.write import simulate_video
from photomap_gis.store import Mission, MissionHeader


@dataclass(frozen=True)
class Flown:
    """A simulated video: its file, its frames by ``photomap map``'s reading of it, and the truth."""

    video: Path
    folder: Path
    truth: Truth
    refs: tuple[FrameRef, ...]
    images: tuple[ImageArray, ...]


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    folder = tmp_path_factory.mktemp("live-flight")
    spec = FlightSpec(
        frames=140, altitude_m=45.0, speed_m_s=7.0, width_px=480, height_px=320, video_rate_hz=8.0, side_overlap=0.5,
        bitrate_bit_s=3_000_000, motion=Motion(tilt_deg=0.5), seed=4,
    )  # fmt: skip
    size = required_size_m(spec, video=True)
    ground = procedural_scene((size[0] + 4.0, size[1] + 4.0), 0.16, 4)
    truth = simulate_video(ground, spec, folder)
    video = folder / "video" / "DJI_0001.MP4"
    refs = open_sources([video], IngestOptions(frame_rate_hz=1000.0)).frames
    images = tuple(frame.image for _, frame in read_frames(refs))
    return Flown(video, folder, truth, refs, images)


class MadeSource:
    """Frames from memory: what a link would bring, with its gaps, as fast as they are taken."""

    name, is_live, started_utc_s = "made", False, None

    def __init__(self, events: Iterable[StreamEvent]) -> None:
        self._events = events
        self.closed = False

    def __iter__(self) -> Iterator[StreamEvent]:
        last = 0.0
        for event in self._events:
            if self.closed:
                break
            last = getattr(event, "stream_time_s", last)
            yield event
        yield StreamEnd(EndReason.CLOSED if self.closed else EndReason.END_OF_FILE, last, last)

    def close(self) -> None:
        self.closed = True


def frame_of(flown: Flown, k: int, image: ImageArray | None = None, **changes: object) -> LiveFrame:
    """A frame of the flight as a source yields it."""
    ref = replace(flown.refs[k], index=k, **changes)
    picture = ArrayPicture(flown.images[k] if image is None else image)
    return LiveFrame(ref, picture, float(ref.pts_s or 0.0))


def gap_of(kind: GapKind, at_s: float, duration_s: float | None = None) -> StreamGap:
    return StreamGap(kind, at_s, at_s, kind.value, duration_s)


@pytest.fixture
def fly(tmp_path: Path) -> Callable[..., Flight]:
    """Fly events into a new mission, all in one thread; returns the flight when it has ended."""

    def run(events: Iterable[StreamEvent], name: str = "mission", **options: object) -> Flight:
        chosen = LiveOptions(settings=MapSettings(), **options)  # type: ignore[arg-type]
        folder = tmp_path / name
        header = MissionHeader(
            (str(folder / "recording"),), TypeAdapter(MapSettings).dump_python(chosen.settings, mode="json"),
            MapFrame(None), "2026-01-01T00:00:00Z", "test",
        )  # fmt: skip
        mission = Mission.create(folder, header, Footage((), (FlightOf(0, "made", "", kind="video"),)))
        with Flight(Ready(mission, FromTelemetry(), chosen), MadeSource(events), realtime=False) as flight:
            flight.fly()
        return flight

    return run


def worst_error_m(flight: Flight, flown: Flown) -> float:
    """How far key frames lie from the truth (RMS), when the best similarity is taken out: the map's relative error."""
    from photomap_gis.core.similarity import fit_similarity

    chart = flight.session.loop.chart
    place = {k: frame for k, frame in enumerate(flown.truth.frames)}
    got, true = [], []
    for k in range(len(chart)):
        true_frame = place[int(chart.refs[k].frame_number or 0)]
        got.append(chart.placement(k).plumb_xy_map_m)
        true.append((true_frame.pose.easting_m, -true_frame.pose.northing_m))
    a, b = np.array(true), np.array(got)
    T = fit_similarity(a, b)
    return float(np.sqrt(np.mean(np.sum((T.apply(b) - a) ** 2, axis=1))))
