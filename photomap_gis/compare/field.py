"""Where the old imagery shows what the new one has at a pixel: one motion of the whole, and a smooth field about it.

Two maps of one ground differ by some pixels that drift over the map: another GPS, relief drawn by another camera. What
is not brought together is called change, so the field follows such drifts; it must not follow a car that drove on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import MapGrid, Window
from photomap_gis.core.similarity import Similarity2D

FloatImage = npt.NDArray[np.float32]
BoolImage = npt.NDArray[np.bool_]

MATCH_PX = 64
"""Side of the windows that are laid on each other."""
SEARCH_PX = 10
STEP_PX = 32
MOST_NODES = 24_000
LEAST_SEEN = 0.5
SMOOTHINGS = (1.6, 1.6, 1.2)
"""Rounds of matching, and the sigma of each one's smoothing in nodes: what a round leaves, the next one sees."""
OUTLIER_PX = 1.5
"""A node further off the median of its neighbours than this does not count."""
LEAST_NCC = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class ShiftField:
    """``old = new + shift``: the motion ``T_old_new`` of pixels of one grid, and residual shifts on a lattice.

    ``nodes_px`` ``(rows, cols, 2)`` are shifts along x and y in pixels at every ``step_px``-th pixel; ``sigma_px`` is
    how well neighbouring nodes agree, NaN where nothing could be measured. ``share`` of the nodes could be.
    """

    T_old_new: Similarity2D
    nodes_px: FloatImage
    step_px: int
    sigma_px: float = math.nan
    share: float = 0.0

    @classmethod
    def none(cls, grid: MapGrid, T_old_new: Similarity2D | None = None) -> ShiftField:
        """Return the field without residual shifts."""
        step = step_of(grid)
        rows, cols = (math.ceil(n / step) + 1 for n in (grid.height, grid.width))
        return cls(T_old_new or Similarity2D(), np.zeros((rows, cols, 2), np.float32), step)

    def at(self, window: Window) -> tuple[FloatImage, FloatImage]:
        """Return ``(h, w)`` x and y in pixels of the grid at which the old imagery shows a window's pixels."""
        x, y = np.meshgrid(
            np.arange(window.col_off, window.col_off + window.width, dtype=np.float64),
            np.arange(window.row_off, window.row_off + window.height, dtype=np.float64),
        )
        u, v = (x / self.step_px).astype(np.float32), (y / self.step_px).astype(np.float32)
        d = cv2.remap(self.nodes_px, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        moved = self.T_old_new.apply(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(*x.shape, 2) + d
        return moved[..., 0].astype(np.float32), moved[..., 1].astype(np.float32)


def step_of(grid: MapGrid) -> int:
    """Return the lattice's step in pixels: large maps get a wider one."""
    return max(STEP_PX, math.ceil(math.sqrt(grid.width * grid.height / MOST_NODES)))


@dataclass(frozen=True, slots=True)
class NodeShift:
    """The residual shift measured at a node, and what its match was worth (0: nothing)."""

    row: int
    col: int
    dx_px: float
    dy_px: float
    weight: float


def steepness(rgb: npt.NDArray[np.float32]) -> FloatImage:
    """``(h, w)`` root of the gradient's size of ``(h, w, 3)`` colours: a contrast that turns leaves it as it is."""
    soft = cv2.GaussianBlur(rgb.mean(axis=2), (0, 0), 1.0)
    size = np.hypot(cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1))
    return np.sqrt(size).astype(np.float32)


def match_node(old: FloatImage, new: FloatImage, mask: BoolImage) -> tuple[float, float, float]:
    """Return the shift of the old picture against the new one, x and y in pixels, and its weight (0: no match).

    Both are ``(h, w)`` pictures of the same place whose contrast does not turn with the season; ``mask`` is where both
    show ground. The peak of the normalised cross-correlation within ``SEARCH_PX``, to a part of a pixel by a parabola.
    """
    s = SEARCH_PX
    core = new[s:-s, s:-s]
    inside = mask[s:-s, s:-s]
    if min(core.shape) < 24 or inside.mean() < LEAST_SEEN or float(core[inside].std()) < 1e-3:
        return 0.0, 0.0, 0.0
    if inside.all() and mask.all():
        r = cv2.matchTemplate(old, core, cv2.TM_CCOEFF_NORMED)
    else:
        filled_new = np.where(inside, core, np.float32(core[inside].mean()))
        filled_old = np.where(mask, old, np.float32(old[mask].mean()))
        r = cv2.matchTemplate(filled_old, filled_new, cv2.TM_CCOEFF_NORMED)
    r = np.nan_to_num(r, nan=-1.0, posinf=-1.0, neginf=-1.0)
    _, best, _, (px, py) = cv2.minMaxLoc(r)
    if best < LEAST_NCC or not (0 < px < r.shape[1] - 1 and 0 < py < r.shape[0] - 1):
        return 0.0, 0.0, 0.0
    apart = r.copy()
    apart[max(0, py - 2) : py + 3, max(0, px - 2) : px + 3] = -1.0
    second = float(apart.max())
    dx = _vertex(r[py, px - 1], r[py, px], r[py, px + 1])
    dy = _vertex(r[py - 1, px], r[py, px], r[py + 1, px])
    weight = max(0.0, best - max(second, 0.0)) * best
    return px + dx - s, py + dy - s, float(weight)


def _vertex(a: float, b: float, c: float) -> float:
    """Return where a parabola through three values at -1, 0, 1 has its top."""
    bend = float(a) - 2.0 * float(b) + float(c)
    return 0.0 if bend > -1e-9 else float(np.clip(0.5 * (float(a) - float(c)) / bend, -0.5, 0.5))


def with_nodes(field: ShiftField, nodes: Iterable[NodeShift], *, smoothing: float = SMOOTHINGS[-1]) -> ShiftField:
    """Return the field with measured residual shifts added: outliers left out, smoothed, gaps filled.

    ``smoothing`` is its sigma in nodes. Where nothing could be measured, the field stays as it is.
    """
    rows, cols = field.nodes_px.shape[:2]
    d = np.zeros((rows, cols, 2), np.float32)
    weight = np.zeros((rows, cols), np.float32)
    for n in nodes:
        d[n.row, n.col], weight[n.row, n.col] = (n.dx_px, n.dy_px), n.weight
    if not weight.any():
        return field
    typical = _typical(d, weight)
    off = np.hypot(*(d - typical).transpose(2, 0, 1))
    good = np.where(off <= OUTLIER_PX, weight, np.float32(0.0))
    if not good.any():
        return field
    smooth = _smoothed(d, good, smoothing)
    left = np.hypot(*(d - smooth).transpose(2, 0, 1))[good > 0]
    sigma = 1.4826 * float(np.median(left)) / 1.177  # the median of a Rayleigh law is 1.177 sigma
    known = weight > 0
    return ShiftField(
        field.T_old_new, field.nodes_px + smooth, field.step_px, sigma, float((good > 0).sum() / max(1, known.size))
    )


def _typical(d: FloatImage, weight: FloatImage) -> FloatImage:
    """Return for every node the median shift of the measured ones around it; where there are few, of all of them."""
    known = weight > 0
    overall = np.array([np.median(d[known][:, k]) for k in range(2)], np.float32)
    out = np.empty_like(d)
    rows, cols = known.shape
    for r in range(rows):
        for c in range(cols):
            near = np.s_[max(0, r - 2) : r + 3, max(0, c - 2) : c + 3]
            here = known[near]
            out[r, c] = np.median(d[near][here], axis=0) if here.sum() >= 5 else overall
    return out


def _smoothed(d: FloatImage, weight: FloatImage, sigma: float) -> FloatImage:
    """Return the weighted mean of the nodes around; far from any measured node that of a wider neighbourhood."""
    total = float(weight.sum())
    out = np.broadcast_to((d * weight[..., None]).sum(axis=(0, 1)) / total, d.shape).astype(np.float32)
    for spread in (8.0 * sigma, 3.0 * sigma, sigma):  # from wide to narrow: the narrow one counts where it knows enough
        w = cv2.GaussianBlur(weight, (0, 0), spread, borderType=cv2.BORDER_CONSTANT)
        sums = cv2.GaussianBlur(d * weight[..., None], (0, 0), spread, borderType=cv2.BORDER_CONSTANT)
        sums = sums.reshape(d.shape)
        trust = (w / (w + 0.02))[..., None]
        out = (trust * sums / np.maximum(w, 1e-9)[..., None] + (1.0 - trust) * out).astype(np.float32)
    return out


@dataclass(frozen=True, slots=True)
class NodeBlock:
    """Nodes that are measured in one read: a window, and each node's row, column and corner within the window."""

    window: Window
    nodes: tuple[tuple[int, int, int, int], ...]


PATCH_PX = MATCH_PX + 2 * SEARCH_PX
"""Side of what is cut out around a node."""
BLOCK_PX = 768


def node_blocks(grid: MapGrid, step_px: int) -> list[NodeBlock]:
    """Return all nodes of a grid's lattice in blocks; windows have the nodes' margins and may overhang the grid."""
    half = PATCH_PX // 2
    rows, cols = (math.ceil(n / step_px) + 1 for n in (grid.height, grid.width))
    side = max(1, BLOCK_PX // step_px)
    blocks = []
    for r0 in range(0, rows, side):
        for c0 in range(0, cols, side):
            r1, c1 = min(rows, r0 + side), min(cols, c0 + side)
            size = ((c1 - c0 - 1) * step_px + 2 * half, (r1 - r0 - 1) * step_px + 2 * half)
            nodes = tuple((r, c, (c - c0) * step_px, (r - r0) * step_px) for r in range(r0, r1) for c in range(c0, c1))
            blocks.append(NodeBlock(Window(c0 * step_px - half, r0 * step_px - half, *size), nodes))
    return blocks
