"""A flight from the first frame to the landing, as a host (the command line, a test) drives it."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.frame import FrameRef, GpsFix
from photomap_gis.core.live import FrameMoment, FrameSource, LiveClock, LiveTelemetry
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.export.crs import WEB_MERCATOR, WGS84, parse_crs
from photomap_gis.export.cutline import read_cutline
from photomap_gis.georef import choose_map_frame
from photomap_gis.ifmi import Prior, make_spectrum, register
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.telemetry import open_telemetry
from photomap_gis.live.graph import GraphWork, KeyNews
from photomap_gis.live.graph_desk import GraphDesk, GraphHere, GraphProcess, recalled
from photomap_gis.live.landing import LiveSummary, land
from photomap_gis.live.locate import FromTelemetry
from photomap_gis.live.opening import (
    RECORDING,
    Ready,
    begin_session,
    is_video_file,
    refuse_flown,
    resume_session,
    take_new_names,
    whole_keys,
)
from photomap_gis.live.options import LiveOptions
from photomap_gis.live.session import Session
from photomap_gis.live.steps import Step
from photomap_gis.live.view import LiveView, starting_state
from photomap_gis.pipeline import MapSummary
from photomap_gis.pipeline.live_lag import picture_lag
from photomap_gis.pipeline.master import master_frame
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.server.live_view import LiveEnd, LivePhase, LivePose
from photomap_gis.store import Mission

SAY_EVERY_S = 1.0
LAG_EVERY_S, LAG_KEYS, FEWEST_LAG_KEYS = 20.0, 240, 30


@dataclass(frozen=True, slots=True)
class FlightRequest:
    """What is asked of a flight: a source and a folder, or a folder to resume."""

    source: str | None
    folder: Path | None
    resume: Path | None = None
    settings: MapSettings = MapSettings()  # noqa: RUF009  (frozen)
    mavlink: str | None = None
    request_streams: bool = False
    realtime: bool = True
    area: Path | None = None


class Flight:
    """A session that is ready to fly; use as a context manager."""

    def __init__(
        self,
        ready: Ready,
        stream: FrameSource,
        *,
        realtime: bool,
        keys: list[FrameRef] | None = None,
        skip_until: int = -1,
        telemetry: LiveTelemetry | None = None,
        known: set[str] | None = None,
    ) -> None:
        self._ready, self._stream, self._telemetry = ready, stream, telemetry
        mission, options = ready.mission, ready.options
        self.folder = mission.folder
        area = np.array(options.area_lon_lat) if options.area_lon_lat else None
        self.view = LiveView(
            mission.folder,
            starting_state(mission.folder.resolve().name, mission.folder, area_lon_lat=area, warnings=self.warnings),
        )
        self.on_second: Callable[[str], None] = lambda words: None
        self.on_words: Callable[[str], None] = lambda words: None
        self.on_pose: Callable[[LivePose], None] = lambda pose: None
        self._said_s = -1e9
        graph: GraphDesk
        work: GraphWork | None = None
        if keys:
            work = _recalled(mission, options, keys)
        if realtime:
            if work is not None:
                work.save()
                mission.prepared.close()
                mission.registrations.close()
            graph = GraphProcess(mission.folder, options.settings, options.solve_every, recall=bool(keys))
        else:
            graph = GraphHere(mission, options.settings, options.solve_every, work)
        self.graph = graph
        self.session = Session(
            mission, stream, ready.locator, graph, self.view, options, realtime=realtime, on_step=self._step,
            on_words=lambda words: self.on_words(words),
            skip_until=skip_until, skip_sources=frozenset(known or ()),
        )  # fmt: skip
        self._was_armed, self._realtime, self._lag_at_s = False, realtime, 0.0
        if work is not None and keys:
            solution = work.solve()
            if solution is not None:
                self.session.begin(self.session.loop.resume([(k, n) for n, k in enumerate(keys)], solution))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know before the first frame."""
        return self._ready.locator.warnings

    def __enter__(self) -> Flight:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
        if self._telemetry is not None:
            self._telemetry.close()
        self._ready.mission.__exit__()

    def fly(self) -> None:
        """Fly until the source ends or ``stop`` is called."""
        threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            with threadpool_limits(1):
                if self._realtime:
                    _warm_up()
                self.session.run()
        finally:
            cv2.setNumThreads(threads)

    def stop(self) -> None:
        """End the flight soon; from any thread."""
        self.session.stop()

    def land(self, on_progress: Progress) -> MapSummary:
        """Make the final map; ``DataError`` where no frame came or none could be used."""
        if not self.session.loop.tally.frames and not len(self.session.loop.chart):
            raise DataError(
                f"{self._stream.name}: no frame came, so there is no map; see that it sends, and start again "
                "(the same -o may be used)"
            )
        take_new_names(self._ready.mission)
        self._ready.mission.__exit__()

        def told(end: LiveEnd) -> None:
            self.view.put(phase=end.phase, end=end)
            self.view.tell(end)

        told(LiveEnd(LivePhase.FINALISING, 0.0, "the final map is made"))
        summary = land(self.folder, on_progress, told)
        told(LiveEnd(LivePhase.ENDED, 1.0, "the map is finished"))
        return summary

    def summary(self, made: MapSummary | None) -> LiveSummary:
        """Return what there is to tell."""
        loop = self.session.loop
        failure = self.session.failure
        warnings = () if failure is None else (str(failure),)
        return LiveSummary(
            str(self.folder), loop.tally, len(loop.chart), loop.tracker.pieces, None, made,
            (*self.warnings, *warnings) if made is None else warnings,
        )  # fmt: skip

    def _step(self, step: Step) -> None:
        pose = self.view.state.pose
        if pose is None or pose.time_s - self._said_s < SAY_EVERY_S:
            return
        self._said_s = pose.time_s
        self._look_at_vehicle()
        self._find_lag()
        self.on_pose(pose)
        t, chart = self.session.loop.tally, self.session.loop.chart
        place = "on the ground" if chart.map_frame.crs_wkt is not None else "relative"
        self.on_second(
            f"{pose.time_s:6.1f} s  {t.frames} frames, {t.dropped} dropped, {t.error_frames} error frames, "
            f"{len(chart)} key frames, {self.session.loop.tracker.pieces} piece(s), {place}, revision {chart.revision}"
        )

    def _find_lag(self) -> None:
        """Now and then find by how much pictures come later than positions; in a thread, since it takes a moment."""
        telemetry, time_s = self._telemetry, self._said_s
        if telemetry is None or time_s - self._lag_at_s < LAG_EVERY_S:
            return
        self._lag_at_s = time_s
        loop = self.session.loop
        chart = loop.chart.snapshot()
        keys = [k for k in range(max(0, len(chart) - LAG_KEYS), len(chart)) if math.isfinite(loop.arrivals_s[k])]
        keys = [k for k in keys if chart.segments[k] == chart.segments[-1]]
        if chart.map_frame.crs_wkt is None or len(keys) < FEWEST_LAG_KEYS:
            return
        moments = [FrameMoment(loop.times_s[k], loop.arrivals_s[k]) for k in keys]

        def find() -> None:
            path = np.array([chart.belief(k).T_map_plane.translation for k in keys])
            times = np.array([m.stream_time_s for m in moments])
            lag = picture_lag(times, path, telemetry.place(moments), chart.map_frame)
            if lag is not None and lag.believed:
                telemetry.set_lag(lag.lag_s, lag.sigma_s)

        threading.Thread(target=find, name="lag", daemon=True).start()

    def _look_at_vehicle(self) -> None:
        """Land when the autopilot disarms."""
        if self._telemetry is None:
            return
        armed = self._telemetry.state().armed
        if armed is False and self._was_armed:
            self.stop()
        self._was_armed = self._was_armed or armed is True


def _warm_up() -> None:
    """Have windows, plans of transforms and lazy modules made before the first frame comes."""
    noise = np.random.default_rng(0).integers(0, 255, (288, 512), np.uint8)
    spectrum = make_spectrum(noise)
    register(spectrum, make_spectrum(noise), fallback=False)
    register(spectrum, make_spectrum(noise), prior=Prior(Similarity2D(), 5.0, 0.02, 0.02), fallback=False)
    utm = choose_map_frame([GpsFix(50.0, 8.0)])
    master_frame(utm, WEB_MERCATOR).to_crs(np.zeros((1, 2)))


def open_flight(request: FlightRequest, clock: LiveClock | None = None) -> Flight:
    """Return a flight that is ready; what cannot be used is told before the first frame. ``PhotomapError`` children."""
    if request.resume is not None:
        return _resumed(request, clock)
    if request.source is None or request.folder is None:
        raise ValueError("a flight needs a source and a folder")
    options = LiveOptions(settings=request.settings, area_lon_lat=_area(request.area))
    stream, telemetry = _opened(request.source, request.folder, request, options, clock)
    try:
        ready = begin_session(request.source, request.folder, stream, options, telemetry)
        return Flight(ready, stream, realtime=request.realtime, telemetry=telemetry)
    except BaseException:
        _close(stream, telemetry)
        raise


def _opened(
    source: str, folder: Path, request: FlightRequest, options: LiveOptions, clock: LiveClock | None
) -> tuple[FrameSource, LiveTelemetry | None]:
    """Open a source with its black box, and its telemetry; a file needs neither: it is the recording itself."""
    ingest = options.settings.ingest
    if is_video_file(source) and request.mavlink is None:
        return open_stream(source, realtime=request.realtime, options=ingest, clock=clock), None
    recording = None if is_video_file(source) else folder / RECORDING
    if recording is not None:
        if request.resume is None:
            refuse_flown(folder)
        try:
            recording.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot write {folder}: {error.strerror}; choose another folder by -o") from error
    try:
        stream = open_stream(source, realtime=request.realtime, options=ingest, clock=clock, recording=recording)
    except BaseException:
        for empty in () if recording is None else (recording, folder):  # a typing error leaves nothing behind
            with contextlib.suppress(OSError):
                empty.rmdir()
        raise
    try:
        telemetry = open_telemetry(
            stream, track=ingest.track, mavlink_url=request.mavlink, options=ingest, clock=clock, recording=recording,
            request_streams=request.request_streams,
        )  # fmt: skip
    except BaseException:
        stream.close()
        raise
    return stream, telemetry


def _close(stream: FrameSource, telemetry: LiveTelemetry | None) -> None:
    stream.close()
    if telemetry is not None:
        telemetry.close()


def _resumed(request: FlightRequest, clock: LiveClock | None) -> Flight:
    folder = request.resume
    assert folder is not None
    ready, source = resume_session(folder)
    stream, telemetry = _opened(source, folder, request, ready.options, clock)
    try:
        if telemetry is not None:
            ready = replace(ready, locator=FromTelemetry(telemetry))
        keys = whole_keys(ready.mission)
        _cut_frames(ready.mission, keys)
        # A file begins at its beginning again; photos of a folder are told by their names, a stream just goes on.
        last = max((k.frame_number or 0 for k in keys), default=-1) if is_video_file(source) else -1
        return Flight(
            ready, stream, realtime=request.realtime, keys=keys, skip_until=last, telemetry=telemetry,
            known={k.source for k in keys} if Path(source).is_dir() else set(),
        )  # fmt: skip
    except BaseException:
        _close(stream, telemetry)
        raise


def _cut_frames(mission: Mission, keys: list[FrameRef]) -> None:
    """Forget what was written of frames behind those whose pixels are there."""
    count = len(keys)
    for journal, wanted in (
        (mission.frames, lambda r: r.index < count),
        (mission.prepared, lambda r: r.frame < count),
        (mission.registrations, lambda r: max(r.a, r.b) < count),
    ):
        journal.keep(wanted)


def _recalled(mission: Mission, options: LiveOptions, keys: list[FrameRef]) -> GraphWork:
    """Return the graph of a session that was cut off; key frames that it had not heard of are taken in again."""
    known = {p.frame for p in mission.prepared}
    heard = next((n for n, k in enumerate(keys) if k.index not in known), len(keys))
    work = recalled(mission, options.settings, keys[:heard])
    for ref in keys[heard:]:
        image = cv2.imread(str(mission.video_frame_path(ref.index)), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DataError(f"{mission.video_frame_path(ref.index)} is damaged: the session cannot be resumed")
        work.add(KeyNews(ref, np.asarray(image, np.uint8), work.place_of(ref.index - 1), None))
    return work


def _area(path: Path | None) -> tuple[tuple[float, float], ...]:
    """Return the polygon to cover in degrees; ``DataError`` where the file holds none."""
    if path is None:
        return ()
    outline = read_cutline(path).geometry_in(parse_crs(WGS84).to_wkt())
    polygon = max(getattr(outline, "geoms", [outline]), key=lambda g: g.area)
    return tuple((float(x), float(y)) for x, y in polygon.exterior.coords)
