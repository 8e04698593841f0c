"""A pair and what changed as one picture: old, new, and the new one with the changes outlined."""

from __future__ import annotations

import io

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from photomap_gis.compare.imagery import ColourPatch
from photomap_gis.compare.polygons import ChangedArea
from photomap_gis.core.grid import MapGrid

GAP_PX = 8
HEAD_PX = 26
PAPER = (255, 255, 255)
INK = (30, 30, 30)
OUTLINE = (255, 32, 32)
_NOT_SEEN = np.float32(0.88)


def change_picture(
    old: ColourPatch, new: ColourPatch, score: npt.NDArray[np.float32], grid: MapGrid, areas: list[ChangedArea]
) -> bytes:
    """Return a PNG of three pictures of one ``grid`` side by side: old, new, change.

    ``score`` is ``(h, w)``, negative where there is none: it tints a grey copy of the new picture from yellow to red;
    the outlines of ``areas`` are drawn around it.
    """
    h, w = score.shape
    sheet = Image.new("RGB", (3 * w + 4 * GAP_PX, h + HEAD_PX + GAP_PX), PAPER)
    pen = ImageDraw.Draw(sheet)
    panels = ((old_view := _shown(old)), _shown(new), _tinted(new, score))
    assert old_view.shape == (h, w, 3)
    for k, (title, pixels) in enumerate(zip(("old", "new", "change"), panels, strict=True)):
        left = GAP_PX + k * (w + GAP_PX)
        sheet.paste(Image.fromarray(pixels), (left, HEAD_PX))
        pen.text((left, 6), title, fill=INK, font_size=14)
        if k:
            for area in areas:
                for ring in (area.outline.exterior, *area.outline.interiors):
                    at = grid.to_px(np.asarray(ring.coords)[:, :2])
                    pen.line([(left + x, HEAD_PX + y) for x, y in at.tolist()], fill=OUTLINE, width=2)
    out = io.BytesIO()
    sheet.save(out, "PNG", optimize=True)
    return out.getvalue()


def _shown(patch: ColourPatch) -> npt.NDArray[np.uint8]:
    rgb = np.where(patch.mask[..., None], patch.rgb, _NOT_SEEN)
    return np.asarray(cv2.add(rgb * np.float32(255.0), 0.0, dtype=cv2.CV_8U))


def _tinted(new: ColourPatch, score: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    grey = np.repeat((0.35 + 0.6 * new.rgb.mean(axis=2))[..., None], 3, axis=2)
    s = np.clip(score, 0.0, 1.0)[..., None]
    heat = np.concatenate([np.ones_like(s), 0.85 * (1.0 - s), np.zeros_like(s)], axis=2)
    strength = 0.75 * np.clip((s - 0.1) / 0.6, 0.0, 1.0)
    rgb = np.where(score[..., None] >= 0.0, (1.0 - strength) * grey + strength * heat, _NOT_SEEN)
    return np.asarray(cv2.add((rgb * 255.0).astype(np.float32), 0.0, dtype=cv2.CV_8U))
