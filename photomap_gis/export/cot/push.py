"""Pushing events: a thread of its own, the newest of each thing, once a second at most; nobody waits for it."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from types import TracebackType

from photomap_gis.export.cot.address import CotAddress, tls_context
from photomap_gis.export.cot.events import CotFind, CotValue, encode, encode_removal

logger = logging.getLogger(__name__)

_EVERY_S = 1.0
_FIND_AGAIN_S = 60.0
"""Datagrams get lost, and devices join late."""
_MOST_WAITING = 1000
_MOST_FINDS = 5000
_CONNECT_S, _SEND_S = 10.0, 5.0
_FIRST_RETRY_S, _LAST_RETRY_S = 1.0, 30.0


@dataclass(frozen=True, slots=True)
class CotState:
    """How the push goes: ``sent`` events, ``dropped`` ones, and what keeps it from sending now, if anything."""

    sent: int
    dropped: int
    is_connected: bool
    problem: str | None


class CotPusher:
    """Sends what it is told to one receiver (a context manager). All methods return at once, from any thread.

    Of each ``uid`` the newest value is sent, at most every ``every_s``; finds again every minute. What cannot be sent
    while the link is away is replaced by what is newer.
    """

    def __init__(
        self,
        address: CotAddress,
        *,
        every_s: float = _EVERY_S,
        now_utc: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._address, self._every_s, self._now_utc = address, every_s, now_utc
        self._waiting: OrderedDict[str, CotValue | None] = OrderedDict()  # None: take it away
        self._finds: OrderedDict[str, tuple[CotFind, float]] = OrderedDict()
        self._sent_s: OrderedDict[str, float] = OrderedDict()
        self._changed = threading.Condition()
        self._closing = False
        self._socket: socket.socket | None = None
        self._sent = self._dropped = 0
        self._problem: str | None = None
        self._thread = threading.Thread(target=self._run, name="photomap cot", daemon=True)
        self._thread.start()

    def __enter__(self) -> CotPusher:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def put(self, value: CotValue) -> None:
        """Send a value soon."""
        self._put(value.uid, value)

    def remove(self, uid: str) -> None:
        """Take something away from the devices, a find that was none."""
        self._put(uid, None)

    def state(self) -> CotState:
        """Return how it goes."""
        with self._changed:
            return CotState(self._sent, self._dropped, self._socket is not None, self._problem)

    def close(self, timeout_s: float = 3.0) -> None:
        """Send what waits, as far as that goes in a moment, and end; idempotent."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        self._disconnect()

    def _put(self, uid: str, value: CotValue | None) -> None:
        with self._changed:
            if uid in self._waiting:
                self._dropped += 1
            self._waiting[uid] = value
            while len(self._waiting) > _MOST_WAITING:
                self._waiting.popitem(last=False)
                self._dropped += 1
            self._changed.notify_all()

    def _run(self) -> None:
        retry_s, retry_at_s = _FIRST_RETRY_S, 0.0
        while True:
            with self._changed:
                now_s = time.monotonic()
                self._repeat_finds(now_s)
                due = [u for u in self._waiting if self._closing or now_s - self._sent_s.get(u, -1e9) >= self._every_s]
                if (not due or now_s < retry_at_s) and not self._closing:
                    self._changed.wait(self._nap_s(now_s, retry_at_s))
                    continue
                if self._closing and (not due or (self._socket is None and now_s < retry_at_s)):
                    return
                batch = [(u, self._waiting.pop(u)) for u in due]
            try:
                self._send(batch)
                retry_s = _FIRST_RETRY_S
            except (OSError, ValueError) as error:
                self._disconnect()
                with self._changed:
                    self._problem = _words(self._address, error)
                    for uid, value in batch:  # unless something newer has come meanwhile
                        self._waiting.setdefault(uid, value)
                logger.info("%s; again in %.0f s", self._problem, retry_s)
                retry_at_s = time.monotonic() + retry_s
                retry_s = min(2.0 * retry_s, _LAST_RETRY_S)

    def _nap_s(self, now_s: float, retry_at_s: float) -> float:
        """Until when there is nothing to do, unless something is told."""
        if self._waiting:
            dues = [self._sent_s.get(u, 0.0) + self._every_s for u in self._waiting]
            return max(0.01, max(min(dues), retry_at_s) - now_s)
        return _FIND_AGAIN_S if self._finds else 3600.0

    def _repeat_finds(self, now_s: float) -> None:
        for uid, (find, sent_s) in self._finds.items():
            if now_s - sent_s >= _FIND_AGAIN_S:
                self._waiting.setdefault(uid, find)

    def _send(self, batch: list[tuple[str, CotValue | None]]) -> None:
        link = self._connected()
        self._drain(link)
        for uid, value in batch:
            now = self._now_utc()
            try:
                document = encode_removal(uid, now) if value is None else encode(value, now)
            except ValueError as error:
                logger.warning("an event was left out: %s", error)
                with self._changed:
                    self._dropped += 1
                continue
            link.sendall(document)
            with self._changed:
                self._sent += 1
                self._problem = None
                now_s = time.monotonic()
                self._sent_s[uid] = now_s
                self._sent_s.move_to_end(uid)
                while len(self._sent_s) > _MOST_FINDS:
                    self._sent_s.popitem(last=False)
                if isinstance(value, CotFind):
                    self._finds[uid] = value, now_s
                    while len(self._finds) > _MOST_FINDS:
                        self._finds.popitem(last=False)
                elif value is None:
                    self._finds.pop(uid, None)

    def _connected(self) -> socket.socket:
        if self._socket is None:
            self._socket = _open(self._address)
        return self._socket

    def _drain(self, link: socket.socket) -> None:
        """Throw away what a server says of others: unread, it would stop the connection."""
        if self._address.scheme == "udp":
            return
        link.settimeout(0.0)
        try:
            for _ in range(64):
                if not link.recv(1 << 16):
                    raise ConnectionResetError("the server closed the connection")
        except (BlockingIOError, InterruptedError):
            pass
        except OSError as error:
            if type(error).__name__ not in ("SSLWantReadError", "SSLWantWriteError"):
                raise
        finally:
            link.settimeout(_SEND_S)

    def _disconnect(self) -> None:
        with self._changed:
            link, self._socket = self._socket, None
        if link is not None:
            with contextlib.suppress(OSError):
                link.close()


def _open(address: CotAddress) -> socket.socket:
    """Return a connected socket with limits on its waits."""
    if address.scheme == "udp":
        family, _, _, _, place = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0]
        link = socket.socket(family, socket.SOCK_DGRAM)
        try:
            link.settimeout(_SEND_S)
            if address.is_multicast and family == socket.AF_INET:
                link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, address.ttl)
                if address.interface is not None:
                    link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address.interface))
            elif address.is_multicast:
                link.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, address.ttl)
            link.connect(place)
        except BaseException:
            link.close()
            raise
        return link
    link = socket.create_connection((address.host, address.port), timeout=_CONNECT_S)
    try:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if address.scheme == "tls":
            link = tls_context(address).wrap_socket(link, server_hostname=address.tls.server_name or address.host)
        link.settimeout(_SEND_S)
    except BaseException:
        link.close()
        raise
    return link


def _words(address: CotAddress, error: Exception) -> str:
    if isinstance(error, ConnectionRefusedError):
        return f"{address.name}: refused: no TAK server listens there"
    if isinstance(error, TimeoutError):
        return f"{address.name}: no answer; check the address and the network"
    if isinstance(error, socket.gaierror):
        return f"{address.name}: there is no host of that name"
    if "CERTIFICATE_VERIFY_FAILED" in str(error):
        why = getattr(error, "verify_message", "") or "not trusted"
        return f"{address.name}: the server's certificate is not accepted ({why}); give its authority by --cot-ca"
    return f"{address.name}: {getattr(error, 'strerror', None) or error}"
