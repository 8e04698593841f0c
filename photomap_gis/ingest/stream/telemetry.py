"""From what a user names as telemetry of a live source to the telemetry."""

from __future__ import annotations

from pathlib import Path

from photomap_gis.core.errors import LinkError, UsageError
from photomap_gis.core.live import FrameSource, LiveClock, LiveTelemetry
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.clock import SystemClock
from photomap_gis.ingest.stream.file_telemetry import FileTelemetry
from photomap_gis.ingest.stream.mavlink_telemetry import MavlinkTelemetry
from photomap_gis.ingest.stream.stream_telemetry import StreamTelemetry
from photomap_gis.vehicle_link import parse_url

TLOG = "telemetry.tlog"
_OPTIONS = IngestOptions()


def open_telemetry(
    source: FrameSource,
    *,
    track: Path | None = None,
    mavlink_url: str | None = None,
    options: IngestOptions = _OPTIONS,
    clock: LiveClock | None = None,
    recording: Path | None = None,
    request_streams: bool = False,
) -> LiveTelemetry:
    """Return the telemetry of a live source: of a log, of an autopilot, else what the stream itself tells.

    The stream's own is told by ``hear``. ``recording`` is the black box's folder: an autopilot's packets are kept in
    it. Raises ``UsageError`` for two at once or what is no address, ``LinkError`` where it cannot be opened,
    ``DataError`` for a log that is none.
    """
    clock = clock or SystemClock()
    if track is not None and mavlink_url is not None:
        raise UsageError("--track and --mavlink are two clocks for one flight: give one of them")
    if mavlink_url is not None:
        tlog = None if recording is None else recording / TLOG
        try:
            return MavlinkTelemetry(
                parse_url(mavlink_url), mavlink_url, clock, tlog=tlog, request_streams=request_streams
            )
        except (UsageError, LinkError) as error:  # the planner's commands call it otherwise
            raise type(error)(str(error).replace("--connect", "--mavlink")) from error
    if track is None:
        return StreamTelemetry(source.name)
    span_s: float | None = getattr(source, "span_s", None)  # a played file's length is known
    return FileTelemetry(
        track, options, started_utc_s=lambda: source.started_utc_s, span_s=span_s,
        follow=source.is_live and span_s is None,
    )  # fmt: skip
