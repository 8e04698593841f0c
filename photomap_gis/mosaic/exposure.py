"""One exposure for all frames: gains per frame and channel and the lens's vignetting, solved over all overlaps.

Two frames that see the same ground should show the same value there. In logarithms this is linear: with gain x of a
frame and vignetting ``v . phi(r)``, ``log a + x_a + v . phi(r_a) = log b + x_b + v . phi(r_b)``. Every pair gives two
equations (the ground nearer to the one's centre, and to the other's), which tell gain from vignetting.

A prior holds every gain to 1: what one pair claims is believed, what a long chain of pairs adds up to is not. The
radiometry of the whole stays that of the photos.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from photomap_gis.core.similarity import FloatArray
from photomap_gis.mosaic.choice import radius_and_border
from photomap_gis.mosaic.lowband import LowBand
from photomap_gis.mosaic.views import View

SIGMA_GAIN = 0.07
SIGMA_PAIR = 0.03
SIGMA_VIGNETTE = 0.1
MAX_GAIN = 2.0
NEAREST_PAIRS = 12
MORE_PAIRS = 6
MAX_RADIUS = 1.2
"""Vignetting is not carried farther out than this, 1 being the corner."""

_SAMPLES_X, _SAMPLES_Y = 16, 12
_MIN_SAMPLES = 6
_DARKEST, _BRIGHTEST = 6.0, 246.0  # nearer to black or to saturation a ratio says nothing about exposure
_ROUNDS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """Factors that bring all frames to one exposure.

    ``gains`` maps a frame to its ``(3,)`` BGR gain; ``vignette`` is v in ``exp(v0 r^2 + v1 r^4)``, r = 1 at the corner.
    """

    gains: dict[int, FloatArray]
    vignette: tuple[float, float] = (0.0, 0.0)

    def factor(self, view: View, radius_px: FloatArray) -> FloatArray:
        """Return ``(..., 3)`` factors for a frame's pixels at these distances from its centre."""
        return np.asarray(self._of_lens(view, radius_px)[..., None] * self.gains.get(view.frame, np.ones(3)))

    def _of_lens(self, view: View, radius_px: FloatArray) -> FloatArray:
        r2 = np.square(np.minimum(radius_px / view.half_diagonal_px, MAX_RADIUS))
        lens = np.exp((self.vignette[0] + self.vignette[1] * r2) * r2)
        return np.where(np.isnan(lens), 1.0, lens)  # where the frame does not see the ground


class PairRatio(NamedTuple):
    """What one part of an overlap says: ``(3,)`` log(b / a), ``(2,)`` phi_a - phi_b, and its weight in samples."""

    a: int
    b: int
    log_ratio: FloatArray
    vignetting: FloatArray
    samples: int


def find_exposure(views: Sequence[View], low_band: Callable[[int], LowBand]) -> Exposure:
    """Return the exposure of these views, whose thumbnails ``low_band`` gives."""
    ratios: list[PairRatio] = []
    for a, b in overlapping_pairs(views):
        ratios += compare(a, b, low_band(a.frame), low_band(b.frame))
    return solve([view.frame for view in views], ratios)


def overlapping_pairs(views: Sequence[View]) -> Iterator[tuple[View, View]]:
    """Yield pairs whose footprints may overlap: of each frame the nearest ones and some of the farther."""
    reach = [view.half_diagonal_px * view.gsd_m_per_px for view in views]
    cell = 2.0 * max(reach, default=1.0)
    buckets: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    cells = [(math.floor(v.centre_xy_map_m[0] / cell), math.floor(v.centre_xy_map_m[1] / cell)) for v in views]
    for i, at in enumerate(cells):
        buckets[at].append(i)
    pairs: set[tuple[int, int]] = set()
    for i, (col, row) in enumerate(cells):
        around = [j for c in (-1, 0, 1) for r in (-1, 0, 1) for j in buckets.get((col + c, row + r), ()) if j != i]
        distance = {j: math.dist(views[i].centre_xy_map_m, views[j].centre_xy_map_m) for j in around}
        near = sorted((j for j in around if distance[j] < 0.8 * (reach[i] + reach[j])), key=distance.__getitem__)
        far = near[NEAREST_PAIRS:]
        spread = far[:: max(1, len(far) // MORE_PAIRS)][:MORE_PAIRS]
        pairs.update((min(i, j), max(i, j)) for j in near[:NEAREST_PAIRS] + spread)
    return ((views[i], views[j]) for i, j in sorted(pairs))


def compare(a: View, b: View, low_a: LowBand, low_b: LowBand) -> list[PairRatio]:
    """Return what the overlap of two views says about their exposures: two ratios, one, or none."""
    w, h = a.placement.width_px, a.placement.height_px
    grid_x, grid_y = np.meshgrid(
        (np.arange(_SAMPLES_X) + 0.5) * w / _SAMPLES_X - 0.5, (np.arange(_SAMPLES_Y) + 0.5) * h / _SAMPLES_Y - 0.5
    )
    xy_a = np.stack([grid_x.ravel(), grid_y.ravel()], axis=1)
    xy_b = b.locate(a.placement.camera_to_map.project(xy_a), slack_m=0.0)
    radius_a, _ = radius_and_border(a, xy_a[:, 0], xy_a[:, 1])
    radius_b, border_b = radius_and_border(b, xy_b[:, 0], xy_b[:, 1])
    values_a, values_b = (
        low.sample(xy[:, 0].astype(np.float32), xy[:, 1].astype(np.float32)).reshape(-1, 3)
        for low, xy in ((low_a, xy_a), (low_b, xy_b))
    )
    least, most = np.minimum(values_a, values_b).min(axis=1), np.maximum(values_a, values_b).max(axis=1)
    with np.errstate(invalid="ignore"):
        usable = (border_b > 0.0) & (least > _DARKEST) & (most < _BRIGHTEST)
    ratio = np.log(np.maximum(values_b, 1.0)) - np.log(np.maximum(values_a, 1.0))
    rho_a, rho_b = radius_a / a.half_diagonal_px, radius_b / b.half_diagonal_px
    phi = np.stack([rho_a**2 - rho_b**2, rho_a**4 - rho_b**4], axis=1)
    out = []
    for part in (usable & (phi[:, 0] <= 0.0), usable & (phi[:, 0] > 0.0)):
        count = int(np.count_nonzero(part))
        if count >= _MIN_SAMPLES:
            # The median: what moved, or stands high, must not pass for exposure.
            out.append(PairRatio(a.frame, b.frame, np.median(ratio[part], axis=0), phi[part].mean(axis=0), count))
    return out


def solve(frames: Sequence[int], ratios: Sequence[PairRatio]) -> Exposure:
    """Return the robust least-squares exposure of frames whose pairs show these ratios."""
    if not ratios:
        return Exposure({frame: np.ones(3) for frame in frames})
    index = {frame: k for k, frame in enumerate(frames)}
    a = np.array([index[r.a] for r in ratios])
    b = np.array([index[r.b] for r in ratios])
    log_ratio = np.stack([r.log_ratio for r in ratios])
    phi = np.stack([r.vignetting for r in ratios])
    weight = np.array([min(r.samples / 40.0, 1.0) for r in ratios])
    _, vignette = _solve_channel(len(frames), a, b, log_ratio.mean(axis=1), phi, weight)
    rest = log_ratio - (phi @ vignette)[:, None]
    logs = [_solve_channel(len(frames), a, b, rest[:, c], None, weight)[0] for c in range(3)]
    gains = np.exp(np.clip(np.stack(logs, axis=1), -math.log(MAX_GAIN), math.log(MAX_GAIN)))
    return Exposure({frame: gains[k] for frame, k in index.items()}, (float(vignette[0]), float(vignette[1])))


def _solve_channel(
    count: int, a: np.ndarray, b: np.ndarray, log_ratio: FloatArray, phi: FloatArray | None, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve ``x_a - x_b + phi . v = log_ratio`` with priors on x and v, by iteratively reweighted least squares."""
    rows = np.arange(len(a))
    extra = 0 if phi is None else 2
    columns = [a, b]
    entries = [np.ones(len(a)), -np.ones(len(a))]
    if phi is not None:
        columns += [np.full(len(a), count), np.full(len(a), count + 1)]
        entries += [phi[:, 0], phi[:, 1]]
    design = sparse.csr_matrix(
        (np.concatenate(entries), (np.tile(rows, len(columns)), np.concatenate(columns))), (len(a), count + extra)
    )
    prior = np.concatenate([np.full(count, SIGMA_GAIN**-2), np.full(extra, SIGMA_VIGNETTE**-2)])
    x = np.zeros(count + extra)
    robust = np.ones(len(a))
    for _ in range(_ROUNDS):
        w = sparse.diags_array(weight * robust / SIGMA_PAIR**2)
        normal = (design.T @ w @ design + sparse.diags_array(prior)).tocsc()
        x = np.asarray(spsolve(normal, design.T @ (w @ log_ratio))).reshape(-1)
        residual = np.abs(log_ratio - design @ x) / (2.0 * SIGMA_PAIR)
        robust = 1.0 / np.maximum(residual, 1.0)  # Huber
    return x[:count], x[count:]
