"""Pictures of live frames: decoded ones, converted when they are asked for, and those that are arrays already."""

from __future__ import annotations

import threading
from typing import Any

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.ingest.video_pixels import bgr_of, grey_of


class DecodedPicture:
    """A decoded frame of a video; each conversion is done once. A frame that cannot be converted is black.

    Safe among threads: the codec library's scaler belongs to the frame, and two conversions of one frame at a time kill
    the process.
    """

    def __init__(self, frame: Any) -> None:
        self._frame = frame
        self._lock = threading.Lock()
        self._bgr: ImageArray | None = None
        self._grey: ImageArray | None = None

    @property
    def bgr(self) -> ImageArray:
        """``(H, W, 3)`` uint8, read-only."""
        with self._lock:
            if self._bgr is None:
                image = bgr_of(self._frame)
                self._bgr = _kept(
                    np.zeros((self._frame.height, self._frame.width, 3), np.uint8) if image is None else image
                )
            return self._bgr

    @property
    def grey(self) -> ImageArray:
        """``(H, W)`` uint8, read-only."""
        with self._lock:
            if self._grey is None:
                image = grey_of(self._frame)
                size = (self._frame.height, self._frame.width)
                self._grey = _kept(np.zeros(size, np.uint8) if image is None else image)
            return self._grey


class ArrayPicture:
    """A picture whose BGR (or grey) pixels are there."""

    def __init__(self, image: ImageArray) -> None:
        self._image = _kept(image)

    @property
    def bgr(self) -> ImageArray:
        """``(H, W, 3)`` uint8, read-only."""
        if self._image.ndim == 3:
            return self._image
        return _kept(np.asarray(cv2.cvtColor(self._image, cv2.COLOR_GRAY2BGR), np.uint8))

    @property
    def grey(self) -> ImageArray:
        """``(H, W)`` uint8, read-only."""
        if self._image.ndim == 2:
            return self._image
        return _kept(np.asarray(cv2.cvtColor(self._image, cv2.COLOR_BGR2GRAY), np.uint8))


def _kept(image: ImageArray) -> ImageArray:
    view = image.view()
    view.setflags(write=False)
    return view
