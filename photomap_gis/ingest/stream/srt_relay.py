"""SRT, where FFmpeg's build (that of PyAV's wheels) lacks it: a relay of the system turns it into UDP on loopback."""

from __future__ import annotations

import shutil
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from photomap_gis.core.errors import LinkError, MissingExtraError
from photomap_gis.ingest.stream.addresses import Address, address_of
from photomap_gis.ingest.stream.connect import Connection, Limits, NobodySendsError, connect

_MISSING = (
    "{name}: SRT needs a relay, which is not installed: 'srt-live-transmit' (package srt-tools) or 'ffmpeg'; "
    "or have the sender send UDP or RTMP"
)


class SrtRelay:
    """A ``Connector`` through ``srt-live-transmit`` or ``ffmpeg``; ``MissingExtraError`` where neither is there."""

    def __init__(self, address: Address) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self._command = relay_command(address, self._port)
        self._process: subprocess.Popen[bytes] | None = None

    def connect(self, address: Address, limits: Limits) -> Connection:
        """Have the relay running, and open what it sends."""
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
        inner = replace(address_of(f"udp://127.0.0.1:{self._port}"), name=address.name)
        try:
            return connect(inner, limits)
        except NobodySendsError as error:
            if address.is_listener:
                raise
            raise LinkError(f"{address.name}: no answer within {limits.listen_s:g} s; check the address") from error

    def close(self) -> None:
        """End the relay."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def relay_command(address: Address, port: int) -> Sequence[str]:
    """Return the command that carries an SRT address to a loopback port, as far as one is installed."""
    target = f"udp://127.0.0.1:{port}"
    program = shutil.which("srt-live-transmit")
    if program is not None:
        return [program, "-a:yes", "-q", with_mode(address), target]
    program = shutil.which("ffmpeg")
    if program is not None:
        url = with_mode(address)
        return [program, "-v", "error", "-i", url, "-map", "0:v", "-map", "0:d?", "-c", "copy", "-f", "mpegts",
                f"{target}?pkt_size=1316"]  # fmt: skip
    raise MissingExtraError(_MISSING.format(name=address.name))


def with_mode(address: Address) -> str:
    """Return the SRT address with the mode that it means said in it."""
    parts = urlsplit(address.url)
    query = dict(parse_qsl(parts.query))
    query.setdefault("mode", "listener" if address.is_listener else "caller")
    host = parts.netloc if parts.hostname else f"0.0.0.0:{address.port}"
    return urlunsplit(parts._replace(netloc=host, query=urlencode(query)))
