"""The pixels of a tile, once it is known who gives which and what makes them part of the map.

Own pixels of all frames are resampled together (``resample``), in bands. The few along seams that several frames give
are drawn apart, as a list of points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.blend import Mixed, Seen, nobodys_part, part_of
from photomap_gis.mosaic.lattice import Box, FloatImage, Lattice, in_rows
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.resample import Atlas, Patch, in_groups, patch_of
from photomap_gis.mosaic.tiles import RgbaArray
from photomap_gis.mosaic.views import View

_BAND_PX = 128  # an even number; a band's arrays stay in the processor's cache
_NOWHERE_PX = -1e4  # out of every picture
_TWO_BY_TWO = np.ones((2, 2), dtype=np.uint8)


class Correction(NamedTuple):
    """What makes a frame's pixels part of the map: ``pixel * factor + offset``, ``(rows, columns, 3)`` at the nodes.

    ``nodes`` are those of a lattice as wide as light allows.
    """

    nodes: Lattice
    factor: FloatImage
    offset: FloatImage | None

    def dense(self, lattice: Lattice, box: Box) -> tuple[FloatImage, FloatImage | None]:
        """Return factor and offset at the pixels of a box of ``lattice``'s domain."""
        there = lattice.box_in(self.nodes, box)
        return self.nodes.dense(self.factor, there), (
            None if self.offset is None else self.nodes.dense(self.offset, there)
        )


class _Share(NamedTuple):
    """What one frame gives to a tile: the pixels of ``box`` where ``own`` is set (all, without it).

    ``xy_px`` is ``(rows, columns, 2)`` where its raster shows the lattice's nodes; ``mixed`` are the pixels of the box
    that it gives together with others, along seams.
    """

    box: Box
    own: npt.NDArray[np.uint8] | None
    mixed: Mixed | None
    xy_px: FloatArray
    patch: Patch
    correction: Correction


def paint(
    rgba: RgbaArray,
    candidates: Sequence[Seen],
    labels: npt.NDArray[np.int16],
    box: Box,
    lattice: Lattice,
    corrections: Mapping[int, Correction],
    image_of: Callable[[View], SourceImage],
) -> None:
    """Draw a box of the domain: each pixel is one frame's, along seams a mean of several; alpha is set everywhere."""
    shares = []
    nobody = nobodys_part(labels, box)
    for index, correction in corrections.items():
        part = part_of(labels, index, box, nobody)
        if part is not None:
            shares.append(_share(candidates[index], *part, lattice, image_of, correction))
    mixed: list[tuple[Mixed, Box, FloatImage]] = []
    for run in in_groups([share.patch.pixels.shape[0] for share in shares]):
        group = shares[run]
        atlas = Atlas([share.patch for share in group])
        nodes = [(s.xy_px + shift).astype(np.float32) for s, shift in zip(group, atlas.shifts, strict=True)]
        first = run.start == 0
        light = None if _fills(group) else _light_of(group, box, lattice)
        for top in range(0, box.height, _BAND_PX):  # in bands that stay in the processor's cache
            band = Box(box.x, box.y + top, box.width, min(_BAND_PX, box.height - top))
            drawn = _draw_band(atlas, group, nodes, light, band, lattice)
            there = rgba[top : top + band.height]
            if first:
                cv2.cvtColor(drawn, cv2.COLOR_BGR2RGBA, dst=there)
            else:
                cv2.add(there, cv2.cvtColor(drawn, cv2.COLOR_BGR2RGBA), dst=there)
        for share, xy_nodes, origin_px in zip(group, nodes, atlas.origins, strict=True):
            if share.mixed is not None:
                values = _mixed_values(atlas, share, xy_nodes, origin_px, lattice)
                mixed.append((share.mixed, share.box, values))
    if mixed:
        _blend(rgba, mixed, box)


def _share(
    one: Seen,
    box: Box,
    own: npt.NDArray[np.uint8] | None,
    mixed: Mixed | None,
    lattice: Lattice,
    image_of: Callable[[View], SourceImage],
    correction: Correction,
) -> _Share:
    image, scale = image_of(one.view)
    xy = np.stack([one.at_nodes.x_px, one.at_nodes.y_px], axis=-1)
    xy += 0.5
    xy *= scale
    xy -= 0.5
    patch = patch_of(image, xy[lattice.nodes_under(box)])
    if np.isnan(xy).any():  # where a node is not seen no pixel beside it is shown
        np.copyto(xy, _NOWHERE_PX, where=np.isnan(xy))
    return _Share(box, own, mixed, xy, patch, correction)


def _fills(shares: Sequence[_Share]) -> bool:
    """Whether one frame gives all pixels."""
    return len(shares) == 1 and shares[0].own is None


def _draw_band(
    atlas: Atlas,
    shares: Sequence[_Share],
    nodes: Sequence[FloatImage],
    light: _Light | None,
    band: Box,
    lattice: Lattice,
) -> ImageArray:
    """Return ``(height, width, 3)`` BGR of the frames' own pixels, black where there are none."""
    if light is None:
        return _lit(atlas.read(lattice.dense(nodes[0], band)), *shares[0].correction.dense(lattice, band))
    xy = np.zeros((band.height, band.width, 2), dtype=np.float32)
    for share, xy_nodes in zip(shares, nodes, strict=True):
        part = share.box.cut(band)
        if part is not None:
            own = None if share.own is None else share.own[part.within(share.box)]
            cv2.copyTo(lattice.dense(xy_nodes, part), own, xy[part.within(band)])
    return _lit(atlas.read(xy), *light.dense(band))


class _Light(NamedTuple):
    """What all frames' own pixels are corrected by, for one pixel of ``box`` in ``every`` a side.

    With an ``every`` of 2 pixels within a feather of a seam are not right to the pixel; they are drawn apart.
    """

    box: Box
    every: int
    factor: FloatImage
    offset: FloatImage | None

    def dense(self, band: Box) -> tuple[FloatImage, FloatImage | None]:
        """Return factor and offset at the pixels of a band of the box, which begins at an even row of it."""
        n, top = self.every, band.y - self.box.y
        rows = slice(top // n, -(-(top + band.height) // n))
        return self._enlarged(self.factor[rows], band), (
            None if self.offset is None else self._enlarged(self.offset[rows], band)
        )

    def _enlarged(self, values: FloatImage, band: Box) -> FloatImage:
        if self.every == 1:
            return values
        size = (self.every * values.shape[1], self.every * values.shape[0])
        large: FloatImage = cv2.resize(values, size, interpolation=cv2.INTER_NEAREST)
        return large[: band.height, : band.width]


def _light_of(shares: Sequence[_Share], box: Box, lattice: Lattice) -> _Light:
    """Return the frames' corrections put together, for every second pixel where they change slowly enough."""
    n = 2 if all(s.correction.nodes.step_px > lattice.step_px for s in shares) else 1
    shape = (-(-box.height // n), -(-box.width // n), 3)
    factor = np.zeros(shape, dtype=np.float32)
    offset = np.zeros(shape, dtype=np.float32) if any(s.correction.offset is not None for s in shares) else None
    for share in shares:
        x, y = share.box.x - box.x, share.box.y - box.y
        left, top = x // n, y // n
        before_x, before_y = x - n * left, y - n * top  # 0 or 1: the share's box may begin at an odd pixel
        right, bottom = -(-(x + share.box.width) // n), -(-(y + share.box.height) // n)
        nodes, there = share.correction.nodes, lattice.box_in(share.correction.nodes, share.box)
        whole = Box(there.x - before_x, there.y - before_y, n * (right - left), n * (bottom - top))
        own = share.own
        if own is not None and n == 2:
            wide = np.zeros((whole.height, whole.width), dtype=np.uint8)
            wide[before_y : before_y + share.box.height, before_x : before_x + share.box.width] = own
            own = np.ascontiguousarray(cv2.dilate(wide, _TWO_BY_TWO, anchor=(0, 0))[::2, ::2])  # any of the four
        for values, out in ((share.correction.factor, factor), (share.correction.offset, offset)):
            if values is not None and out is not None:
                cv2.copyTo(nodes.dense(values, whole, every=n), own, out[top:bottom, left:right])
    return _Light(box, n, factor, offset)


def _lit(pixels: ImageArray, factor: FloatImage, offset: FloatImage | None) -> ImageArray:
    """Return the pixels brought to the map's light; rounds and saturates once, at the last step."""
    if offset is None:
        return np.asarray(cv2.multiply(pixels, factor, dst=pixels, dtype=cv2.CV_8U))
    return np.asarray(cv2.add(cv2.multiply(pixels, factor, dtype=cv2.CV_32F), offset, dst=pixels, dtype=cv2.CV_8U))


def _mixed_values(
    atlas: Atlas, share: _Share, xy_nodes: FloatImage, origin_px: tuple[float, float], lattice: Lattice
) -> FloatImage:
    """Return ``(N, 3)`` BGR of a frame at the pixels that it gives together with others, brought to the map's light."""
    assert share.mixed is not None
    places = in_rows(share.mixed.col + share.box.x, share.mixed.row + share.box.y)
    height, width = share.patch.pixels.shape[:2]
    xy = lattice.at(xy_nodes, places)
    # A seam may run along the frame's edge: beyond it the patch ends, and another's begins. A cubic kernel reaches
    # one pixel back and two ahead.
    np.clip(xy, np.add(origin_px, 1.0), np.add(origin_px, (width - 3.0, height - 3.0)), out=xy)
    nodes = share.correction.nodes
    places += nodes.step_px - lattice.step_px
    values: FloatImage = nodes.at(share.correction.factor, places)
    values *= atlas.read(xy)
    if share.correction.offset is not None:
        values += nodes.at(share.correction.offset, places)
    return values.reshape(-1, 3)[: len(share.mixed.row)]


def _blend(rgba: RgbaArray, shares: Sequence[tuple[Mixed, Box, FloatImage]], box: Box) -> None:
    """Replace the pixels along seams by weighted means of ``(N, 3)`` BGR values."""
    places = [(m.row + (b.y - box.y)) * box.width + (m.col + (b.x - box.x)) for m, b, _ in shares]
    on_seam = np.zeros((box.height, box.width), dtype=np.uint8)
    for at in places:
        on_seam.reshape(-1)[at] = 1
    col, row = cv2.findNonZero(on_seam).reshape(-1, 2).T
    which = row * box.width + col
    number = np.empty(on_seam.size, dtype=np.int32)
    number[which] = np.arange(len(which), dtype=np.int32)
    total = np.zeros((4, len(which)), dtype=np.float32)  # a channel after the other: much faster than pixel by pixel
    for at, (mixed, _, values) in zip(places, shares, strict=True):
        here, weight = number[at], mixed.weight.astype(np.float32)
        for channel in range(3):
            total[channel][here] += weight * values[:, channel]  # no pixel twice
        total[3][here] += weight
    mean = np.empty((len(which), 4), dtype=np.uint8)
    for channel, out in ((2, 0), (1, 1), (0, 2)):
        mean[:, out] = np.clip(np.rint(total[channel] / total[3]), 0.0, 255.0)
    mean[:, 3] = 255
    rgba[row, col] = mean
