"""Who gives each pixel, and how neighbours meet: one frame's detail, everybody's low frequencies.

Two bands. *Detail* comes from the one cheapest frame (``choice``), feathered over a few pixels only, so that frames
that do not quite agree never show an object twice. *Low frequencies* are a wide consensus of all frames near the best
choice, so that exposure does not step at the seams. Every frame is moved to the consensus by a smooth field (what it
lacks, or has too much of), hence the detail of a frame needs to be resampled only where the frame is chosen.

All weights are functions of the geometry alone: neighbouring tiles agree on them without knowing each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.mosaic.choice import TIER_COST, WIDE_REACH, Sighting, taper
from photomap_gis.mosaic.lattice import Box, FloatImage, Lattice
from photomap_gis.mosaic.views import FILL_TIER, View

FEATHER_PX = 4
"""Half the width of a seam; no more than ``STEP_PX``, the margin of a lattice's domain."""

SLIVER_PX = 256
"""A frame that gives a tile fewer pixels than this leaves them to others that see them."""

LIGHT_EXPLAINS = 0.35
"""Low frequencies of two levelled frames that differ by more than this share of their level show different things."""

_DARK = 12.0  # grey levels: near black, shares mean nothing
_MEAN = np.full(3, 1.0 / 3.0, dtype=np.float32)  # a product is ten times as fast as a mean over three channels
_NOBODY = -1
_ALL = 253  # of 255: the shares of two are rounded each


class Seen(NamedTuple):
    """A view and how it sees a lattice's nodes."""

    view: View
    at_nodes: Sighting


SEAM_COST = 100.0
"""What a frame pays where a seam search (``seams``) gave the place to another: less than a tier."""


def labels_of(
    seen: Sequence[Seen], lattice: Lattice, at_nodes: npt.NDArray[np.int16] | None = None
) -> npt.NDArray[np.int16]:
    """Return for every pixel of the lattice's domain the index into ``seen`` of the frame that gives it, or -1.

    ``at_nodes``, ``(rows, columns)``, says whom the nodes belong to; without it the cheapest frame gives each pixel.
    """
    if at_nodes is not None and _well_inside(seen, at_nodes):
        return _nearest_label(at_nodes, lattice)
    costs = [_dense_cost(one, lattice, None if at_nodes is None else at_nodes != k) for k, one in enumerate(seen)]
    labels = _cheapest(costs, range(len(seen)), lattice)
    counts = np.bincount(labels[labels >= 0], minlength=len(seen))
    full = [i for i in range(len(seen)) if counts[i] >= SLIVER_PX]
    if len(full) == int(np.count_nonzero(counts)):
        return labels
    fewer = _cheapest(costs, full, lattice)
    # Take a sliver away only where someone else sees its ground.
    return np.where(fewer != _NOBODY, fewer, labels)


def _well_inside(seen: Sequence[Seen], at_nodes: npt.NDArray[np.int16]) -> bool:
    """Whether every node's giver sees all the pixels about it, too: then no pixel need be asked again."""
    if at_nodes.min() < 0:
        return False
    for k in np.unique(at_nodes):
        at, mine = seen[k].at_nodes, at_nodes == k
        steps = [np.abs(np.diff(v, axis=axis)) for v in (at.x_px, at.y_px) for axis in (0, 1)]
        reach = 2.0 * max(float(np.nanmax(step)) for step in steps)
        if not at.border_px[mine].min() > reach:
            return False
    return True


def _nearest_label(at_nodes: npt.NDArray[np.int16], lattice: Lattice) -> npt.NDArray[np.int16]:
    """Return the nodes' labels carried to the pixels along smooth borders; slivers are left to their neighbours."""
    present = [k for k in np.unique(at_nodes)]
    labels = np.full((lattice.height, lattice.width), present[0], dtype=np.int16)
    if len(present) == 1:
        return labels
    most = lattice.dense((at_nodes == present[0]).astype(np.float32)).copy()
    for k in present[1:]:
        mine = lattice.dense((at_nodes == k).astype(np.float32))
        better = cv2.compare(mine, most, cv2.CMP_GT)
        cv2.copyTo(mine, better, most)
        cv2.copyTo(np.full_like(labels, k), better, labels)
    return labels


class Mixed(NamedTuple):
    """Pixels of a box that several frames give: their rows and columns in it, and the frame's ``(N,)`` weight."""

    row: npt.NDArray[np.int32]
    col: npt.NDArray[np.int32]
    weight: npt.NDArray[np.uint8]


def part_of(
    labels: npt.NDArray[np.int16], index: int, box: Box, nobody: npt.NDArray[np.uint8] | None = None
) -> tuple[Box, npt.NDArray[np.uint8] | None, Mixed | None] | None:
    """Return what a frame gives of a box of the domain, ``None`` where that is nothing.

    That is: the part of the box that it has to do with, 255 there where the pixels are its own (``None`` where all
    are), and the pixels that are mixed, along seams. ``box`` lies ``FEATHER_PX`` inside the domain. ``nobody`` is what
    ``nobodys_part`` says of the box.
    """
    margin = FEATHER_PX
    wide = labels[box.y - margin : box.y + box.height + margin, box.x - margin : box.x + box.width + margin]
    mine = cv2.compare(wide, index, cv2.CMP_EQ)
    if cv2.countNonZero(mine) == mine.size:
        return box, None, None
    x, y, w, h = cv2.boundingRect(mine)
    if w == 0:
        return None
    # In ``wide`` the pixels of ``box`` begin at ``margin``.
    left, top = max(x - margin, margin), max(y - margin, margin)
    right, bottom = min(x + w + margin, margin + box.width), min(y + h + margin, margin + box.height)
    if right <= left or bottom <= top:
        return None
    near = np.s_[top - margin : bottom + margin, left - margin : right + margin]
    side = 2 * margin + 1
    weight = cv2.blur(mine[near], (side, side))[margin:-margin, margin:-margin]
    own = mine[top:bottom, left:right]
    part = Box(left - margin + box.x, top - margin + box.y, right - left, bottom - top)
    # Along the map's rim nobody has a share: what one frame has beside nobody is not mixed.
    with_nobody = weight if nobody is None else cv2.add(weight, nobody[part.within(box)])
    found = cv2.findNonZero(cv2.bitwise_and(cv2.inRange(weight, 1, 255), cv2.inRange(with_nobody, 0, _ALL)))
    if found is None:
        return part, own, None
    col, row = found.reshape(-1, 2).T
    return part, own, Mixed(row, col, weight[row, col])


def nobodys_part(labels: npt.NDArray[np.int16], box: Box) -> npt.NDArray[np.uint8] | None:
    """Return what nobody has of the pixels of a box of the domain, as the weights of ``Mixed``; ``None``: nothing."""
    margin = FEATHER_PX
    wide = labels[box.y - margin : box.y + box.height + margin, box.x - margin : box.x + box.width + margin]
    if wide.min() > _NOBODY:
        return None
    none = cv2.compare(wide, _NOBODY, cv2.CMP_EQ)
    return np.asarray(cv2.blur(none, (2 * margin + 1, 2 * margin + 1))[margin:-margin, margin:-margin])


def consensus_weights(seen: Sequence[Seen]) -> FloatImage:
    """Return ``(N, rows, columns)`` weights of the frames' low frequencies at the nodes; they add up to 1, or to 0.

    Frames placed by GPS alone have a say only where registered ones end: their ground may be some metres off.
    """
    shape = seen[0].at_nodes.cost.shape
    weights = np.zeros((len(seen), *shape), dtype=np.float32)
    registered = np.array([one.view.tier < FILL_TIER for one in seen])
    if registered.all() or not registered.any():
        weights[:], _ = _class_weights(seen)
    else:
        trusted, depth = _class_weights([one for one, is_ in zip(seen, registered, strict=True) if is_])
        fills, fill_depth = _class_weights([one for one, is_ in zip(seen, registered, strict=True) if not is_])
        weights[registered] = trusted * (depth + _LEAST)
        weights[~registered] = fills * ((1.0 - depth) * fill_depth)
    total = weights.sum(axis=0)
    np.divide(weights, total, out=weights, where=total > 0)
    return weights


def shift_to_consensus(own: FloatImage, shares: Sequence[tuple[FloatImage, FloatImage]]) -> FloatImage:
    """Return ``(rows, columns, 3)`` what a frame's low frequencies lack to the weighted mean of all ``shares``.

    ``shares`` are ``(rows, columns, 1)`` weights and ``(rows, columns, 3)`` low frequencies. Frames that differ by more
    than light explains show another thing there (relief, an error in a placement, a car): they are not listened to,
    else the one's roof would shine through the other's lawn.
    """
    shift = np.zeros_like(own)
    for weight, other in shares:
        if other is own:
            continue
        difference = other - own
        level = (0.5 * (other + own)) @ _MEAN + _DARK
        relative = (np.abs(difference) @ _MEAN) / (LIGHT_EXPLAINS * level)
        relative *= relative
        shift += (weight[..., 0] / (1.0 + relative * relative))[..., None] * difference
    return shift


_LEAST = np.float32(1e-6)  # at the very edge of the map all tapers vanish together


def _class_weights(seen: Sequence[Seen]) -> tuple[FloatImage, FloatImage]:
    """Return normalised weights of frames of one class, and how deep inside one of them each node lies, 0 to 1."""
    cost = np.stack([_cost_near(one) for one in seen])
    best = np.min(cost, axis=0)
    with np.errstate(invalid="ignore"):
        near = np.maximum(1.0 - (cost - best) / WIDE_REACH, 0.0)
    tapers = np.stack([np.nan_to_num(taper(one.view, one.at_nodes.border_px)) for one in seen])
    weights = np.where(np.isfinite(cost), near * near * (tapers + _LEAST), 0.0)
    total = weights.sum(axis=0)
    weights = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
    return weights.astype(np.float32), np.max(tapers, axis=0).astype(np.float32)


def _cost_near(one: Seen) -> FloatImage:
    """Return the cost at the nodes, infinite where the frame does not see them.

    Nodes a little outside the raster count: pixels inside it are interpolated from them.
    """
    return np.where(np.isnan(one.at_nodes.cost), np.inf, one.at_nodes.cost)


def _dense_cost(one: Seen, lattice: Lattice, not_mine: npt.NDArray[np.bool_] | None = None) -> FloatImage:
    """Return ``(height, width)`` cost over the domain, NaN or infinite where the frame does not see the ground."""
    at_nodes = one.at_nodes.cost + TIER_COST * one.view.tier
    if not_mine is not None:
        at_nodes = at_nodes + SEAM_COST * not_mine
    cost = lattice.dense(at_nodes.astype(np.float32))
    if np.min(one.at_nodes.border_px) > 0.0:  # false where NaN
        return cost
    placement = one.view.placement
    xy = np.stack([one.at_nodes.x_px, one.at_nodes.y_px], axis=-1).astype(np.float32)
    inside = cv2.inRange(
        lattice.dense(xy), (-0.5, -0.5), (placement.width_px - 0.5, placement.height_px - 0.5)
    )  # NaN is in no range
    out = np.full(cost.shape, np.inf, dtype=np.float32)
    return np.asarray(cv2.copyTo(cost, inside, out))


def _cheapest(costs: Sequence[FloatImage], indices: Sequence[int], lattice: Lattice) -> npt.NDArray[np.int16]:
    best = np.full((lattice.height, lattice.width), np.inf, dtype=np.float32)
    labels = np.full(best.shape, _NOBODY, dtype=np.int16)
    for index in indices:
        better = cv2.compare(costs[index], best, cv2.CMP_LT)
        cv2.copyTo(costs[index], better, best)
        labels[better.view(np.bool_)] = index
    return labels
