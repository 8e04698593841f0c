"""Metadata with known truth in a transport stream: KLV packets put before the pictures of one that FFmpeg made."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

PID = 0x1F0
PACKET = 188


def with_metadata(video: Path, target: Path, packets: Mapping[int, bytes], *, rate_hz: float, sync: bool) -> Path:
    """Write a copy of ``video`` (frames in order, at one rate) with a packet before each picture that has one.

    Asynchronous: a private stream without time stamps, registered as KLVA. Synchronous: a metadata stream with the
    picture's time stamp and a header around each packet (ST 1402).
    """
    data = video.read_bytes()
    out: list[bytes] = []
    counter = picture = -1
    pmt = video_pid = None
    for at in range(0, len(data), PACKET):
        packet = data[at : at + PACKET]
        pid, begins = (packet[1] & 0x1F) << 8 | packet[2], bool(packet[1] & 0x40)
        if pid == 0 and begins:
            pmt = (packet[15] & 0x1F) << 8 | packet[16]
        elif pid == pmt and begins:
            section = packet[5:]
            length = (section[1] & 0xF) << 8 | section[2]
            body = section[: 3 + length - 4]
            info = (body[10] & 0xF) << 8 | body[11]
            video_pid = (body[13 + info] & 0x1F) << 8 | body[14 + info]
            packet = packet[:4] + b"\0" + _map_with(body, sync=sync)
            packet += b"\xff" * (PACKET - len(packet))
        elif pid == video_pid and begins:
            picture += 1
            if picture in packets:
                unit = _unit(packets[picture], round(picture / rate_hz * 90_000), sync=sync)
                for n, start in enumerate(range(0, len(unit), PACKET - 4)):
                    counter += 1
                    out.append(_packet(unit[start : start + PACKET - 4], first=n == 0, counter=counter & 15))
        out.append(packet)
    target.write_bytes(b"".join(out))
    return target


def _map_with(body: bytes, *, sync: bool) -> bytes:
    words = b"\x26\x09\x01\x00\xffKLVA\x00\x0f" if sync else b"\x05\x04KLVA"
    body += bytes([0x15 if sync else 6, 0xE0 | PID >> 8, PID & 0xFF, 0xF0, len(words)]) + words
    body = body[:1] + bytes([0xB0 | (len(body) + 1) >> 8, (len(body) + 1) & 0xFF]) + body[3:]
    return body + _crc(body)


def _unit(data: bytes, pts: int, *, sync: bool) -> bytes:
    head = b"\x80\0\0"
    if sync:
        data = bytes([0, 0, 0xDF]) + len(data).to_bytes(2, "big") + data
        head = bytes([0x80, 0x80, 5, 0x21 | pts >> 29 & 0xE, pts >> 22 & 0xFF, 1 | pts >> 14 & 0xFE, pts >> 7 & 0xFF,
                      1 | pts << 1 & 0xFE])  # fmt: skip
    return b"\0\0\1" + bytes([0xFC if sync else 0xBD]) + (len(head) + len(data)).to_bytes(2, "big") + head + data


def _packet(payload: bytes, *, first: bool, counter: int) -> bytes:
    pad = PACKET - 4 - len(payload)
    head = bytes([0x47, (0x40 if first else 0) | PID >> 8, PID & 0xFF, (0x30 if pad else 0x10) | counter])
    if not pad:
        return head + payload
    return head + bytes([pad - 1]) + (b"\0" + b"\xff" * (pad - 2) if pad > 1 else b"") + payload


def _crc(data: bytes) -> bytes:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = ((crc << 1) ^ 0x04C11DB7 if crc & 0x80000000 else crc << 1) & 0xFFFFFFFF
    return crc.to_bytes(4, "big")
