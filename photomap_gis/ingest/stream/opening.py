"""From what a user names as a live source to the source, and its black box."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.live import FrameSource, LiveClock, LiveFrame, StreamEvent, StreamRenamed
from photomap_gis.ingest.box_files import is_recording
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.addresses import Address, address_of, is_address, playlist_address, sdp_address
from photomap_gis.ingest.stream.black_box import BlackBox
from photomap_gis.ingest.stream.clock import SystemClock
from photomap_gis.ingest.stream.connect import Connector, Limits
from photomap_gis.ingest.stream.file_source import FileSource
from photomap_gis.ingest.stream.folder_source import FolderSource
from photomap_gis.ingest.stream.link_source import LinkSource
from photomap_gis.ingest.stream.recorded import RecordedSource
from photomap_gis.ingest.stream.rtmp_door import RtmpDoor
from photomap_gis.ingest.stream.srt_relay import SrtRelay

_OPTIONS = IngestOptions()
STREAM_SUFFIXES = (".sdp", ".m3u8")
"""Files that only say where a stream is."""


def open_stream(
    source: str | Path,
    *,
    realtime: bool = True,
    options: IngestOptions = _OPTIONS,
    clock: LiveClock | None = None,
    recording: Path | None = None,
    limits: Limits | None = None,
) -> FrameSource:
    """Return the live source that ``source`` names; what cannot be used is told before the first frame.

    A video file or a recording is played at its rate (``realtime``) or as fast as it is read. A folder of photos is
    watched for more (``realtime``), or read as it is. Anything with a scheme is a stream, and ``/dev/video0`` or
    ``device:0`` a camera; ``.sdp`` tells of an RTP session, ``.m3u8`` is a playlist. ``options`` tell the lens.
    ``recording`` is the folder of the black box: packets as they came for a stream, names for files and photos.
    Raises ``DataError`` for files that are no video, ``LinkError`` for addresses that nobody answers, ``UsageError``
    for what is no source, ``OutputError`` where the recording cannot be written.
    """
    clock = clock or SystemClock()
    text = str(source)
    path = Path(source).expanduser()
    if not path.exists() and is_address(text):
        return _linked(address_of(text), options, clock, recording, limits, realtime=realtime)
    if path.is_dir():
        if is_recording(path):
            return RecordedSource(path, options, clock, realtime=realtime)
        if is_recording(path / "recording"):
            return RecordedSource(path / "recording", options, clock, realtime=realtime)
        return _noted(FolderSource(path, options, clock, watch=realtime), path, clock, recording)
    if path.is_char_device():
        return _linked(address_of(text), options, clock, recording, limits, realtime=realtime)
    if not path.is_file():
        raise DataError(f"{source}: no such file, folder or address; check the name")
    suffix = path.suffix.lower()
    if suffix in STREAM_SUFFIXES:
        address = sdp_address(path) if suffix == ".sdp" else playlist_address(path)
        return _linked(address, options, clock, recording, limits, realtime=realtime)
    return _noted(FileSource(path, options, clock, realtime=realtime), path, clock, recording)


def _linked(
    address: Address, options: IngestOptions, clock: LiveClock, recording: Path | None, limits: Limits | None,
    *, realtime: bool,
) -> FrameSource:  # fmt: skip
    # The address is tried first: a typing error leaves no recording behind.
    box: BlackBox | None = None
    connector: Connector | None = None
    if address.scheme == "rtmp" and address.is_listener:
        connector = RtmpDoor(address)
    elif address.scheme == "srt":
        connector = SrtRelay(address)
    source = LinkSource(address, options, clock, limits=limits, connector=connector, realtime=realtime)
    if recording is not None:
        box = BlackBox(recording, clock, source=address.name)
        source.record_into(box)
    return source if box is None else _Boxed(source, box)


def _noted(source: FileSource | FolderSource, path: Path, clock: LiveClock, recording: Path | None) -> FrameSource:
    if recording is None:
        return source
    if path.resolve() in (recording.resolve(), *recording.resolve().parents):
        raise UsageError(f"{path} would hold its own recording: choose another place for the mission")
    box = BlackBox(recording, clock, source=str(path.absolute()))
    return _Noted(source, box, path)


class _Boxed:
    """A source whose black box is closed when it ends."""

    def __init__(self, source: FrameSource, box: BlackBox) -> None:
        self._source, self._box = source, box

    @property
    def is_live(self) -> bool:
        """Whether frames come by themselves."""
        return self._source.is_live

    @property
    def name(self) -> str:
        """The source's name."""
        return self._source.name

    @property
    def started_utc_s(self) -> float | None:
        """Unix seconds of stream time 0."""
        return self._source.started_utc_s

    @property
    def span_s(self) -> float | None:
        """How long a played file lasts, ``None`` for what has no known end."""
        return getattr(self._source, "span_s", None)

    def close(self) -> None:
        """End the source."""
        self._source.close()

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield what comes."""
        try:
            yield from self._source
        finally:
            self._box.close()


class _Noted(_Boxed):
    """A source of files: the recording holds their names, and when each frame was."""

    def __init__(self, source: FrameSource, box: BlackBox, path: Path) -> None:
        super().__init__(source, box)
        self._path = path

    def __iter__(self) -> Iterator[StreamEvent]:
        """Yield what comes."""
        try:
            if self._path.is_file():
                size = self._path.stat().st_size
                self._box.line(kind="file", path=str(self._path.absolute()), size_bytes=size)
            for event in self._source:
                if isinstance(event, LiveFrame):
                    self._box.stamp(event.stream_time_s, event.arrival_s)
                    if event.ref.frame_number is None and not self._path.is_file():
                        self._box.line(
                            kind="photo", path=str(Path(event.ref.source).absolute()), index=event.index,
                            width_px=event.ref.width_px, height_px=event.ref.height_px,
                            stream_time_s=event.stream_time_s, arrival_s=event.arrival_s,
                        )  # fmt: skip
                elif isinstance(event, StreamRenamed):
                    self._box.line(kind="renamed", path=event.path, to=event.to)
                yield event
        finally:
            self._box.close()
