"""The door at which drones' apps push RTMP: open all the time, with limits of its own.

FFmpeg can listen, but only for one client, not while it is being opened anew, and a client that falls silent amid the
conversation holds it for ever. So the socket that is shown to the world is ours; when somebody knocks, FFmpeg listens
on a loopback port, and bytes are carried both ways until either side ends or is silent too long.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import threading
from dataclasses import replace
from urllib.parse import urlsplit, urlunsplit

from photomap_gis.core.errors import LinkError
from photomap_gis.ingest.stream.addresses import Address
from photomap_gis.ingest.stream.connect import Connection, Limits, NobodySendsError, connect

_CHUNK = 1 << 16
_LISTENS_WITHIN_S = 5.0
_PATIENCE = 4.0
"""Silence that ends a conversation, in stall times: the reader behind notices before."""


class RtmpDoor:
    """A ``Connector`` that waits for a client at the address and lets it in; ``LinkError`` where the port is taken."""

    def __init__(self, address: Address) -> None:
        assert address.port is not None  # the rule for the scheme gives one
        family = socket.AF_INET6 if address.host and ":" in address.host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((address.host or "0.0.0.0", address.port))
            self._socket.listen(4)
        except OSError as error:
            self._socket.close()
            if error.errno == errno.EADDRINUSE:
                why = "the port is in use by another program; choose another one"
            elif error.errno == errno.EACCES:
                why = "ports below 1024 are not allowed here; choose another one"
            else:
                why = f"cannot listen there ({error.strerror or error}); 0.0.0.0 means all of this machine's addresses"
            raise LinkError(f"{address.name}: {why}") from error
        self._carriers: list[_Carrier] = []

    def connect(self, address: Address, limits: Limits) -> Connection:
        """Wait for a client and return its stream."""
        self._end_carriers()
        try:
            self._socket.settimeout(limits.listen_s)
            client, _ = self._socket.accept()
        except TimeoutError as error:
            raise NobodySendsError(f"{address.name}: nobody has sent anything for {limits.listen_s:g} s") from error
        except OSError as error:
            raise LinkError(f"{address.name}: no longer listening ({error.strerror or error})") from error
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self._carriers.append(_Carrier(client, port, max(_PATIENCE * limits.stall_s, 1.0)))
        parts = urlsplit(address.url)
        inner = replace(address, url=urlunsplit(parts._replace(netloc=f"127.0.0.1:{port}")))
        try:
            return connect(inner, replace(limits, listen_s=max(limits.open_s, 2.0 * _PATIENCE * limits.stall_s)))
        except BaseException:
            self._end_carriers()
            raise

    def close(self) -> None:
        """Shut the door; a wait in progress ends."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._end_carriers()

    def _end_carriers(self) -> None:
        while self._carriers:
            self._carriers.pop().close()


class _Carrier:
    """Carries bytes between a client and FFmpeg's loopback port, in two threads."""

    def __init__(self, client: socket.socket, port: int, silence_s: float) -> None:
        self._client = client
        self._port, self._silence_s = port, silence_s
        self._inner: socket.socket | None = None
        self._ended = threading.Event()
        client.settimeout(silence_s)
        threading.Thread(target=self._run, name="photomap rtmp", daemon=True).start()

    def close(self) -> None:
        """End both sides."""
        self._ended.set()
        for side in (self._client, self._inner):
            if side is not None:
                with contextlib.suppress(OSError):
                    side.shutdown(socket.SHUT_RDWR)
                side.close()

    def _run(self) -> None:
        self._inner = self._reach()
        if self._inner is None:
            self.close()
            return
        threading.Thread(target=self._carry, args=(self._inner, self._client), daemon=True).start()
        self._carry(self._client, self._inner)

    def _reach(self) -> socket.socket | None:
        """Connect to FFmpeg, which begins to listen about now."""
        for _ in range(round(_LISTENS_WITHIN_S / 0.05)):
            if self._ended.is_set():
                return None
            with contextlib.suppress(OSError):
                return socket.create_connection(("127.0.0.1", self._port), timeout=self._silence_s)
            self._ended.wait(0.05)
        return None

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        is_client = source is self._client
        try:
            while not self._ended.is_set():
                try:
                    data = source.recv(_CHUNK)
                except TimeoutError:
                    if is_client:
                        break
                    continue  # our side may have nothing to say for hours
                if not data:
                    break
                target.sendall(data)
        except OSError:
            pass
        self.close()
