"""The layers of a finished map, worked out tile by tile from where the frames lie, and kept on disk like its tiles.

Nothing is opened but the tiles' own notes of which frame each pixel shows: that a frame saw a spot follows from its
placement. All registered and GPS-placed frames count, also those that gave the map no pixel; frames that could not be
read do not.
"""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from photomap_gis.core.grid import CrsFrame, MapGrid, TileIndex, Window, ground_pixel_m
from photomap_gis.core.layer import LAYERS, Layer, Searched, empty
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.lattice import STEP_PX, FloatImage, Lattice
from photomap_gis.mosaic.layer_store import LayerStore, LayerTile
from photomap_gis.mosaic.measured import load_measured
from photomap_gis.mosaic.plan import tile_span
from photomap_gis.mosaic.preference import detail_m
from photomap_gis.mosaic.tiles import NOBODY, SourceArray, TileStore
from photomap_gis.mosaic.views import View, all_views_of
from photomap_gis.parallel import give_back_memory, map_jobs, usable_cpus

RECIPE = "1"
"""Changes whenever the same map would have other layers."""

_FOLDER = "layers"
_TILES_BETWEEN_TRIMS = 16
_SLACK_NODES = 3.0
_SIGMA_STEP = 2  # a placement's covariance is asked at every so many nodes: it hardly changes within a tile
_BEYOND = 0.15  # how far outside a raster, in its sides, its placement may be asked
_ROUND_BITS = 12  # of a float's 23 bits of fraction: what is left is true to 0.03 %, and packs well


@dataclass(frozen=True, slots=True, eq=False)
class FrameFacts:
    """What else layers tell of frames: ``times_s`` in Unix seconds, ``blur_px`` (NaN: unknown), by frame."""

    times_s: Mapping[int, float] = field(default_factory=dict)
    blur_px: Mapping[int, float] = field(default_factory=dict)

    @property
    def newest_s(self) -> float:
        """The newest frame's time, NaN where none is known."""
        return max(self.times_s.values(), default=math.nan)


def render_layers(
    store: TileStore,
    trajectory: Trajectory,
    map_frame: CrsFrame,
    *,
    times_s: Mapping[int, float],
    workers: int | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> LayerStore:
    """Work out the layers of a finished map beside its tiles; what a killed run left of the same ones is kept.

    ``times_s`` are the frames' times in Unix seconds, as far as they are known. Memory is a few tiles, whatever the
    map's size.
    """
    measured = load_measured(store)
    blur_px = {} if measured is None else measured.blur_px
    unreadable = frozenset[int]() if measured is None else measured.unreadable
    readable = Trajectory(tuple(p for p in trajectory.placements if p.frame not in unreadable), trajectory.revision)
    views = all_views_of(readable)
    seen = {view.frame for view in views}
    facts = FrameFacts({f: t for f, t in times_s.items() if f in seen}, blur_px)
    layers = LayerStore.open(store.folder / _FOLDER, store.grid, _fingerprint(store, views, facts))
    by_tile: defaultdict[TileIndex, list[View]] = defaultdict(list)
    for view in views:
        span = tile_span(view, store.grid, map_frame)
        if span is not None:
            for row in range(span.first_row, span.last_row + 1):
                for col in range(span.first_col, span.last_col + 1):
                    by_tile[TileIndex(row, col)].append(view)
    tiles = sorted(by_tile)

    def render(tile: TileIndex) -> None:
        if not layers.done(tile):
            window = store.grid.window(tile)
            layers.write(tile, layers_of(window, store.grid, map_frame, by_tile[tile], store.read_source(tile), facts))

    for done, _ in enumerate(map_jobs(render, tiles, workers=workers or usable_cpus()), start=1):
        if done % _TILES_BETWEEN_TRIMS == 0:
            give_back_memory()
        if on_progress is not None:
            on_progress(done, len(tiles))
    give_back_memory()
    return layers


def layers_of(
    window: Window,
    grid: MapGrid,
    map_frame: CrsFrame,
    views: Iterable[View],
    source: SourceArray,
    facts: FrameFacts,
) -> LayerTile:
    """Return all layers of a window of the grid; ``source`` is ``(height, width)`` which frame each pixel shows."""
    out = {layer: empty(layer, window.height, window.width) for layer in LAYERS}
    shown = source != NOBODY
    out[Layer.SOURCE_FRAME][0] = source
    lattice, pixel_m = Lattice.over(window, grid, map_frame), ground_pixel_m(grid, map_frame)
    count, last = out[Layer.VIEWS][0], np.full(source.shape, -math.inf)
    best = np.full(source.shape, np.inf, dtype=np.float32)
    for view in views:
        sighting = _sighting(view, lattice, pixel_m, window)
        if sighting is None:
            continue
        mask = sighting.mask & shown
        count += mask
        time_s = facts.times_s.get(view.frame, math.nan)
        if math.isfinite(time_s):
            np.maximum(last, time_s, out=last, where=mask)
        blur_px = facts.blur_px.get(view.frame, math.nan)
        if math.isfinite(blur_px):
            detail = sighting.gsd_m * np.float32(detail_m(1.0, blur_px))
            better = mask & (detail < best)
            np.copyto(best, detail, where=better)
            age_s = facts.newest_s - time_s
            values: dict[Searched, npt.NDArray[Any] | float] = {
                Searched.RESOLUTION: detail, Searched.GSD: sighting.gsd_m, Searched.BLUR: blur_px, Searched.AGE: age_s
            }  # fmt: skip
            for band, name in enumerate(Searched):
                np.copyto(out[Layer.SEARCHED][band], values[name], where=better)
        mine = source == view.frame
        if mine.any():
            np.copyto(out[Layer.SIGMA][0], _sigma(view, lattice, window), where=mine)
    np.copyto(out[Layer.LAST_SEEN][0], np.rint(np.maximum(last, 0.0)).astype(np.uint32), where=last > 0.0)
    for layer in (Layer.SIGMA, Layer.SEARCHED):
        out[layer] = _rounded(out[layer])
    return out


class _Sighting(NamedTuple):
    """How a view sees a window: ``mask`` where, ``gsd_m`` with how large a pixel on the ground."""

    mask: npt.NDArray[np.bool_]
    gsd_m: FloatImage


def _sighting(view: View, lattice: Lattice, pixel_m: float, window: Window) -> _Sighting | None:
    xy_px = view.locate(lattice.nodes_xy_map_m, slack_m=_SLACK_NODES * STEP_PX * pixel_m)
    if not np.isfinite(xy_px).any():
        return None
    nodes = xy_px.reshape(*lattice.shape, 2)
    inner = np.s_[STEP_PX : STEP_PX + window.height, STEP_PX : STEP_PX + window.width]
    x, y = (lattice.dense(np.ascontiguousarray(nodes[..., k], np.float32))[inner] for k in (0, 1))
    w, h = view.placement.width_px, view.placement.height_px
    with np.errstate(invalid="ignore"):
        mask = (np.abs(x - (w - 1) / 2.0) <= w / 2.0) & (np.abs(y - (h - 1) / 2.0) <= h / 2.0)
    if not mask.any():
        return None
    # How far apart neighbouring nodes lie on the ground, and in the frame: its pixel along the coarser axis.
    ground = lattice.nodes_xy_map_m.reshape(*lattice.shape, 2)
    J_frame, J_ground = (np.stack(np.gradient(a, axis=(1, 0)), axis=-1) for a in (nodes, ground))
    with np.errstate(all="ignore"):
        gsd = _largest_stretch(J_ground, J_frame).astype(np.float32)
    return _Sighting(mask, lattice.dense(gsd)[inner])


def _largest_stretch(J_to: FloatArray, J_from: FloatArray) -> FloatArray:
    """``(...)`` largest singular value of ``J_to @ inv(J_from)``, both ``(..., 2, 2)``; NaN where it has none."""
    a, b, c, d = (J_from[..., i, j] for i in (0, 1) for j in (0, 1))
    det = a * d - b * c
    inverse = (
        np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
        / np.where(det != 0.0, det, np.nan)[..., None, None]
    )
    m = J_to @ inverse
    half, apart = 0.5 * np.sum(m * m, axis=(-2, -1)), m[..., 0, 0] * m[..., 1, 1] - m[..., 0, 1] * m[..., 1, 0]
    return np.asarray(np.sqrt(half + np.sqrt(np.maximum(half * half - apart * apart, 0.0))))


def _sigma(view: View, lattice: Lattice, window: Window) -> FloatImage:
    """``(height, width)`` predicted one sigma per axis of the view's placement."""
    rows, cols = lattice.shape
    pick_rows, pick_cols = (np.unique(np.r_[0:n:_SIGMA_STEP, n - 1]) for n in (rows, cols))
    asked = lattice.nodes_xy_map_m.reshape(rows, cols, 2)[np.ix_(pick_rows, pick_cols)].reshape(-1, 2)
    with np.errstate(all="ignore"):
        xy_px = np.nan_to_num(view.placement.camera_to_map.unproject(asked))
    size = np.array([view.placement.width_px, view.placement.height_px])
    near = np.clip(xy_px, -_BEYOND * size, (1.0 + _BEYOND) * size)  # but never as far as a horizon
    covariance = view.placement.position_covariance_m2(near)
    # The variance grows with the square of the distance from some spot: smoother than its root.
    variance = (np.trace(covariance, axis1=1, axis2=2) / 2.0).reshape(len(pick_rows), len(pick_cols))
    along = np.array([np.interp(np.arange(cols), pick_cols, line) for line in variance])
    full = np.array([np.interp(np.arange(rows), pick_rows, line) for line in along.T]).T.astype(np.float32)
    return np.sqrt(lattice.dense(full)[STEP_PX : STEP_PX + window.height, STEP_PX : STEP_PX + window.width])


def _rounded(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return floats to 0.03 %."""
    bits = values.view(np.uint32)
    half, mask = np.uint32(1 << (_ROUND_BITS - 1)), np.uint32(0xFFFFFFFF << _ROUND_BITS & 0xFFFFFFFF)
    return np.where(np.isnan(values), np.float32(np.nan), ((bits + half) & mask).view(np.float32))


def _fingerprint(store: TileStore, views: Sequence[View], facts: FrameFacts) -> str:
    """Return a digest of all that decides what the layers say."""
    digest = hashlib.sha256(f"{RECIPE} {store.fingerprint} {store.grid!r}".encode())
    for view in views:
        f, covariance = view.frame, view.placement.pose_covariance
        digest.update(f"{f} {facts.times_s.get(f)} {facts.blur_px.get(f)}".encode())
        digest.update(np.asarray(covariance, dtype=np.float64).tobytes())
    return digest.hexdigest()
