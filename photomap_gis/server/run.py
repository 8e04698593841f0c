"""The socket and the process: bound before anything is promised, ended by ^C, and never longer than asked."""

from __future__ import annotations

import errno
import logging
import socket
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette

from photomap_gis.core.errors import OutputError, UsageError

DEFAULT_PORT = 8765


class BoundServer:
    """A listening socket; ``serve`` answers on it until the process is told to stop."""

    def __init__(self, host: str, port: int | None) -> None:
        """Bind ``host``; ``port`` ``None`` takes the usual one or any that is free, 0 any.

        ``UsageError`` for a host that is not this machine's, ``OutputError`` where the port cannot be had.
        """
        self._socket = _bound(host, DEFAULT_PORT if port is None else port, fall_back=port is None)
        self.host = host
        self.port: int = self._socket.getsockname()[1]
        self._server: uvicorn.Server | None = None

    @property
    def url(self) -> str:
        """The address to type into a browser: one that other machines know, where they are let in."""
        host = self.host
        if host in ("0.0.0.0", "::", ""):
            host = _address_in_the_network()
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"

    def serve(self, app: Starlette, on_ready: Callable[[], None]) -> None:
        """Answer until ^C or SIGTERM; ``on_ready`` is called when the first request could be."""
        config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="on",
            timeout_graceful_shutdown=2,
            server_header=False,
            h11_max_incomplete_event_size=64 << 10,
        )
        self._server = _Announcing(config, on_ready, getattr(app.state, "end_streams", None))
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """Ask the server to end; may be called from any thread."""
        if self._server is not None:
            self._server.should_exit = True


class _Announcing(uvicorn.Server):
    def __init__(
        self, config: uvicorn.Config, on_ready: Callable[[], None], end_streams: Callable[[], None] | None
    ) -> None:
        super().__init__(config)
        self._on_ready, self._end_streams = on_ready, end_streams

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        # The application learns of its end only when all connections have ended: those that never would are told first.
        if self._end_streams is not None:
            self._end_streams()
        await super().shutdown(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._on_ready()


def _address_in_the_network() -> str:
    """Return this machine's address towards others; loopback where it has none. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # TEST-NET-1 (RFC 5737): only the route to it is looked up
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _bound(host: str, port: int, *, fall_back: bool) -> socket.socket:
    if not 0 <= port <= 65535:
        raise UsageError(f"the port must lie between 0 and 65535, got {port}")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    except (socket.gaierror, UnicodeError) as error:
        raise UsageError(f"--host {host} is no address of this machine: try 127.0.0.1, or 0.0.0.0 for all") from error
    sock = socket.socket(family, socket.SOCK_STREAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
        sock.listen(128)
        sock.set_inheritable(False)
    except OSError as error:
        sock.close()
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            if fall_back:
                return _bound(host, 0, fall_back=False)
            raise OutputError(f"port {port} cannot be had: choose another by --port, or 0 for any") from error
        if error.errno == errno.EADDRNOTAVAIL:
            raise UsageError(
                f"--host {host} is no address of this machine: try 127.0.0.1, or 0.0.0.0 for all"
            ) from error
        raise OutputError(f"cannot listen on {host}, port {port}: {error.strerror}") from error
    logging.getLogger(__name__).info("listening on %s, port %d", host, sock.getsockname()[1])
    return sock
