"""The tag directories of a TIFF file or of an EXIF block, read so that no hostile file can hurt.

Only what is asked for is read; every offset and count is checked against the data's length, loops between directories
end, and an entry that makes no sense is left out instead of raising. Rationals keep numerator and denominator: the
denominator tells how finely a position was written.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

MAX_VALUE_BYTES = 1 << 20
MAX_ENTRIES = 4096

TAG_EXIF_IFD = 0x8769
TAG_GPS_IFD = 0x8825


class Rational(NamedTuple):
    """A fraction as it is stored."""

    numerator: int
    denominator: int

    @property
    def value(self) -> float | None:
        """The fraction's value, ``None`` where the denominator is zero."""
        return self.numerator / self.denominator if self.denominator else None


TagValue = str | bytes | tuple[int, ...] | tuple[float, ...] | tuple[Rational, ...]

_ASCII, _RATIONAL, _SRATIONAL = 2, 5, 10
_FORMATS = {1: "B", 2: "s", 3: "H", 4: "I", 6: "b", 7: "s", 8: "h", 9: "i", 11: "f", 12: "d", 13: "I"}
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}


class Bytes(Protocol):
    """What can be sliced into bytes: ``bytes`` itself, or a memory map of a file."""

    def __len__(self) -> int: ...

    def __getitem__(self, where: slice, /) -> bytes: ...


@dataclass(frozen=True, slots=True)
class TiffTags:
    """The values of the first directory, of the EXIF directory and of the GPS directory, by tag number."""

    main: Mapping[int, TagValue] = field(default_factory=dict)
    exif: Mapping[int, TagValue] = field(default_factory=dict)
    gps: Mapping[int, TagValue] = field(default_factory=dict)


def read_tags(data: Bytes) -> TiffTags:
    """Return the tags of a TIFF file or of an EXIF block without its ``Exif`` prefix; empty where it is neither."""
    head = bytes(data[0:8])
    if len(head) < 8 or head[:2] not in (b"II", b"MM"):
        return TiffTags()
    order = "<" if head[:2] == b"II" else ">"
    magic, first = struct.unpack(order + "HI", head[2:8])
    if magic != 42:  # BigTIFF (43) carries no photo of a drone
        return TiffTags()
    main = _read_directory(data, first, order)
    return TiffTags(
        main,
        _read_directory(data, _pointer(main, TAG_EXIF_IFD), order),
        _read_directory(data, _pointer(main, TAG_GPS_IFD), order),
    )


def _pointer(tags: Mapping[int, TagValue], tag: int) -> int:
    value = tags.get(tag)
    return value[0] if isinstance(value, tuple) and value and isinstance(value[0], int) else 0


def _read_directory(data: Bytes, offset: int, order: str) -> dict[int, TagValue]:
    """Return the directory at ``offset``: as many of its entries as lie within the data and make sense."""
    if offset < 8 or offset + 2 > len(data):
        return {}
    (count,) = struct.unpack(order + "H", data[offset : offset + 2])
    body = bytes(data[offset + 2 : offset + 2 + 12 * min(count, MAX_ENTRIES)])
    tags: dict[int, TagValue] = {}
    for at in range(0, len(body) - 11, 12):
        tag, kind, n = struct.unpack(order + "HHI", body[at : at + 8])
        size = _SIZES.get(kind, 0) * n
        if size == 0 or size > MAX_VALUE_BYTES or tag in tags:
            continue
        if size <= 4:
            raw = body[at + 8 : at + 8 + size]
        else:
            (where,) = struct.unpack(order + "I", body[at + 8 : at + 12])
            raw = bytes(data[where : where + size])
        if len(raw) == size:
            tags[tag] = _value(raw, kind, n, order)
    return tags


def _value(raw: bytes, kind: int, n: int, order: str) -> TagValue:
    if kind == _ASCII:
        return raw.split(b"\0", 1)[0].decode("utf-8", "replace").strip()
    if kind in (_RATIONAL, _SRATIONAL):
        flat = struct.unpack(f"{order}{2 * n}{'I' if kind == _RATIONAL else 'i'}", raw)
        return tuple(Rational(*pair) for pair in zip(flat[::2], flat[1::2], strict=True))
    if _FORMATS[kind] == "s":
        return raw
    values: tuple[int, ...] | tuple[float, ...] = struct.unpack(f"{order}{n}{_FORMATS[kind]}", raw)
    return values


def number(value: TagValue | None, index: int = 0) -> float | None:
    """Return one finite number of a tag's value, ``None`` where there is none (text is read as a number too)."""
    if isinstance(value, str):
        try:
            parsed = float(value)
        except ValueError:
            return None
        return parsed if abs(parsed) < float("inf") else None
    if isinstance(value, bytes):
        return float(value[index]) if index < len(value) else None
    if not isinstance(value, Sequence) or index >= len(value):
        return None
    item = value[index]
    found = item.value if isinstance(item, Rational) else float(item)
    return found if found is not None and abs(found) < float("inf") else None


def text(value: TagValue | None) -> str:
    """Return a tag's text, empty where it has none; bytes that are meant as text are read so."""
    if isinstance(value, bytes):
        return value.split(b"\0", 1)[0].decode("utf-8", "replace").strip()
    return value if isinstance(value, str) else ""
