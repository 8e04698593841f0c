"""Bytes to and from a vehicle: serial ports, UDP and TCP, as ``--connect`` names them."""

from __future__ import annotations

import contextlib
import errno
import re
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from photomap_gis.core.errors import LinkError, UsageError

EXAMPLES = "udpin:0.0.0.0:14550, udpout:192.168.1.10:14550, tcp:127.0.0.1:5760 or serial:/dev/ttyUSB0:57600"
_DEFAULT_BAUD = 57_600
_DEFAULT_PORTS = {"udpin": 14550, "udpout": 14550, "tcp": 5760, "tcpin": 5760}
_SCHEMES = {"udp": "udp", "udpin": "udpin", "udpout": "udpout", "udpci": "udpout", "tcp": "tcp", "tcpout": "tcp",
            "tcpin": "tcpin", "serial": "serial"}  # fmt: skip
_LOOKS_SERIAL = re.compile(r"(/dev/|COM\d+|/)", re.IGNORECASE)
_RECONNECT_S = 1.0
_READ_BYTES = 65_536
_MOST_PEERS = 16


class Transport(Protocol):
    """A way for bytes; a broken one drops what is written and comes back by itself."""

    def write(self, packet: bytes, system: int) -> None:
        """Send a packet to a system (0: to all)."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, nothing where nothing came in time."""

    def close(self) -> None:
        """Let go of it."""


@dataclass(frozen=True, slots=True)
class Url:
    """Where to connect: ``scheme`` is udp, udpin, udpout, tcp, tcpin or serial; ``port`` a serial line's baud rate."""

    scheme: str
    host: str
    port: int


def parse_url(text: str) -> Url:
    """Read ``--connect``: pymavlink's and MAVSDK's ways to write it.

    >>> parse_url("tcp:127.0.0.1:5760")
    Url(scheme='tcp', host='127.0.0.1', port=5760)
    >>> parse_url("udpin://0.0.0.0:14540").port, parse_url("/dev/ttyACM0").port
    (14540, 57600)
    """
    text = text.strip()
    scheme, _, rest = text.partition(":")
    if scheme.lower() not in _SCHEMES:
        if _LOOKS_SERIAL.match(text):
            scheme, rest = "serial", text
        elif re.fullmatch(r"[\w.\-]+:\d+", text):
            scheme, rest = "udp", text  # as pymavlink reads a bare address
        else:
            raise UsageError(f"--connect {text!r} is no address of a vehicle: write {EXAMPLES}")
    scheme = _SCHEMES[scheme.lower()]
    rest = rest.removeprefix("//")
    if scheme == "serial":
        return _serial_url(text, rest)
    host, colon, port_text = rest.rpartition(":")
    if not colon:
        host, port_text = rest, str(_DEFAULT_PORTS.get(scheme, 14550))
    host = host.strip("[]") or ("0.0.0.0" if scheme in ("udp", "udpin", "tcpin") else "127.0.0.1")
    if not port_text.isdigit() or not 0 < int(port_text) < 65_536:
        raise UsageError(f"--connect {text!r}: {port_text!r} is no port; write {EXAMPLES}")
    return Url(scheme, host, int(port_text))


def _serial_url(text: str, rest: str) -> Url:
    device, _, baud = re.sub(r",(\d+)$", r":\1", rest).rpartition(":")
    if not device or not baud.isdigit():
        device, baud = rest, str(_DEFAULT_BAUD)
    if not device:
        raise UsageError(f"--connect {text!r} names no serial port; write {EXAMPLES}")
    return Url("serial", device, int(baud))


def open_transport(url: Url) -> Transport:
    """Open a transport. Raises ``LinkError`` where that cannot work; a TCP peer may still be on its way up."""
    if url.scheme == "serial":
        return SerialLine(url.host, url.port)
    if url.scheme == "tcp":
        return TcpClient(url.host, url.port)
    if url.scheme == "tcpin":
        return TcpServer(url.host, url.port)
    if url.scheme == "udpout":
        return Udp(listens_at=None, sends_to=(url.host, url.port))
    try:
        return Udp(listens_at=(url.host, url.port), sends_to=None)
    except LinkError:
        # "udp:" is read both ways by people: where the port is taken here or the host is another machine, it is the
        # vehicle's own.
        if url.scheme != "udp" or url.host == "0.0.0.0":
            raise
        return Udp(listens_at=None, sends_to=(url.host, url.port))


class Udp:
    """UDP: either listening, and answering to wherever a system was heard from, or sending to one address."""

    def __init__(self, *, listens_at: tuple[str, int] | None, sends_to: tuple[str, int] | None) -> None:
        at = listens_at or sends_to
        if at is None:
            raise ValueError("listens_at or sends_to must be given")
        try:
            family, _, _, _, address = socket.getaddrinfo(*at, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise LinkError(_os_words(f"{at[0]}:{at[1]}", error)) from error
        try:
            if listens_at is not None:
                self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(_os_words(f"{at[0]}:{at[1]}", error)) from error
        self._socket.setblocking(False)
        self._to = address if sends_to is not None else None
        self._peers: dict[int, tuple[str, int]] = {}  # where each system was heard from

    def write(self, packet: bytes, system: int) -> None:
        """Send a packet to where the system was heard from, to all where it was not."""
        if self._to is not None:
            addresses = {self._to}
        elif system in self._peers:
            addresses = {self._peers[system]}
        else:
            addresses = set(self._peers.values())
        for address in addresses:
            with contextlib.suppress(OSError):
                self._socket.sendto(packet, address)

    def read(self, timeout_s: float) -> bytes:
        """Return one datagram."""
        if not select.select([self._socket], [], [], max(0.0, timeout_s))[0]:
            return b""
        try:
            packet, address = self._socket.recvfrom(_READ_BYTES)
        except OSError:  # the other side is not up yet
            return b""
        system = _system_of(packet)
        if system is not None and (system in self._peers or len(self._peers) < _MOST_PEERS):
            self._peers[system] = address
        return packet

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Stream:
    """A TCP connection that may come and go."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None

    def write(self, packet: bytes, system: int) -> None:
        if self._socket is None:
            return
        try:
            self._socket.settimeout(1.0)
            self._socket.sendall(packet)
        except OSError:
            self._drop()

    def _receive(self, timeout_s: float) -> bytes:
        connected = self._socket
        if connected is None or not select.select([connected], [], [], max(0.0, timeout_s))[0]:
            return b""
        try:
            data = connected.recv(_READ_BYTES)
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def close(self) -> None:
        """Close the connection."""
        self._drop()


class TcpClient(_Stream):
    """TCP to a vehicle, connected again whenever it is lost: a vehicle that reboots closes it."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        self._address = (host, port)
        try:
            socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except OSError as error:
            raise LinkError(_os_words(f"{host}:{port}", error)) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come; connects first where it must."""
        if self._socket is None:
            try:
                self._socket = socket.create_connection(self._address, timeout=max(0.05, min(timeout_s, _RECONNECT_S)))
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            except OSError:
                time.sleep(min(max(timeout_s, 0.0), 0.2))
            return b""
        return self._receive(timeout_s)


class TcpServer(_Stream):
    """TCP that a vehicle connects to; the last one that came is spoken to."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise LinkError(_os_words(f"{host}:{port}", error)) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come; takes a caller first where there is one."""
        sources = [self._listener] if self._socket is None else [self._listener, self._socket]
        ready = select.select(sources, [], [], max(0.0, timeout_s))[0]
        if self._listener in ready:
            self._drop()
            self._socket = self._listener.accept()[0]
            return b""
        return self._receive(0.0) if ready else b""

    def close(self) -> None:
        """Close the connection and the door."""
        self._drop()
        self._listener.close()


class SerialLine:
    """A serial port: a telemetry radio or USB. Where it is unplugged it is opened again."""

    def __init__(self, device: str, baud: int) -> None:
        import serial  # here: only serial links pay for it

        self._errors: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._open: Callable[[], Any] = lambda: serial.Serial(device, baud, timeout=0.05, write_timeout=1.0)
        try:
            self._port = self._open()
        except (*self._errors, ValueError) as error:
            raise LinkError(
                f"{device} cannot be opened ({error}): check the cable, your rights to the port (the group dialout on "
                "Linux) and that no other program has it"
            ) from error

    def write(self, packet: bytes, system: int) -> None:
        """Send a packet."""
        with contextlib.suppress(*self._errors):
            self._port.write(packet)

    def read(self, timeout_s: float) -> bytes:
        """Return what has come."""
        try:
            self._port.timeout = max(0.0, min(timeout_s, 0.2))
            data: bytes = self._port.read(max(1, self._port.in_waiting))
            return data
        except self._errors:
            time.sleep(min(max(timeout_s, 0.0), 0.2))
            with contextlib.suppress(*self._errors):
                self._port.close()
                self._port = self._open()
            return b""

    def close(self) -> None:
        """Close the port."""
        with contextlib.suppress(*self._errors):
            self._port.close()


def _system_of(packet: bytes) -> int | None:
    if len(packet) > 7 and packet[0] == 0xFD:
        return packet[5]
    if len(packet) > 5 and packet[0] == 0xFE:
        return packet[3]
    return None


def _os_words(where: str, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use here: close the other ground station, or let it forward to another port"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{where} is not an address of this machine: to send to a vehicle there, write udpout:{where}"
    return f"{where} cannot be used: {error.strerror or error}; check --connect"
