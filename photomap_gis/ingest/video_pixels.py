"""The pixels of a decoded video frame: one way from the codec's colours to BGR, for files, streams and recordings."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from av.error import FFmpegError
from av.video.reformatter import Colorspace, Interpolation

from photomap_gis.core.frame import ImageArray

_SCALING = Interpolation.BILINEAR | Interpolation.ACCURATE_RND
"""The scaler's fast path darkens by three levels."""

_LIMITED_TO_FULL = np.clip(np.rint((np.arange(256) - 16.0) * 255.0 / 219.0), 0, 255).astype(np.uint8)
_PLANAR_8_BIT = ("yuv420p", "yuv422p", "yuv444p", "yuvj420p", "yuvj422p", "yuvj444p", "nv12", "gray")
_FULL_RANGE = 2


def bgr_of(frame: Any) -> ImageArray | None:
    """Return ``(H, W, 3)`` BGR of a decoded frame, ``None`` where it cannot be converted."""
    try:
        # Unlabelled HD video is BT.709; the scaler would take it for BT.601.
        unlabelled = frame.colorspace not in (1, 4, 5, 6, 7, 9, 10)
        source = (Colorspace.ITU709 if frame.height >= 720 else Colorspace.ITU601) if unlabelled else None
        image = frame.reformat(format="bgr24", src_colorspace=source, interpolation=_SCALING, threads=1).to_ndarray()
    except (FFmpegError, ValueError):
        return None
    return np.ascontiguousarray(image)


def grey_of(frame: Any) -> ImageArray | None:
    """Return ``(H, W)`` brightness over the full range; the codec's own where it has it, ``None`` where unreadable."""
    if frame.format.name not in _PLANAR_8_BIT:
        image = bgr_of(frame)
        return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    plane = frame.planes[0]
    rows = np.frombuffer(plane, np.uint8)[: plane.line_size * frame.height].reshape(frame.height, plane.line_size)
    luma = rows[:, : frame.width]
    name = frame.format.name
    is_full = name.startswith("yuvj") or name == "gray" or frame.color_range == _FULL_RANGE
    # A copy in any case: the plane is the decoder's.
    return np.array(luma) if is_full else np.asarray(cv2.LUT(luma, _LIMITED_TO_FULL), np.uint8)
