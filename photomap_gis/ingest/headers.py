"""What stands before a photo's pixels: its format, its raster's size, its EXIF tags and its XMP packet.

JPEG and TIFF are walked here: a survey has thousands of photos, and their pixels are not touched before they are
needed. The rare other formats go through Pillow.
"""

from __future__ import annotations

import mmap
import struct
import warnings
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from PIL import Image, UnidentifiedImageError

from photomap_gis.core.errors import FrameReadError
from photomap_gis.ingest.tiff_tags import TagValue, TiffTags, number, read_tags

# Every start-of-frame marker; C4, C8 and CC are tables.
_SOF = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
_SOS, _EOI, _APP1 = 0xDA, 0xD9, 0xE1
_EXIF_PREFIX = b"Exif\0"
_XMP_PREFIX = b"http://ns.adobe.com/xap/1.0/\0"
_END_OF_JPEG = b"\xff\xd9"
_END_OF_PNG = b"IEND\xaeB`\x82"
_TAIL_BYTES = 65_536
_MAX_SEGMENTS = 4096
_TAG_WIDTH, _TAG_HEIGHT, _TAG_XMP = 0x100, 0x101, 0x2BC
_TAG_STRIPS, _TAG_STRIP_BYTES, _TAG_TILES, _TAG_TILE_BYTES = 0x111, 0x117, 0x144, 0x145
# ModelPixelScale, ModelTiepoint, ModelTransformation, GeoKeyDirectory: this raster is a map, not a photo.
_GEO_TAGS = frozenset({33550, 33922, 34264, 34735})


@dataclass(frozen=True, slots=True)
class PhotoHeader:
    """A photo without its pixels; ``xmp`` is the raw packet, empty where there is none."""

    format: str
    width_px: int
    height_px: int
    tags: TiffTags = field(default_factory=TiffTags)
    xmp: bytes = b""

    @property
    def is_map(self) -> bool:
        """Whether the raster is georeferenced (a GeoTIFF), hence no photo."""
        return bool(_GEO_TAGS & self.tags.main.keys())


def read_header(path: Path) -> PhotoHeader:
    """Return what stands before the pixels of the photo at ``path``.

    Raises ``FrameReadError`` where the file is empty, cut off or no photo.
    """
    try:
        with path.open("rb") as file:
            start = file.read(16)
            if not start:
                raise FrameReadError(f"{path.name}: the file is empty: copy it again")
            if start[:2] == b"\xff\xd8":
                return _read_jpeg(path, file)
            if start[:4] in (b"II*\0", b"MM\0*"):
                return _read_tiff(path, file)
            return _read_other(path, file)
    except (OSError, struct.error, ValueError) as error:
        raise FrameReadError(f"{path.name}: {_words(error)}") from error


def _words(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)


def _read_jpeg(path: Path, file: BinaryIO) -> PhotoHeader:
    """Walk the segments up to the picture's own data, then look whether its end is there."""
    width = height = 0
    exif, xmp = b"", b""
    file.seek(2)
    for _ in range(_MAX_SEGMENTS):
        marker = _next_marker(file)
        if marker is None or marker == _EOI:
            break
        if marker in (0x01, *range(0xD0, 0xD9)):  # these stand alone, without a length
            continue
        raw = file.read(2)
        if len(raw) < 2:
            break
        length = max(int.from_bytes(raw, "big") - 2, 0)
        if marker == _SOS:
            if not _has_end(file, file.tell(), _END_OF_JPEG):
                raise FrameReadError(f"{path.name}: the file is cut off: copy it again")
            if width < 1 or height < 1:
                break
            return PhotoHeader("jpeg", width, height, read_tags(exif), xmp)
        if marker in _SOF:
            frame = file.read(length)
            height, width = struct.unpack(">HH", frame[1:5])
        elif marker == _APP1:
            payload = file.read(length)
            if payload.startswith(_EXIF_PREFIX) and not exif:
                exif = payload[6:]
            elif payload.startswith(_XMP_PREFIX) and not xmp:
                xmp = payload[len(_XMP_PREFIX) :]
        else:
            file.seek(length, 1)
    raise FrameReadError(f"{path.name}: the JPEG has no picture in it: copy it again")


def _next_marker(file: BinaryIO) -> int | None:
    """Return the next marker's byte; padding and stray bytes between segments are passed over."""
    byte = file.read(1)
    for _ in range(_TAIL_BYTES):
        if not byte:
            return None
        if byte == b"\xff":
            byte = file.read(1)
            if byte and byte not in (b"\xff", b"\0"):
                return byte[0]
        else:
            byte = file.read(1)
    return None


def _has_end(file: BinaryIO, start: int, end_mark: bytes) -> bool:
    """Look for the mark that ends the picture: in the last bytes, and only if it is not there in the whole rest.

    Inside a JPEG's data 0xFF is always stuffed, so an end mark after the start of the scan is a true one.
    """
    size = file.seek(0, 2)
    tail_start = max(start, size - _TAIL_BYTES)
    file.seek(tail_start)
    if end_mark in file.read(_TAIL_BYTES):
        return True
    file.seek(start)
    left = tail_start - start
    carry = b""
    while left > 0:
        block = file.read(min(1 << 20, left))
        if not block:
            return False
        if end_mark in carry + block:
            return True
        carry = block[-len(end_mark) + 1 :]
        left -= len(block)
    return False


def _read_tiff(path: Path, file: BinaryIO) -> PhotoHeader:
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        tags = read_tags(data)
    width, height = number(tags.main.get(_TAG_WIDTH)), number(tags.main.get(_TAG_HEIGHT))
    if not width or not height:
        raise FrameReadError(f"{path.name}: the TIFF has no picture in it: copy it again")
    packet = tags.main.get(_TAG_XMP)
    if _tiff_end(tags) > path.stat().st_size:
        raise FrameReadError(f"{path.name}: the file is cut off: copy it again")
    return PhotoHeader("tiff", int(width), int(height), tags, _as_bytes(packet))


def _tiff_end(tags: TiffTags) -> int:
    """Return where the last strip or tile of a TIFF's picture ends."""
    ends = [0]
    for where, size in ((_TAG_STRIPS, _TAG_STRIP_BYTES), (_TAG_TILES, _TAG_TILE_BYTES)):
        offsets, counts = tags.main.get(where), tags.main.get(size)
        if isinstance(offsets, tuple) and isinstance(counts, tuple) and len(offsets) == len(counts):
            ends += [
                int(a + b) for a, b in zip(offsets, counts, strict=True) if isinstance(a, int) and isinstance(b, int)
            ]
    return max(ends)


def _as_bytes(value: TagValue | None) -> bytes:
    """XMP is written as bytes of the kind "byte" or "undefined"; only the latter come as such."""
    if isinstance(value, bytes):
        return value
    if not isinstance(value, tuple):
        return b""
    return bytes(v for v in value if isinstance(v, int) and 0 <= v < 256)


def _read_other(path: Path, file: BinaryIO) -> PhotoHeader:
    """Ask Pillow; its warnings (huge picture, odd EXIF) are no news here: sizes are guarded where pixels are read."""
    file.seek(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(file) as picture:
                width, height = picture.size
                kind = (picture.format or "").lower()
                exif, xmp = picture.info.get("exif", b""), picture.info.get("xmp", b"")
    except Image.DecompressionBombError as error:
        raise FrameReadError(f"{path.name}: the picture is absurdly large: leave it out") from error
    except (UnidentifiedImageError, SyntaxError, OSError) as error:
        raise FrameReadError(f"{path.name}: not a photo that can be read: export it as JPEG or TIFF") from error
    if kind == "png" and not _has_end(file, 8, _END_OF_PNG):
        raise FrameReadError(f"{path.name}: the file is cut off: copy it again")
    block = exif if isinstance(exif, bytes) else b""
    block = block[6:] if block.startswith(_EXIF_PREFIX) else block
    xmp = xmp.encode() if isinstance(xmp, str) else xmp
    return PhotoHeader(kind, width, height, read_tags(block), xmp if isinstance(xmp, bytes) else b"")


def has_whole_picture(data: bytes) -> bool:
    """Whether the bytes of a JPEG, PNG or TIFF reach to the picture's end; true for formats that cannot say."""
    if data[:2] == b"\xff\xd8":
        scan = _scan_start(data)
        return scan > 0 and data.find(_END_OF_JPEG, scan) > 0
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return _END_OF_PNG in data[-_TAIL_BYTES:]
    if data[:4] in (b"II*\0", b"MM\0*"):
        return _tiff_end(read_tags(data)) <= len(data)
    return True


def _scan_start(data: bytes) -> int:
    """Return where a JPEG's own data starts, 0 where it has none (a preview inside EXIF is not its own)."""
    file = BytesIO(data)
    file.seek(2)
    for _ in range(_MAX_SEGMENTS):
        marker = _next_marker(file)
        if marker is None or marker == _EOI:
            return 0
        if marker in (0x01, *range(0xD0, 0xD9)):
            continue
        length = int.from_bytes(file.read(2), "big")
        if marker == _SOS:
            return file.tell()
        file.seek(max(length - 2, 0), 1)
    return 0
