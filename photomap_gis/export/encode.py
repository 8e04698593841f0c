"""Pixels to the bytes of a tile."""

from __future__ import annotations

import io
from enum import StrEnum

import cv2
import numpy as np
from PIL import Image

from photomap_gis.core.errors import OutputError, UsageError
from photomap_gis.export.pixels import Rgba, is_opaque


class TileFormat(StrEnum):
    """How tiles are stored; the value is also the file's suffix and MBTiles' ``format``.

    PNG keeps every pixel and its alpha and opens everywhere; WEBP is some six times smaller and keeps alpha; JPG has no
    alpha: what was not seen becomes white.
    """

    PNG = "png"
    WEBP = "webp"
    JPG = "jpg"

    @property
    def mime(self) -> str:
        """The media type."""
        return "image/jpeg" if self is TileFormat.JPG else f"image/{self.value}"


class TileChoice(StrEnum):
    """What a user may ask of tiles: one format for all, or ``mixed``: JPG, and PNG where a tile is not all opaque."""

    PNG = "png"
    WEBP = "webp"
    JPG = "jpg"
    MIXED = "mixed"

    def of(self, rgba: Rgba) -> TileFormat:
        """Return the format of one tile by its content."""
        if self is not TileChoice.MIXED:
            return TileFormat(self.value)
        return TileFormat.JPG if is_opaque(rgba) else TileFormat.PNG

    @property
    def suffix(self) -> str:
        """The suffix of all tiles of a folder: readers look at the bytes, not at the name, where they are mixed."""
        return "png" if self is TileChoice.MIXED else self.value


def parse_tile_choice(text: str, *, auto: TileChoice = TileChoice.PNG, mixed: bool = True) -> TileChoice:
    """Return what a user's word means; ``jpeg`` is jpg, ``auto`` is ``auto``. ``mixed`` may be barred by a format."""
    known = {"auto": auto, "jpeg": TileChoice.JPG, **{c.value: c for c in TileChoice}}
    if text.lower() not in known:
        raise ValueError(f"image_format must be one of {', '.join(known)}, got {text!r}")
    choice = known[text.lower()]
    if choice is TileChoice.MIXED and not mixed:
        raise UsageError("this format holds tiles of one kind: choose png, webp or jpg, not mixed")
    return choice


JPG_QUALITY, WEBP_QUALITY = 88, 85
# Measured on photographic tiles: the run-length strategy is twice as fast as level 3 and loses no bytes, since photos
# do not repeat themselves. The order matters: to OpenCV, naming a level later resets the strategy.
_PNG = [
    cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG,
]  # fmt: skip


def encode(rgba: Rgba, tile_format: TileFormat, quality: int | None = None) -> bytes:
    """Return the encoded image; an opaque one carries no alpha. ``quality`` (1-100) is of JPG and WEBP."""
    opaque = is_opaque(rgba)
    if tile_format is TileFormat.JPG and not opaque:
        alpha = rgba[..., 3:].astype(np.uint16)
        white = (rgba[..., :3] * alpha + 255 * (255 - alpha) + 127) // 255
        rgba = np.concatenate([white.astype(np.uint8), np.full_like(rgba[..., 3:], 255)], axis=-1)
        opaque = True
    if tile_format is TileFormat.WEBP:  # cv2 cannot be told to hurry: twice the time for two percent of the bytes
        buffer = io.BytesIO()
        picture = Image.fromarray(rgba[..., :3] if opaque else rgba)
        picture.save(buffer, "WEBP", quality=quality or WEBP_QUALITY, method=0)
        return buffer.getvalue()
    pixels = cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR if opaque else cv2.COLOR_RGBA2BGRA)
    parameters = _PNG if tile_format is TileFormat.PNG else [cv2.IMWRITE_JPEG_QUALITY, quality or JPG_QUALITY]
    done, data = cv2.imencode(f".{tile_format.value}", pixels, parameters)
    if not done:
        raise OutputError(f"this installation cannot write {tile_format.value} images: choose another --tile-format")
    return data.tobytes()
