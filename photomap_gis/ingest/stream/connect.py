"""Opening a stream through FFmpeg, with a limit on every wait and an error that says what to do."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import Any, Protocol

import av
from av.error import FFmpegError

from photomap_gis.core.errors import DataError, LinkError, PhotomapError, UsageError
from photomap_gis.ingest.decode import MAX_PIXELS
from photomap_gis.ingest.stream.addresses import Address


@dataclass(frozen=True, slots=True)
class Limits:
    """How long is waited for what, in seconds.

    ``open_s``: for an answer, and for the pictures to be understood. ``listen_s``: for somebody to send, before the
    listening is begun anew. ``stall_s``: without a packet the link counts as lost. ``first_retry_s`` to
    ``last_retry_s``: between attempts, doubling. ``give_up_s``: without a frame, once there were some, the source ends
    (``None``: never). ``no_key_frame_s``: without a key frame decoding begins where it can, and that is told.
    """

    open_s: float = 10.0
    listen_s: float = 20.0
    stall_s: float = 3.0
    first_retry_s: float = 0.5
    last_retry_s: float = 5.0
    give_up_s: float | None = 60.0
    no_key_frame_s: float = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """An open container: its video stream and the streams of metadata.

    ``has_end``: it is a finished recording somewhere else rather than something live.
    """

    container: Any
    video: Any
    data: tuple[Any, ...]
    has_end: bool = False

    def close(self) -> None:
        """Close the container."""
        self.container.close()


class Connector(Protocol):
    """Opens connections to one address, again and again."""

    def connect(self, address: Address, limits: Limits) -> Connection:
        """Return a connection, or raise as ``connect`` does."""
        ...

    def close(self) -> None:
        """Give up what is held, from any thread; a wait in progress may end."""
        ...


class Plain:
    """A ``Connector`` that leaves all to FFmpeg."""

    def connect(self, address: Address, limits: Limits) -> Connection:
        """Return a connection."""
        return connect(address, limits)

    def close(self) -> None:
        """Hold nothing."""


class NobodySendsError(LinkError):
    """A listener heard nothing within its time: it may listen on."""


def connect(address: Address, limits: Limits) -> Connection:
    """Open a stream; ``LinkError`` where nobody answers, ``DataError`` where what comes is no video."""
    failure: PhotomapError | None = None
    for attempt in address.attempts:
        try:
            return _connect(address, limits, attempt)
        except PhotomapError as error:
            failure = failure if failure is not None and not isinstance(error, DataError) else error
    assert failure is not None  # there is one attempt at least
    raise failure


def _connect(address: Address, limits: Limits, attempt: dict[str, str]) -> Connection:
    wait_s = limits.listen_s if address.is_listener else limits.open_s
    try:
        container = av.open(
            address.url,
            format=address.container_format,
            options={**address.options, **attempt},
            timeout=(wait_s, limits.stall_s),
            metadata_errors="ignore",
        )
    except (FFmpegError, OSError, ValueError) as error:
        raise _as_words(address, error, wait_s) from error
    try:
        video = max(
            (s for s in container.streams.video if s.codec_context is not None),
            key=lambda s: s.codec_context.width * s.codec_context.height,
            default=None,
        )
        if video is None:
            kinds = ", ".join(sorted({s.type for s in container.streams})) or "nothing"
            raise DataError(f"{address.name}: no video stream in it ({kinds}); choose the camera's stream")
        if video.codec_context.width * video.codec_context.height > MAX_PIXELS:
            raise DataError(f"{address.name}: claims frames of a size that no camera has; it is damaged")
        has_end = container.duration is not None and container.duration > 0
        return Connection(container, video, tuple(s for s in container.streams if s.type == "data"), has_end)
    except BaseException:
        container.close()
        raise


def _as_words(address: Address, error: Exception, waited_s: float) -> PhotomapError:
    name, kind = address.name, type(error).__name__
    if kind == "ProtocolNotFoundError":
        return UsageError(f"{name}: this build of FFmpeg (in PyAV) cannot speak {address.scheme}")
    if kind == "ConnectionRefusedError":
        return LinkError(f"{name}: refused: nobody listens at this address; is the stream switched on?")
    if kind in ("HTTPUnauthorizedError", "HTTPForbiddenError"):
        return LinkError(
            f"{name}: user name or password is not accepted: write {address.scheme}://USER:PASSWORD@HOST/..."
        )
    if kind in ("HTTPNotFoundError", "HTTPOtherClientError", "HTTPClientError"):
        return LinkError(f"{name}: the server knows no such stream; check the path behind the host")
    if kind == "HTTPServerError":
        return LinkError(f"{name}: the server has a fault of its own; try again later")
    if kind in ("ExitError", "TimeoutError"):
        if address.is_listener:
            return NobodySendsError(f"{name}: nobody has sent anything for {waited_s:g} s")
        return LinkError(f"{name}: no answer within {waited_s:g} s; check the address and the network")
    if kind in ("InvalidDataError", "StreamNotFoundError", "DecoderNotFoundError", "DemuxerNotFoundError"):
        return DataError(f"{name}: what comes is no video that is understood; check the sender's settings")
    if kind == "PermissionError":
        return LinkError(f"{name}: not allowed (ports below 1024, devices of other users); choose another port or ask")
    if kind == "FileNotFoundError":
        return LinkError(f"{name}: there is no such device or file; check the name")
    if getattr(error, "errno", None) in (98, 48, 10048):
        return LinkError(f"{name}: the port is in use by another program; choose another one")
    if address.host and not address.is_listener and not _resolves(address.host):
        return LinkError(f"{name}: there is no host {address.host}; check the name and the network")
    why = getattr(error, "strerror", None) or str(error)
    return LinkError(f"{name}: cannot be opened ({why}); check the address and that the stream is switched on")


def _resolves(host: str) -> bool:
    try:
        socket.getaddrinfo(host, None)
    except OSError:
        return False
    return True
