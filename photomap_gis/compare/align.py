"""Two imageries laid on each other: read window by window, and the residual shifts between them measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.compare.field import (
    PATCH_PX,
    SMOOTHINGS,
    NodeBlock,
    NodeShift,
    ShiftField,
    match_node,
    node_blocks,
    steepness,
    step_of,
    with_nodes,
)
from photomap_gis.compare.imagery import ColourPatch, Colours
from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.parallel import map_jobs

BoolImage = npt.NDArray[np.bool_]
Progress = Callable[[int, int], None]

_MARGIN_PX = 4
_MOST_SPREAD = 4
"""A window of the old imagery this many times as large as the new one's is a mistake of the field."""


class ReadsColours(Protocol):
    """Imagery as it is compared."""

    def read(self, grid: MapGrid, window: Window | None = None) -> ColourPatch:
        """Return what a window of a grid shows."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LaidPair:
    """Old and new imagery on one grid, the old one moved by a field of shifts."""

    old: ReadsColours
    new: ReadsColours
    grid: MapGrid
    field: ShiftField

    def read(self, window: Window) -> tuple[Colours, Colours, BoolImage]:
        """Return ``(h, w, 3)`` old colours where the new ones have them, the new ones, and where both show ground."""
        new = self.new.read(self.grid, window)
        nothing = np.zeros_like(new.mask)
        if not new.mask.any():
            return np.zeros_like(new.rgb), new.rgb, nothing
        x, y = self.field.at(window)
        left, top = int(np.floor(x.min())) - _MARGIN_PX, int(np.floor(y.min())) - _MARGIN_PX
        right, bottom = int(np.ceil(x.max())) + _MARGIN_PX + 1, int(np.ceil(y.max())) + _MARGIN_PX + 1
        if (right - left) * (bottom - top) > _MOST_SPREAD * (window.width + 32) * (window.height + 32):
            return np.zeros_like(new.rgb), new.rgb, nothing
        old = self.old.read(self.grid, Window(left, top, right - left, bottom - top))
        x, y = x - np.float32(left), y - np.float32(top)
        # The mask first: what is not seen is black, and a cubic kernel would carry it into its neighbours.
        seen = cv2.remap(old.mask.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT) > 0.999
        rgb = cv2.remap(old.rgb, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.clip(rgb, 0.0, 1.0), new.rgb, seen & new.mask


def fine_field(
    laid: LaidPair, *, rounds: tuple[float, ...] = SMOOTHINGS, workers: int | None = None,
    on_progress: Progress = lambda done, total: None,
) -> ShiftField:  # fmt: skip
    """Return the field of a pair with its residual shifts measured node by node, in rounds."""
    field = laid.field
    blocks = node_blocks(laid.grid, field.step_px)
    total = len(rounds) * len(blocks)
    for number, smoothing in enumerate(rounds):
        measure = partial(_measured, replace(laid, field=field))
        found: list[NodeShift] = []
        for done, nodes in enumerate(map_jobs(measure, blocks, workers=workers), start=number * len(blocks) + 1):
            found += nodes
            on_progress(done, total)
        field = with_nodes(field, found, smoothing=smoothing)
    return field


def _measured(laid: LaidPair, block: NodeBlock) -> list[NodeShift]:
    """Return what could be measured at the nodes of a block."""
    old, new, mask = laid.read(block.window)
    if not mask.any():
        return []
    steep_old, steep_new, inner = steepness(old), steepness(new), _inner(mask)
    found = []
    for row, col, left, top in block.nodes:
        part = np.s_[top : top + PATCH_PX, left : left + PATCH_PX]
        if not inner[part].any():
            continue
        dx, dy, weight = match_node(steep_old[part], steep_new[part], inner[part])
        if weight > 0.0:
            found.append(NodeShift(row, col, dx, dy, weight))
    return found


def _inner(mask: BoolImage) -> BoolImage:
    """Return the mask without its border, where the steepness is that of the picture's end."""
    if mask.all():
        return mask
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=1) > 0)


def coarser(grid: MapGrid, factor: int) -> MapGrid:
    """Return a grid of the same corner with pixels ``factor`` times as wide."""
    width, height = (-(-n // factor) for n in (grid.width, grid.height))
    return replace(grid, pixel_size=grid.pixel_size * factor, width=width, height=height)


def field_on(field: ShiftField, source: MapGrid, target: MapGrid) -> ShiftField:
    """Return a field of one grid for another one of the same corner and other pixels."""
    k = source.pixel_size / target.pixel_size
    # Pixel centres: x_target = (x_source + 0.5) k - 0.5.
    to_target = Similarity2D((k - 1.0) / 2.0, (k - 1.0) / 2.0, 0.0, float(np.log(k)))
    T = to_target @ field.T_old_new @ to_target.inverse()
    step = step_of(target)
    rows, cols = (-(-n // step) + 1 for n in (target.height, target.width))
    x, y = np.meshgrid(np.arange(cols, dtype=np.float32) * step, np.arange(rows, dtype=np.float32) * step)
    u, v = (((p + 0.5) / k - 0.5) / field.step_px for p in (x, y))
    d = cv2.remap(
        field.nodes_px, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return ShiftField(T, np.asarray(d * np.float32(k)).reshape(rows, cols, 2), step, field.sigma_px * k, field.share)
