"""The normal equations of the full solution, the spots' levels taken out of them.

A spot hangs on one number, so taking it out is a division; what is left is a dense system of the views and lenses, six
numbers a view. It is put together pair by pair and then anchor by anchor, which is how the ties lie.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import linalg

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.marks import MarkTerms, add_marks
from photomap_gis.slam.bundle.model import Linearised, along_spots
from photomap_gis.slam.bundle.problem import BundleProblem, BundleState, IntArray, log_rotation

HELD_SIGMA = 1e-4
"""How firmly a held view's centre stays, as a share of its height, and its heading, in radians."""


@dataclass(frozen=True, slots=True, eq=False)
class SpotPrior:
    """What is known of the spots' z beforehand: ``(P,)`` values and informations about a surface.

    The surface itself may give: it is ``z + bends @ c`` with unknown ``c`` ``(K,)`` of zero mean and ``bend_sigma``
    ``(K,)``. A surface that was found from the same ties is not known better than those tell it.

    All of it is said in units of the flying height, which goes with the focal length of the anchors' lens: ``lens``
    ``(P,)``, ``log_focal`` ``(L,)`` where it was said. In metres it would favour the shorter lens, under which the same
    parallax makes a lower relief, by as much as there are spots.
    """

    z: FloatArray
    information: FloatArray
    bends: FloatArray
    bend_sigma: FloatArray
    lens: IntArray
    log_focal: FloatArray

    def off(self, state: BundleState) -> tuple[FloatArray, FloatArray]:
        """Return how far the spots lie off the surface ``(P,)``, and the derivative of that by their z ``(P,)``."""
        unit = np.exp(self.log_focal - state.log_focal)[self.lens]
        return state.z * unit - self.z, unit


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """``H step = -g`` of views, lenses and the surface's bends, and how the spots follow: ``dz = -(g_z + V step) / A``.

    ``V`` is kept anchor by anchor: for each, its spots, its columns, and the ``(spots, columns)`` block.
    """

    H: FloatArray
    g: FloatArray
    spot_information: FloatArray
    spot_gradient: FloatArray
    blocks: tuple[tuple[IntArray, IntArray, FloatArray], ...]

    def spots_for(self, step: FloatArray) -> FloatArray:
        """Return the spots' step ``(P,)`` that goes with one of views and lenses."""
        pull = self.spot_gradient.copy()
        for spots, columns, V in self.blocks:
            pull[spots] += V @ step[columns]
        return -pull / self.spot_information


def reduced_equations(
    problem: BundleProblem,
    state: BundleState,
    found: Linearised,
    information: FloatArray,
    prior: SpotPrior,
    free_lens: np.ndarray,
    marked: MarkTerms | None = None,
) -> Reduced:
    """Return the equations at a state; ``information`` ``(M, 2, 2)`` of the ties, 0 for those put aside.

    ``free_lens`` ``(L, 2)`` says which lens numbers may change. ``marked`` are the terms of the known points.
    """
    t, n, lenses = problem.ties, len(problem.views), len(problem.lenses)
    bends = prior.bends.shape[1]
    size = 6 * n + 2 * lenses + bends
    H, g = np.zeros((size, size)), np.zeros(size)
    lens_of = problem.lens_of
    W = np.where(found.valid[:, None, None], information, 0.0)
    J = np.concatenate([found.by_a, found.by_b, found.by_lens_a, found.by_lens_b], axis=2)
    WJ = W @ J
    residual = found.residual
    for begin, end in runs_of(t.a, t.b):
        left, right = int(t.a[begin]), int(t.b[begin])
        column = np.concatenate(
            [
                6 * left + np.arange(6),
                6 * right + np.arange(6),
                6 * n + 2 * int(lens_of[left]) + np.arange(2),
                6 * n + 2 * int(lens_of[right]) + np.arange(2),
            ]
        )
        weighted = WJ[begin:end].reshape(-1, 16)
        block, pull = J[begin:end].reshape(-1, 16).T @ weighted, residual[begin:end].ravel() @ weighted
        if lens_of[left] == lens_of[right]:  # two parts of one lens meet in the same place
            block, pull, column = _LENS_ONCE.T @ block @ _LENS_ONCE, pull @ _LENS_ONCE, column[:14]
        H[column[:, None], column] += block
        g[column] += pull
    by_z = found.by_z
    Wz = np.einsum("mij,mj->mi", W, by_z)
    off, unit = prior.off(state)
    held = prior.information * unit
    A = held * unit + np.bincount(t.spot, np.sum(Wz * by_z, axis=1), t.spots)
    gz = held * off + np.bincount(t.spot, np.sum(Wz * found.residual, axis=1), t.spots)
    by_focal = -state.z * unit
    JWz = np.einsum("mij,mi->mj", J, Wz)
    blocks = []
    for begin, end in runs_of(t.b):
        spots, row = np.unique(t.spot[begin:end], return_inverse=True)
        a = t.a[begin:end]
        frames, at = np.unique(a, return_inverse=True)
        own = 6 * len(frames)
        V = np.zeros((len(spots), own + 6 + 2 * lenses + bends))
        V[:, own + 6 + 2 * lenses :] = -held[spots, None] * prior.bends[spots]
        part = JWz[begin:end]
        np.add.at(V, (row[:, None], 6 * at[:, None] + np.arange(6)), part[:, :6])
        np.add.at(V, (row[:, None], own + np.arange(6)[None]), part[:, 6:12])
        np.add.at(V, (row[:, None], own + 6 + 2 * lens_of[a][:, None] + np.arange(2)), part[:, 12:14])
        b = int(t.b[begin])
        np.add.at(V, (row[:, None], own + 6 + 2 * lens_of[b] + np.arange(2)[None]), part[:, 14:16])
        V[:, own + 6 + 2 * lens_of[b]] += held[spots] * by_focal[spots]
        column = np.concatenate(
            [
                (6 * frames[:, None] + np.arange(6)).ravel(),
                6 * b + np.arange(6),
                6 * n + np.arange(2 * lenses + bends),
            ]
        )
        weighted = V / A[spots][:, None]
        H[np.ix_(column, column)] -= V.T @ weighted
        g[column] -= weighted.T @ gz[spots]
        blocks.append((spots, column, V))
    if marked is not None:
        add_marks(H, g, problem.marks, marked, lens_of, n)
    _add_surface(H, g, prior, off, by_focal, first_lens=6 * n)
    _add_priors(H, g, problem, state, free_lens)
    return Reduced(H, g, A, gz, tuple(blocks))


def _add_surface(
    H: FloatArray, g: FloatArray, prior: SpotPrior, off: FloatArray, by_focal: FloatArray, *, first_lens: int
) -> None:
    """Add what the surface says of the lenses, which tell the unit of heights, and of its own bends."""
    bends = prior.bends.shape[1]
    surface = slice(len(g) - bends, len(g))
    pull = prior.information * off
    for k in range(len(prior.log_focal)):
        row, of = first_lens + 2 * k, prior.lens == k
        H[row, row] += by_focal[of] ** 2 @ prior.information[of]
        g[row] += by_focal[of] @ pull[of]
        across = -(by_focal[of] * prior.information[of]) @ prior.bends[of]
        H[row, surface] += across
        H[surface, row] += across
    if bends:
        H[surface, surface] += (prior.bends.T * prior.information) @ prior.bends + np.diag(prior.bend_sigma**-2.0)
        g[surface] -= prior.bends.T @ pull


def spots_settled(problem: BundleProblem, state: BundleState, information: FloatArray, prior: SpotPrior) -> BundleState:
    """Return the state with each spot where the ties and the surface want it from here, views and lenses left alone.

    A long step bends: as cameras move, rays and levels turn together, which a step of both at once leaves out. On flat
    ground that is all that keeps a step along the weakest direction (focal length against height) from being whole.
    """
    residual, by_z, valid = along_spots(problem, state)
    spot, count = problem.ties.spot, problem.ties.spots
    Wz = np.einsum("mij,mj->mi", np.where(valid[:, None, None], information, 0.0), by_z)
    off, unit = prior.off(state)
    held = prior.information * unit
    A = held * unit + np.bincount(spot, np.sum(Wz * by_z, axis=1), count)
    gz = held * off + np.bincount(spot, np.sum(Wz * residual, axis=1), count)
    if prior.bends.shape[1]:  # the surface goes along
        left = prior.information - held**2 / A
        stiff = (prior.bends.T * left) @ prior.bends + np.diag(prior.bend_sigma**-2.0)
        bend = np.linalg.solve(stiff, prior.bends.T @ (prior.information * off - held * gz / A))
        gz -= held * (prior.bends @ bend)
    return replace(state, z=state.z - gz / A)


def prior_cost(problem: BundleProblem, state: BundleState, prior: SpotPrior) -> float:
    """Return the weighted squares of everything but the ties."""
    off, _ = prior.off(state)
    total = float(np.sum(prior.information * off**2))
    if prior.bends.shape[1]:  # the surface gives as far as it likes
        pull = prior.bends.T @ (prior.information * off)
        stiff = (prior.bends.T * prior.information) @ prior.bends + np.diag(prior.bend_sigma**-2.0)
        total -= float(pull @ np.linalg.solve(stiff, pull))
    total += sum(float(p @ r @ p) for p, r in _turn_terms(problem, state))
    height = np.array([v.height for v in problem.views])
    sigma = np.array([v.height_sigma for v in problem.views])
    told = np.isfinite(sigma)
    total += float(np.sum(((-state.centre[told, 2] - height[told]) / sigma[told]) ** 2))
    miss = state.centre[problem.fix_of, :2] - problem.fix_xy
    total += float(np.einsum("ik,ij,jk->", miss, problem.fix_information, miss)) if len(miss) else 0.0
    for k, lens in enumerate(problem.lenses):
        total += float(((state.log_focal[k] - np.log(lens.focal_px)) / lens.focal_sigma_log) ** 2)
        total += float(((state.k1[k] - lens.camera.k1) / lens.k1_sigma) ** 2)
    return total


def _add_priors(
    H: FloatArray, g: FloatArray, problem: BundleProblem, state: BundleState, free_lens: np.ndarray
) -> None:
    n = len(problem.views)
    for k, (turn, known) in enumerate(_turn_terms(problem, state)):
        turns = slice(6 * k + 3, 6 * k + 6)
        H[turns, turns] += known
        g[turns] += known @ turn
    for k, view in enumerate(problem.views):
        if np.isfinite(view.height_sigma):
            H[6 * k + 2, 6 * k + 2] += view.height_sigma**-2
            g[6 * k + 2] += (state.centre[k, 2] + view.height) * view.height_sigma**-2
    if len(problem.fix_of):
        off = state.centre[problem.fix_of, :2] - problem.fix_xy
        for axis in (0, 1):
            fixed = 6 * problem.fix_of + axis
            H[np.ix_(fixed, fixed)] += problem.fix_information
            g[fixed] += problem.fix_information @ off[:, axis]
    for k in problem.held.tolist():
        start = problem.views[k]
        firm = (HELD_SIGMA * max(abs(float(start.centre[2])), 1e-6)) ** -2
        for axis in range(3):
            H[6 * k + axis, 6 * k + axis] += firm
            g[6 * k + axis] += firm * (state.centre[k, axis] - start.centre[axis])
        turn = log_rotation((state.R[k] @ start.R_map_camera.T)[None])[0, 2]
        H[6 * k + 5, 6 * k + 5] += HELD_SIGMA**-2
        g[6 * k + 5] += HELD_SIGMA**-2 * turn
    for k, lens in enumerate(problem.lenses):
        misses = (state.log_focal[k] - np.log(lens.focal_px), state.k1[k] - lens.camera.k1)
        for part, (sigma, miss) in enumerate(zip((lens.focal_sigma_log, lens.k1_sigma), misses, strict=True)):
            row = 6 * n + 2 * k + part
            if free_lens[k, part]:
                H[row, row] += sigma**-2
                g[row] += miss * sigma**-2
            else:
                H[row, :], H[:, row], g[row] = 0.0, 0.0, 0.0
                H[row, row] = 1.0


def _turn_terms(problem: BundleProblem, state: BundleState) -> list[tuple[FloatArray, FloatArray]]:
    """Return each view's turn from what was reported ``(3,)`` and that report's information ``(3, 3)``."""
    turn = log_rotation(state.R @ np.array([v.R_prior for v in problem.views]).transpose(0, 2, 1))
    sigma = np.array([(v.tilt_sigma_rad, v.tilt_sigma_rad, v.heading_sigma_rad) for v in problem.views])
    return [(w, np.diag(s**-2.0)) for w, s in zip(turn, sigma, strict=True)]


_LENS_ONCE = np.vstack([np.eye(14), np.eye(14)[12:]])
"""``(16, 14)``: takes two parts of one lens together."""


def runs_of(*keys: IntArray) -> list[tuple[int, int]]:
    """Return where each run of equal keys begins and ends."""
    changes = np.flatnonzero(np.any([np.diff(k) != 0 for k in keys], axis=0)) + 1
    bounds = [0, *changes.tolist(), len(keys[0])]
    return [(i, j) for i, j in pairwise(bounds) if j > i]


def solve_spd(H: FloatArray, g: FloatArray) -> FloatArray:
    """Return ``-H^-1 g`` for ``g`` ``(n,)`` or ``(n, k)``.

    Raises ``numpy.linalg.LinAlgError`` where H is not positive definite.
    """
    factor, scale = _factor(H)
    scale = scale if g.ndim == 1 else scale[:, None]
    return np.asarray(-scale * linalg.cho_solve((factor, True), scale * g, check_finite=False), np.float64)


def blocks_of_inverse(H: FloatArray, blocks: int) -> FloatArray:
    """Return the first ``blocks`` 6 x 6 blocks on the diagonal of the inverse, ``(blocks, 6, 6)``.

    Raises ``numpy.linalg.LinAlgError`` where H is not positive definite.
    """
    factor, scale = _factor(H)
    roots, failed = linalg.lapack.dtrtri(factor, lower=1, overwrite_c=1)
    if failed:
        raise np.linalg.LinAlgError("the matrix is not positive definite")
    out = np.empty((blocks, 6, 6))
    for k in range(blocks):
        own = slice(6 * k, 6 * k + 6)
        below = np.vstack([np.tril(roots[own, own]), roots[6 * k + 6 :, own]])
        out[k] = (below.T @ below) * scale[own, None] * scale[None, own]
    return out


def _factor(H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower Cholesky factor of H scaled to a unit diagonal, and the scale."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    scaled = np.multiply(H, scale[:, None], order="F")
    scaled *= scale
    return linalg.cho_factor(scaled, lower=True, overwrite_a=True, check_finite=False)[0], scale
