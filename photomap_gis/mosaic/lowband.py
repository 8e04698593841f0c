"""The low frequencies of frames: thumbnails that are kept on disk, so that no frame is opened for them twice.

They carry what is shared between frames (exposure, light), never detail; and how blurred the frame is.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import OutputError
from photomap_gis.mosaic.lattice import FloatImage
from photomap_gis.mosaic.pixels import LruCache, SourceImage

LONG_SIDE_PX = 96
"""Size of a thumbnail: one of its pixels is about a hundredth of the frame."""

_HEAD = struct.Struct(">IIf")  # of a file: the frame's width and height, its blur
_STEPS_PER_LEVEL = 256  # kept as 16 bits: eight would show as bands in skies, snow and water


class LowBand(NamedTuple):
    """Low frequencies: ``(h, w, 3)`` BGR uint16 in 1/256 of a grey level, and how much of the frame they cover.

    ``blur_px`` is the frame's blur, NaN where it is not known.
    """

    thumbnail: npt.NDArray[np.uint16]
    width_px: int
    height_px: int
    blur_px: float = math.nan

    def sample(self, x_px: FloatImage, y_px: FloatImage) -> FloatImage:
        """Return ``(..., 3)`` BGR grey levels at pixels of the **frame**; beyond its edge those of the edge."""
        h, w = self.thumbnail.shape[:2]
        x = ((np.nan_to_num(x_px) + 0.5) * (w / self.width_px) - 0.5).astype(np.float32)
        y = ((np.nan_to_num(y_px) + 0.5) * (h / self.height_px) - 0.5).astype(np.float32)
        values = cv2.remap(self.thumbnail, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(values, dtype=np.float32) / np.float32(_STEPS_PER_LEVEL)


def low_band_of(source: SourceImage, blur_px: float = math.nan) -> LowBand:
    """Return the low frequencies of a frame whose blur is ``blur_px``."""
    image, scale = source
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
    return LowBand(np.rint(small * _STEPS_PER_LEVEL).astype(np.uint16), round(w / scale), round(h / scale), blur_px)


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
        self._cache: LruCache[int, LowBand] = LruCache(self._load, lambda low: low.thumbnail.nbytes, limit_bytes)
        folder.mkdir(parents=True, exist_ok=True)

    def get(self, frame: int) -> LowBand:
        """Return the low frequencies of a frame; raises what ``open_image`` raises."""
        return self._cache.get(frame)

    def _load(self, frame: int) -> LowBand:
        path = self._folder / f"{frame:06d}.low"
        kept = _read(path)
        if kept is not None:
            return kept
        image = self._open_image(frame)
        low = low_band_of(image, self._blur_of_opened(frame))
        _write(path, low)
        return low


def _read(path: Path) -> LowBand | None:
    """Return a stored thumbnail; ``None`` where there is none or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if len(data) < _HEAD.size:
        return None
    width, height, blur_px = _HEAD.unpack_from(data)
    body = np.frombuffer(data[_HEAD.size :], dtype=np.uint8)
    thumbnail = cv2.imdecode(body, cv2.IMREAD_UNCHANGED) if body.size else None
    if thumbnail is None or thumbnail.dtype != np.uint16 or thumbnail.ndim != 3:
        return None
    return LowBand(thumbnail, width, height, blur_px)


def _write(path: Path, low: LowBand) -> None:
    ok, body = cv2.imencode(".png", low.thumbnail, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not ok:
        raise OutputError(f"{path}: the thumbnail could not be encoded")
    temporary = path.with_suffix(".tmp")
    try:
        temporary.write_bytes(_HEAD.pack(low.width_px, low.height_px, low.blur_px) + body.tobytes())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror}); free some space or choose another folder"
        ) from error
