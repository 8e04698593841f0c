"""The frames' pixels, opened when a tile asks for them and kept while memory allows."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Generic, NamedTuple, TypeVar

import cv2
import numpy as np

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.placement import FramePlacement

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")

SOFTEN_ABOVE = 1.3
"""Where a map pixel is larger than this many of a frame's, the frame is low-passed before it is resampled."""


class SourceImage(NamedTuple):
    """A frame ready to be resampled: ``(H, W, 3)`` BGR or ``(H, W)`` grey.

    ``scale`` is the size of this raster over that of the frame (1, 1/2, 1/4 ...); ``x' = (x + 0.5) scale - 0.5``.
    """

    image: ImageArray
    scale: float


class LruCache(Generic[Key, Value]):
    """Values made on demand, once even if several threads ask at the same time, and dropped when not used lately.

    Holds at most ``limit_bytes`` by ``size_of``, but always the value made last.
    """

    def __init__(self, make: Callable[[Key], Value], size_of: Callable[[Value], int], limit_bytes: int) -> None:
        self._make, self._size_of, self._limit_bytes = make, size_of, limit_bytes
        self._lock = threading.Lock()
        self._values: OrderedDict[Key, Future[Value]] = OrderedDict()
        self._bytes = 0

    @property
    def held_bytes(self) -> int:
        """The size of what is held now."""
        return self._bytes

    def get(self, key: Key) -> Value:
        """Return the value of ``key``; an exception of its making is raised here, and nothing is kept of it."""
        with self._lock:
            future = self._values.get(key)
            mine = future is None
            if future is None:
                future = self._values[key] = Future()
            self._values.move_to_end(key)
        if mine:
            self._fill(key, future)
        return future.result()

    def drop(self, key: Key) -> None:
        """Forget ``key``."""
        with self._lock:
            future = self._values.get(key)
            if future is not None and future.done():
                self._forget(key)

    def clear(self) -> None:
        """Forget all values."""
        with self._lock:
            for key in [key for key, future in self._values.items() if future.done()]:
                self._forget(key)

    def _fill(self, key: Key, future: Future[Value]) -> None:
        try:
            value = self._make(key)
        except BaseException as error:
            with self._lock:
                self._values.pop(key, None)
            future.set_exception(error)
            return
        with self._lock:
            future.set_result(value)
            self._bytes += self._size_of(value)
            if self._bytes > self._limit_bytes:
                self._shrink(keep=key)

    def _shrink(self, keep: Key) -> None:
        for old in [key for key, future in self._values.items() if key != keep and future.done()]:
            if self._bytes <= self._limit_bytes:
                break
            self._forget(old)

    def _forget(self, key: Key) -> None:
        self._bytes -= self._size_of(self._values.pop(key).result())


def check_pixels(image: ImageArray, placement: FramePlacement) -> ImageArray:
    """Return the raster as ``(H, W, 3)`` or ``(H, W)`` uint8; ``FrameReadError`` where it is not that frame's."""
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    elif image.ndim == 3 and image.shape[2] == 4:
        image = np.ascontiguousarray(image[:, :, :3])
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise FrameReadError(
            f"frame {placement.frame}: pixels must be 8-bit grey or BGR, got {image.dtype} {image.shape}"
        )
    if image.shape[:2] != (placement.height_px, placement.width_px):
        raise FrameReadError(
            f"frame {placement.frame}: it was {placement.width_px} x {placement.height_px} pixels when it was placed "
            f"and is {image.shape[1]} x {image.shape[0]} now; map it again"
        )
    return image


def prepare(image: ImageArray, map_px_per_source_px: float) -> SourceImage:
    """Return the image low-passed for a map whose pixels are ``map_px_per_source_px`` times as large as the frame's.

    Whole octaves are taken out by area-averaging (which also saves memory), the rest by a Gaussian; the frame is still
    resampled only once.
    """
    ratio, scale = map_px_per_source_px, 1.0
    while ratio >= 2.0 and min(image.shape[:2]) >= 4:
        # Even sides only: an odd last row or column would shift the raster by a fraction of a pixel.
        h, w = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
        image = cv2.resize(image[:h, :w], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        ratio, scale = ratio / 2.0, scale / 2.0
    if ratio > SOFTEN_ABOVE:
        sigma = 0.5 * float(np.sqrt(ratio * ratio - 1.0))
        image = cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    return SourceImage(image, scale)
