"""The low frequencies of frames: thumbnails that are kept on disk, so that no frame is opened for them twice.

They carry what is shared between frames (exposure, light), never detail. Beside them lie how blurred the frame is, and
a small grey picture by which seams find their way.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import OutputError
from photomap_gis.core.frame import ImageArray
from photomap_gis.mosaic.lattice import FloatImage
from photomap_gis.mosaic.pixels import LruCache, SourceImage
from photomap_gis.mosaic.sharpness import BLUR_DIGITS

LONG_SIDE_PX = 96
"""Size of a thumbnail: one of its pixels is about a hundredth of the frame."""

_HEAD = struct.Struct(">IIfI")  # of a file: the frame's width and height, its blur, the thumbnail's bytes
OUTLOOK_SHRINK = 8
"""An outlook's pixels are this many of the prepared frame's wide: about a node of the tiles' lattice."""

LEVEL = 256  # kept as 16 bits: eight would show as bands in skies, snow and water


class LowBand(NamedTuple):
    """Low frequencies: ``(h, w, 3)`` BGR uint16 in 1/256 of a grey level, and how much of the frame they cover.

    ``blur_px`` is the frame's blur, NaN where it is not known. ``outlook`` is ``(h, w, 2)`` uint8, the frame
    ``OUTLOOK_SHRINK`` times smaller: its mean grey, and the contrast within each pixel.
    """

    thumbnail: npt.NDArray[np.uint16]
    width_px: int
    height_px: int
    blur_px: float = math.nan
    outlook: npt.NDArray[np.uint8] | None = None

    def sample(self, x_px: FloatImage, y_px: FloatImage) -> FloatImage:
        """Return ``(..., 3)`` BGR grey levels at pixels of the **frame**; beyond its edge those of the edge."""
        return _sampled(self.thumbnail, x_px, y_px, self.width_px, self.height_px) / np.float32(LEVEL)


def _sampled(
    picture: npt.NDArray[Any], x_px: FloatImage, y_px: FloatImage, width_px: int, height_px: int
) -> FloatImage:
    h, w = picture.shape[:2]
    xy = np.empty((*x_px.shape, 2), dtype=np.float32)
    for k, (at_px, side_px, side) in enumerate(((x_px, width_px, w), (y_px, height_px, h))):
        np.multiply(at_px, np.float32(side / side_px), out=xy[..., k])
        xy[..., k] += 0.5 * side / side_px - 0.5
    nowhere = np.isnan(xy)
    if nowhere.any():
        xy[nowhere] = 0.0
    values = cv2.remap(picture, xy.reshape(len(x_px), -1, 2), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float32)


def low_band_of(source: SourceImage, blur_px: float = math.nan) -> LowBand:
    """Return the low frequencies of a frame whose blur is ``blur_px``."""
    image, scale = source
    outlook = _outlook_of(image)
    h, w = image.shape[:2]
    shrink = max(h, w) / LONG_SIDE_PX
    size = (max(2, round(w / shrink)), max(2, round(h / shrink))) if shrink > 1.0 else (w, h)
    small = image
    whole = int(shrink / 2.0)  # whole steps first: area-averaging by an odd ratio is ten times as slow
    if whole >= 2:
        h, w = h - h % whole, w - w % whole
        small = cv2.resize(small[:h, :w], (w // whole, h // whole), interpolation=cv2.INTER_AREA)
    small = cv2.resize(small.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    if small.ndim == 2:
        small = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    return LowBand(np.rint(small * LEVEL).astype(np.uint16), round(w / scale), round(h / scale), blur_px, outlook)


def _outlook_of(image: ImageArray) -> npt.NDArray[np.uint8]:
    """``(h, w, 2)`` mean grey and standard deviation of blocks of ``OUTLOOK_SHRINK`` pixels a side."""
    n = OUTLOOK_SHRINK
    h, w = max(n, image.shape[0] // n * n), max(n, image.shape[1] // n * n)
    part = image[:h, :w]
    grey = cv2.cvtColor(part, cv2.COLOR_BGR2GRAY) if part.ndim == 3 else part
    size = (w // n, h // n)
    mean = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    # Half the resolution suffices for the contrast, and the square of it is small enough for 16 bits.
    half = cv2.resize(grey, (max(1, w // 2), max(1, h // 2)), interpolation=cv2.INTER_AREA)
    square = cv2.resize(cv2.multiply(half, half, dtype=cv2.CV_32F), size, interpolation=cv2.INTER_AREA)
    variance = square - np.square(cv2.resize(half.astype(np.float32), size, interpolation=cv2.INTER_AREA))
    return np.dstack([mean, np.sqrt(np.maximum(variance, 0.0)).astype(np.uint8)])


class LowBandStore:
    """Thumbnails in a folder, one file a frame, made by ``open_image`` where they are missing; safe among threads."""

    def __init__(
        self,
        folder: Path,
        open_image: Callable[[int], SourceImage],
        *,
        limit_bytes: int,
        blur_of_opened: Callable[[int], float] = lambda frame: math.nan,
    ) -> None:
        self._folder, self._open_image, self._blur_of_opened = folder, open_image, blur_of_opened
        self._cache: LruCache[int, LowBand] = LruCache(self._load, _size_of, limit_bytes)
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, frame: int) -> LowBand:
        """Return the low frequencies of a frame; raises what ``open_image`` raises."""
        return self._cache.get(frame)

    def clear(self) -> None:
        """Drop what is held in memory."""
        self._cache.clear()

    def _load(self, frame: int) -> LowBand:
        path = self._folder / f"{frame:06d}.low"
        kept = _read(path)
        if kept is not None:
            return kept
        image = self._open_image(frame)
        low = low_band_of(image, self._blur_of_opened(frame))
        _write(path, low)
        return low


def _size_of(low: LowBand) -> int:
    return low.thumbnail.nbytes + (0 if low.outlook is None else low.outlook.nbytes)


def _read(path: Path) -> LowBand | None:
    """Return a stored thumbnail; ``None`` where there is none or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if len(data) < _HEAD.size:
        return None
    width, height, blur_px, length = _HEAD.unpack_from(data)
    body = np.frombuffer(data[_HEAD.size : _HEAD.size + length], dtype=np.uint8)
    rest = np.frombuffer(data[_HEAD.size + length :], dtype=np.uint8)
    outlook = cv2.imdecode(rest, cv2.IMREAD_UNCHANGED) if rest.size else None
    if outlook is None or outlook.dtype != np.uint8 or outlook.ndim != 2 or outlook.shape[0] % 2:
        return None
    outlook = np.dstack(np.split(outlook, 2))
    thumbnail = cv2.imdecode(body, cv2.IMREAD_UNCHANGED) if body.size else None
    if thumbnail is None or thumbnail.dtype != np.uint16 or thumbnail.ndim != 3:
        return None
    return LowBand(thumbnail, width, height, round(blur_px, BLUR_DIGITS), outlook)


def _write(path: Path, low: LowBand) -> None:
    ok, body = cv2.imencode(".png", low.thumbnail, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    outlook = np.zeros((2, 1), np.uint8) if low.outlook is None else np.concatenate([*np.moveaxis(low.outlook, -1, 0)])
    ok_too, rest = cv2.imencode(".png", outlook, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not (ok and ok_too):
        raise OutputError(f"{path}: the thumbnail could not be encoded")
    head = _HEAD.pack(low.width_px, low.height_px, low.blur_px, len(body))
    temporary = path.with_suffix(".tmp")
    try:
        temporary.write_bytes(head + body.tobytes() + rest.tobytes())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror}); free some space or choose another folder"
        ) from error
