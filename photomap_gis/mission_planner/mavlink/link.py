"""MAVLink over a transport: messages packed and parsed by pymavlink, signed where a key is given, kept in a .tlog."""

from __future__ import annotations

import hashlib
import struct
import time
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.mission_planner.mavlink.state import Message
from photomap_gis.mission_planner.mavlink.talk import Address
from photomap_gis.vehicle_link import Transport

_SIGNING_EPOCH_S = 1_420_070_400  # 2015-01-01, in steps of 10 us
_KEY_BYTES = 32
_LARGEST_KEY_FILE = 4096


class MavlinkLink:
    """A ``talk.Link`` over a transport; a context manager that closes it.

    ``tlog`` is written as it goes and not moved into place at the end: it is wanted most where a run was cut off.
    """

    def __init__(
        self, transport: Transport, me: Address, *, tlog: Path | None = None, key: bytes | None = None
    ) -> None:
        self._transport = transport
        self._queue: deque[Message] = deque()
        self._mav = mavlink.MAVLink(self, srcSystem=me.system, srcComponent=me.component)
        self._mav.robust_parsing = True
        self._target = 0
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.timestamp = int((time.time() - _SIGNING_EPOCH_S) * 1e5)
            # A telemetry radio speaks of itself, unsigned.
            self._mav.signing.allow_unsigned_callback = lambda _, number: number == mavlink.MAVLINK_MSG_ID_RADIO_STATUS
        self._tlog: BinaryIO | None = None
        if tlog is not None:
            try:
                self._tlog = tlog.open("wb")
            except OSError as error:
                transport.close()
                raise OutputError(
                    f"{tlog} cannot be written: {error.strerror or error}; choose another --tlog"
                ) from error

    def __enter__(self) -> MavlinkLink:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._transport.close()
        if self._tlog is not None:
            self._tlog.close()

    def now_s(self) -> float:
        """Return a clock that never jumps."""
        return time.monotonic()

    def send(self, message: Message) -> None:
        """Send a message."""
        self._target = getattr(message, "target_system", 0)
        self._mav.send(message)  # comes back to write()

    def write(self, packet: bytes) -> None:
        """Take a packed message from pymavlink."""
        self._log(packet)
        self._transport.write(bytes(packet), self._target)

    def receive(self, timeout_s: float) -> Message | None:
        """Return the next message, None where none came within the time."""
        end_s = self.now_s() + timeout_s
        while not self._queue:
            data = self._transport.read(max(0.0, end_s - self.now_s()))
            if data:
                self._parse(data)
            if not self._queue and self.now_s() >= end_s:  # noise must not hold the conversation up
                return None
        return self._queue.popleft()

    def _parse(self, data: bytes) -> None:
        for message in self._mav.parse_buffer(data) or ():
            # What pymavlink does not know has no checksum and no signature checked.
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
                continue
            self._log(message.get_msgbuf())
            self._queue.append(message)

    def _log(self, packet: bytes) -> None:
        if self._tlog is not None:
            self._tlog.write(struct.pack(">Q", time.time_ns() // 1000) + bytes(packet))


def read_signing_key(path: Path) -> bytes:
    """Read a key of 32 bytes, or 64 hexadecimal digits, or a passphrase, of which ground stations take the SHA-256."""
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST_KEY_FILE)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}; give the file of --signing-key") from error
    if len(content) == _KEY_BYTES:
        return content
    text = content.strip()
    if not text:
        raise DataError(f"{path} is empty: it must hold the signing key or its passphrase")
    if len(text) == 2 * _KEY_BYTES:
        try:
            return bytes.fromhex(text.decode("ascii"))
        except ValueError:
            pass
    return hashlib.sha256(text).digest()
