"""TIFF, taken apart and laid out anew: the directories of files that GDAL wrote, and one cloud-optimised file of them.

GDAL packs the blocks (any compression, in threads); here they are only put in the order that makes a file
cloud-optimised: all directories first, then the widest overview's blocks, the full resolution's last, row by row.
Specifications: TIFF 6.0, BigTIFF, and GDAL's "COG -- Cloud Optimized GeoTIFF generator", header ghost area.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from photomap_gis.core.errors import OutputError

_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_CODES = {3: "H", 4: "I", 16: "Q"}
_SUBFILE, _OFFSETS, _COUNTS = 254, 324, 325
REDUCED, MASK = 1, 4
_CLASSIC_LIMIT = 4_000_000_000
# The last space leaves room for a YES, by which a program says that it has edited the file without regard to the order.
_LAYOUT = (
    "LAYOUT=IFDS_BEFORE_DATA\nBLOCK_ORDER=ROW_MAJOR\nBLOCK_LEADER=SIZE_AS_UINT4\n"
    "BLOCK_TRAILER=LAST_4_BYTES_REPEATED\nKNOWN_INCOMPATIBLE_EDITION=NO\n "
)
_AROUND = 8  # bytes of a block's leader and trailer


@dataclass(frozen=True, slots=True)
class Field:
    """A tag's value: its number type, how many, and the bytes (little-endian)."""

    kind: int
    count: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Directory:
    """A picture of a TIFF: its tags but for blocks, and where its blocks lie in ``path`` (0, 0: empty)."""

    path: Path
    fields: dict[int, Field]
    offsets: tuple[int, ...]
    counts: tuple[int, ...]

    def as_kind(self, subfile: int) -> Directory:
        """Return the same picture as an overview, a mask, or both."""
        fields = {**self.fields, _SUBFILE: Field(4, 1, struct.pack("<I", subfile))}
        return Directory(self.path, fields, self.offsets, self.counts)


def read_directories(path: Path) -> list[Directory]:
    """Return the pictures of a little-endian BigTIFF in tiles; ``OutputError`` where it is none."""
    found = []
    with path.open("rb") as file:
        head = file.read(16)
        if head[:8] != b"II\x2b\x00\x08\x00\x00\x00":
            raise OutputError(f"{path.name} is no BigTIFF: this GDAL writes what nobody expected")
        (at,) = struct.unpack_from("<Q", head, 8)
        while at:
            file.seek(at)
            (entries,) = struct.unpack("<Q", file.read(8))
            table = file.read(20 * entries + 8)
            fields = dict(_field(file, table, 20 * i) for i in range(entries))
            (at,) = struct.unpack_from("<Q", table, 20 * entries)
            offsets, counts = (_numbers(fields.pop(tag)) for tag in (_OFFSETS, _COUNTS))
            found.append(Directory(path, fields, offsets, counts))
    return found


def write_cog(directories: Sequence[Directory], path: Path) -> None:
    """Write one file of pictures given in the order of their directories, the full resolution first."""
    ghost = f"GDAL_STRUCTURAL_METADATA_SIZE={len(_LAYOUT):06d} bytes\n{_LAYOUT}".encode()
    blocks = sum(sum(d.counts) + _AROUND * len(d.counts) for d in directories)
    tags = sum(sum(len(f.data) + 24 for f in d.fields.values()) + 16 * len(d.offsets) + 64 for d in directories)
    big = blocks + tags > _CLASSIC_LIMIT
    start = (16 if big else 8) + len(ghost)
    start += -start % 8
    sizes = [_directory_size(d, big) for d in directories]
    places = [start + sum(sizes[:i]) for i in range(len(sizes))]
    end = start + sum(sizes)
    offsets: dict[int, list[int]] = {}
    order = sorted(range(len(directories)), key=lambda i: -i)
    for i in order:
        offsets[i] = []
        for count in directories[i].counts:
            offsets[i].append(end + _AROUND // 2 if count else 0)
            end += count + _AROUND if count else 0
    with path.open("wb") as out:
        out.write(
            b"II\x2b\x00\x08\x00\x00\x00" + struct.pack("<Q", start)
            if big
            else b"II\x2a\x00" + struct.pack("<I", start)
        )
        out.write(ghost)
        out.write(bytes(start - out.tell()))
        for i, d in enumerate(directories):
            after = places[i + 1] if i + 1 < len(directories) else 0
            out.write(_packed(d, offsets[i], places[i], after, big))
        for i in order:
            _copy_blocks(directories[i], out)


def _field(file: IO[bytes], table: bytes, at: int) -> tuple[int, Field]:
    tag, kind, count = struct.unpack_from("<HHQ", table, at)
    size = _SIZES[kind] * count
    if size <= 8:
        return tag, Field(kind, count, table[at + 12 : at + 12 + size])
    (where,) = struct.unpack_from("<Q", table, at + 12)
    here = file.tell()
    file.seek(where)
    data = file.read(size)
    file.seek(here)
    return tag, Field(kind, count, data)


def _numbers(field: Field) -> tuple[int, ...]:
    return struct.unpack(f"<{field.count}{_CODES[field.kind]}", field.data)


def _all_fields(directory: Directory, offsets: Sequence[int], big: bool) -> list[tuple[int, Field]]:
    n = len(offsets)
    places = Field(16, n, struct.pack(f"<{n}Q", *offsets)) if big else Field(4, n, struct.pack(f"<{n}I", *offsets))
    counts = Field(4, n, struct.pack(f"<{n}I", *directory.counts))
    return sorted({**directory.fields, _OFFSETS: places, _COUNTS: counts}.items())


def _directory_size(directory: Directory, big: bool) -> int:
    fields = _all_fields(directory, (0,) * len(directory.offsets), big)
    inline = 8 if big else 4
    table = 16 + 20 * len(fields) if big else 6 + 12 * len(fields)
    outside = sum(len(f.data) + -len(f.data) % 8 for _, f in fields if len(f.data) > inline)
    return table + -table % 8 + outside


def _packed(directory: Directory, offsets: Sequence[int], place: int, after: int, big: bool) -> bytes:
    fields = _all_fields(directory, offsets, big)
    inline, word = (8, "Q") if big else (4, "I")
    table = 16 + 20 * len(fields) if big else 6 + 12 * len(fields)
    at = place + table + -table % 8
    entries, outside = bytearray(struct.pack("<Q" if big else "<H", len(fields))), bytearray()
    for tag, f in fields:
        entries += struct.pack(f"<HH{word}", tag, f.kind, f.count)
        if len(f.data) <= inline:
            entries += f.data.ljust(inline, b"\0")
        else:
            entries += struct.pack(f"<{word}", at + len(outside))
            outside += f.data + bytes(-len(f.data) % 8)
    entries += struct.pack(f"<{word}", after)
    return bytes(entries + bytes(-len(entries) % 8) + outside)


def _copy_blocks(directory: Directory, out: IO[bytes]) -> None:
    with directory.path.open("rb") as file:
        for offset, count in zip(directory.offsets, directory.counts, strict=True):
            if not count:
                continue
            file.seek(offset)
            data = file.read(count)
            if len(data) != count:
                raise OutputError(f"{directory.path.name} is cut short; check the disk")
            out.write(struct.pack("<I", count) + data + data[-4:].rjust(4, b"\0"))
