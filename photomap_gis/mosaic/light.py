"""One light for all frames at a spot: their low frequencies meet in a wide consensus, at the nodes of a coarse lattice.

Every frame is moved to the consensus by a smooth field (what it lacks, or has too much of), hence the detail of a frame
needs to be resampled only where the frame is chosen. All weights are functions of the geometry alone: neighbouring
tiles agree on them without knowing each other. Compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.mosaic.choice import WIDE_REACH, taper_px
from photomap_gis.mosaic.exposure import MAX_RADIUS, Exposure
from photomap_gis.mosaic.lattice import FloatImage
from photomap_gis.mosaic.lowband import LEVEL, LowBand
from photomap_gis.mosaic.sighting import BORDER_PX, COST, X_PX, Y_PX
from photomap_gis.mosaic.views import FILL_TIER, View

LIGHT_EXPLAINS = 0.35
"""Low frequencies of two levelled frames that differ by more than this share of their level show different things."""

_DARK = 12.0  # grey levels: near black, shares mean nothing
_LEAST = 1e-6  # at the very edge of the map all tapers vanish together


class Light(NamedTuple):
    """What makes a frame's pixels part of the map: ``pixel * factor + offset``, ``(rows, columns, 3)`` at the nodes."""

    factor: FloatImage
    offset: FloatImage


def consensus_weights(views: Sequence[View], sights: FloatImage) -> FloatImage:
    """Return ``(N, rows, columns)`` weights of the frames' low frequencies at the nodes; they add up to 1, or to 0.

    ``sights`` is how the views see them. Frames placed by GPS alone have a say only where registered ones end: their
    ground may be some metres off.
    """
    weights = np.zeros((len(views), *sights.shape[2:]), dtype=np.float32)
    fills = np.array([view.tier >= FILL_TIER for view in views])
    _weigh(sights, fills, np.array([taper_px(view) for view in views], dtype=np.float32), weights)
    return weights


def exposed(view: View, sight: FloatImage, exposure: Exposure) -> FloatImage:
    """Return a frame's exposure factor, ``(rows, columns, 3)`` at the nodes that it sees as ``sight`` says."""
    factor = np.empty((*sight.shape[1:], 3), dtype=np.float32)
    width, height = view.placement.width_px, view.placement.height_px
    gain = np.asarray(exposure.gains.get(view.frame, _EVEN), dtype=np.float64)
    _expose(sight, width, height, view.half_diagonal_px, *exposure.vignette, gain, factor)
    return factor


def levels_of(low: LowBand, sight: FloatImage, factor: FloatImage) -> FloatImage:
    """Return a frame's low frequencies times its factor, ``(rows, columns, 3)`` at the nodes."""
    levels = np.empty_like(factor)
    _sample(np.ascontiguousarray(low.thumbnail), sight, low.width_px, low.height_px, factor, levels)
    return levels


def shift_to_consensus(levels: FloatImage, weights: FloatImage, own: int) -> FloatImage:
    """Return ``(rows, columns, 3)`` what a frame's low frequencies lack to the weighted mean of all.

    ``levels`` is ``(N, rows, columns, 3)``, ``weights`` ``(N, rows, columns)``; ``own`` is which of them is the frame.
    Frames that differ by more than light explains show another thing there (relief, an error in a placement, a car):
    they are not listened to, else the one's roof would shine through the other's lawn.
    """
    shift = np.empty(levels.shape[1:], dtype=np.float32)
    _shift(levels, weights, own, shift)
    return shift


_EVEN = np.ones(3)


@compiled("void(f4[:,:,:,::1], b1[::1], f4[::1], f4[:,:,::1])")
def _weigh(sights: FloatImage, fills: npt.NDArray[np.bool_], tapers_px: FloatImage, out: FloatImage) -> None:
    count, _, rows, columns = sights.shape
    any_registered = not fills.all()
    total, depth = np.empty(2, dtype=np.float32), np.empty(2, dtype=np.float32)
    best = np.empty(2, dtype=np.float32)
    for i in range(rows):
        for j in range(columns):
            best[:], depth[:], total[:] = np.inf, 0.0, 0.0
            for k in range(count):
                f = int(fills[k])
                if sights[k, COST, i, j] < best[f]:  # not where it is NaN
                    best[f] = sights[k, COST, i, j]
            for k in range(count):
                f, cost = int(fills[k]), sights[k, COST, i, j]
                if not cost < np.inf:
                    continue
                inside = min(max(sights[k, BORDER_PX, i, j] / tapers_px[k], np.float32(0.0)), np.float32(1.0))
                smooth = inside * inside * (3 - 2 * inside)
                near = max(1 - (cost - best[f]) / WIDE_REACH, 0.0)
                out[k, i, j] = near * near * (smooth + _LEAST)
                total[f] += out[k, i, j]
                depth[f] = max(depth[f], smooth)
            registered, filling = depth[0] + _LEAST, (1 - depth[0]) * depth[1]
            if total[0] <= 0 or not any_registered:
                registered, filling = 0.0, 1.0 if total[1] > 0 else 0.0
            elif total[1] <= 0:
                filling = 0.0
            both = registered + filling
            for k in range(count):
                f = int(fills[k])
                if out[k, i, j] > 0 and both > 0:
                    out[k, i, j] *= (filling if f else registered) / (total[f] * both)


@compiled("void(f4[:,:,::1], i8, i8, f8, f8, f8, Array(f8, 1, 'C', True), f4[:,:,::1])")
def _expose(
    sight: FloatImage,
    width: int,
    height: int,
    half_diagonal: float,
    v0: float,
    v1: float,
    gain: npt.NDArray[np.float64],
    factor: FloatImage,
) -> None:
    """Fill ``Exposure.factor`` at the nodes."""
    for i in range(sight.shape[1]):
        for j in range(sight.shape[2]):
            x, y = sight[X_PX, i, j] - (width - 1) / 2.0, sight[Y_PX, i, j] - (height - 1) / 2.0
            r2 = min((x * x + y * y) / (half_diagonal * half_diagonal), MAX_RADIUS * MAX_RADIUS)
            lens = np.exp((v0 + v1 * r2) * r2)
            for k in range(3):
                factor[i, j, k] = gain[k] * (1.0 if np.isnan(x + y) else lens)


@compiled("void(Array(u2, 3, 'C', True), f4[:,:,::1], i8, i8, f4[:,:,::1], f4[:,:,::1])")
def _sample(
    thumbnail: npt.NDArray[np.uint16], sight: FloatImage, width: int, height: int, factor: FloatImage, out: FloatImage
) -> None:
    """Fill ``LowBand.sample`` at the nodes, times a factor."""
    rows, columns = thumbnail.shape[0], thumbnail.shape[1]
    for i in range(sight.shape[1]):
        for j in range(sight.shape[2]):
            x, y = sight[X_PX, i, j], sight[Y_PX, i, j]
            if np.isnan(x + y):
                x = y = np.float32(0.0)
            u = min(max((x + 0.5) * columns / width - 0.5, 0.0), columns - 1.0)
            v = min(max((y + 0.5) * rows / height - 0.5, 0.0), rows - 1.0)
            c, r = int(u), int(v)
            d, q = min(c + 1, columns - 1), min(r + 1, rows - 1)
            u, v = u - c, v - r
            for k in range(3):
                upper = thumbnail[r, c, k] * (1.0 - u) + thumbnail[r, d, k] * u
                lower = thumbnail[q, c, k] * (1.0 - u) + thumbnail[q, d, k] * u
                out[i, j, k] = (upper * (1.0 - v) + lower * v) * (1.0 / LEVEL) * factor[i, j, k]


@compiled("void(f4[:,:,:,::1], f4[:,:,::1], i8, f4[:,:,::1])")
def _shift(levels: FloatImage, weights: FloatImage, own: int, out: FloatImage) -> None:
    count, rows, columns = weights.shape
    for i in range(rows):
        for j in range(columns):
            out[i, j, :] = 0.0
            mine = levels[own, i, j]
            for k in range(count):
                weight = weights[k, i, j]
                if k == own or weight == 0.0:
                    continue
                apart = level = 0.0
                for c in range(3):
                    apart += abs(levels[k, i, j, c] - mine[c]) / 3.0
                    level += (levels[k, i, j, c] + mine[c]) / 6.0
                relative = apart / (LIGHT_EXPLAINS * (level + _DARK))
                listened = weight / (1.0 + relative**4)
                for c in range(3):
                    out[i, j, c] += listened * (levels[k, i, j, c] - mine[c])
