"""What a user types as a live source, and how FFmpeg is to open it: protocol, options, limits. Pure."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from photomap_gis.core.errors import UsageError


class SourceKind(StrEnum):
    """How a source is read."""

    FILE = "file"
    FOLDER = "folder"
    STILLS = "stills"
    LINK = "link"
    RECORDING = "recording"


@dataclass(frozen=True, slots=True)
class Address:
    """A stream's address as FFmpeg takes it.

    ``name`` is for people: no password in it. ``is_listener``: we wait for the sender. ``container_format`` and
    ``options`` are FFmpeg's; ``attempts`` are further options to try in turn.

    """

    url: str
    name: str
    scheme: str
    is_listener: bool = False
    container_format: str | None = None
    options: dict[str, str] = field(default_factory=dict)
    attempts: tuple[dict[str, str], ...] = ({},)
    host: str | None = None
    port: int | None = None


SCHEMES = ("rtsp", "rtsps", "rtmp", "rtmps", "udp", "rtp", "srt", "http", "https", "tcp", "device", "v4l2")
_DEFAULT_PORT = {"rtsp": 554, "rtsps": 322, "rtmp": 1935, "rtmps": 443, "http": 80, "https": 443}
_ANY_HOST = ("0.0.0.0", "::", "")
_PROBING = {"probesize": "500000", "analyzeduration": "500000"}
"""Enough for a key frame of a drone; FFmpeg's own five seconds are five seconds that nobody sees."""
_NETWORK_ONLY = "http,https,tcp,tls,crypto,httpproxy,udp,rtp,rtmp,rtsp,srtp"
"""A playlist from the network must not read files of this machine."""
_DRIVE = re.compile(r"^[A-Za-z]:[\\/]")


def is_address(source: str) -> bool:
    """Whether a source is an address or a device rather than a path."""
    scheme = source.split(":", 1)[0].lower() if ":" in source else ""
    return not _DRIVE.match(source) and (scheme in SCHEMES or "://" in source or _is_device(source))


def address_of(source: str) -> Address:
    """Return how to open a stream; ``UsageError`` where it is no address that is known."""
    if _is_device(source):
        return _device(source)
    parts = urlsplit(source)
    scheme = parts.scheme.lower()
    if scheme not in SCHEMES:
        raise UsageError(
            f"{source}: no kind of stream that is known: give one of {', '.join(SCHEMES)}://..., or a file"
        )
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        raise UsageError(f"{source}: the port must be a number between 1 and 65535") from None
    base = Address(
        source, _without_password(source), scheme, options=dict(_PROBING), host=host,
        port=port or _DEFAULT_PORT.get(scheme),
    )  # fmt: skip
    return _RULES[scheme](base)


def sdp_address(path: Path) -> Address:
    """Return how to open the RTP session that a session description tells of."""
    return Address(
        str(path), path.name, "sdp", is_listener=True, container_format="sdp",
        options={**_PROBING, "protocol_whitelist": "file,udp,rtp,srtp,crypto", "reorder_queue_size": "32"},
    )  # fmt: skip


def playlist_address(path: Path) -> Address:
    """Return how to open an HLS playlist that lies here."""
    return Address(
        str(path), path.name, "hls", container_format="hls",
        options={"protocol_whitelist": "file,crypto," + _NETWORK_ONLY, "live_start_index": "-2"},
    )  # fmt: skip


def _rtsp(base: Address) -> Address:
    # TCP first: over a radio link UDP loses the packets of which pictures are made.
    return replace(
        base,
        options={**base.options, "reorder_queue_size": "32"},
        attempts=({"rtsp_transport": "tcp"}, {"rtsp_transport": "udp"}),
    )


def _rtmp(base: Address) -> Address:
    if base.port is None or base.host is None:
        raise UsageError(f"{base.name}: write rtmp://0.0.0.0:1935/live/drone to listen, or the server's address")
    # Its header has all that a decoder needs; FFmpeg would look for a sound track, a hundred frames long.
    base = replace(base, options={**base.options, "analyzeduration": "1"})
    listens = base.host in _ANY_HOST or ("listen", "1") in parse_qsl(urlsplit(base.url).query)
    if not listens:
        return replace(base, options={**base.options, "rtmp_live": "live"})
    url = _without_query(base.url, "listen")
    if not urlsplit(url).path.strip("/"):
        url = url.rstrip("/") + "/live/drone"
    return replace(
        base, url=url, name=_without_password(url), is_listener=True, options={**base.options, "listen": "1"}
    )


def _udp(base: Address) -> Address:
    if base.port is None:
        raise UsageError(f"{base.name}: a port is missing: write {base.scheme}://0.0.0.0:5600")
    query = dict(parse_qsl(urlsplit(base.url).query))
    # Our own buffers must hold a burst; an overrun is a gap, not the end.
    query = {"fifo_size": "200000", "overrun_nonfatal": "1", "buffer_size": "2000000", **query}
    parts = urlsplit(base.url)
    host = f"[{base.host}]" if base.host and ":" in base.host else (base.host or "0.0.0.0")
    url = urlunsplit(("udp" if base.scheme == "udp" else "rtp", f"{host}:{base.port}", "", urlencode(query), ""))
    kind = "mpegts" if base.scheme == "udp" else None
    name = f"{base.scheme}://{host}:{base.port}{parts.path}"
    return replace(base, url=url, name=name, is_listener=True, container_format=kind)


def _srt(base: Address) -> Address:
    if base.port is None:
        raise UsageError(f"{base.name}: a port is missing: write srt://0.0.0.0:9000 to listen")
    query = dict(parse_qsl(urlsplit(base.url).query))
    listens = base.host in (*_ANY_HOST, None) or query.get("mode") == "listener"
    return replace(base, is_listener=listens, container_format="mpegts")


def _http(base: Address) -> Address:
    options = {**base.options, "protocol_whitelist": _NETWORK_ONLY}
    if urlsplit(base.url).path.lower().endswith(".m3u8"):
        options = {"protocol_whitelist": _NETWORK_ONLY, "live_start_index": "-2"}
    return replace(base, options=options)


def _tcp(base: Address) -> Address:
    if base.port is None:
        raise UsageError(f"{base.name}: a port is missing: write tcp://192.168.1.10:5000")
    listens = ("listen", "1") in parse_qsl(urlsplit(base.url).query) or base.host in _ANY_HOST
    url = (
        base.url if not listens or "listen=" in base.url else base.url + ("&" if "?" in base.url else "?") + "listen=1"
    )
    return replace(base, url=url, is_listener=listens)


_RULES = {
    "rtsp": _rtsp, "rtsps": _rtsp, "rtmp": _rtmp, "rtmps": _rtmp, "udp": _udp, "rtp": _udp, "srt": _srt, "http": _http,
    "https": _http, "tcp": _tcp,
}  # fmt: skip


def _is_device(source: str) -> bool:
    return source.startswith(("/dev/video", "device:", "v4l2:"))


def _device(source: str) -> Address:
    """Return a capture device: ``/dev/video0``, ``device:0`` or ``device:NAME``."""
    name = source.split(":", 1)[1].removeprefix("//") if source.startswith(("device:", "v4l2:")) else source
    if not name:
        raise UsageError("name the device: device:0, device:/dev/video0, or its name as the system shows it")
    if sys.platform == "darwin":
        kind, url = "avfoundation", f"{name}:none"
    elif sys.platform == "win32":
        kind, url = "dshow", f"video={name}"
    else:
        kind, url = "v4l2", f"/dev/video{name}" if name.isdigit() else name
    return Address(
        url, source, "device", container_format=kind,
        # compressed pictures first: they can be recorded as they came
        attempts=({"input_format": "h264"}, {"input_format": "mjpeg"}, {}) if kind == "v4l2" else ({},),
    )  # fmt: skip


def _without_password(url: str) -> str:
    parts = urlsplit(url)
    if "@" in parts.netloc:
        parts = parts._replace(netloc=parts.netloc.rsplit("@", 1)[1])
    return urlunsplit(parts)


def _without_query(url: str, name: str) -> str:
    parts = urlsplit(url)
    kept = [(k, v) for k, v in parse_qsl(parts.query) if k != name]
    return urlunsplit(parts._replace(query=urlencode(kept)))
