"""The normal equations of the full solution, the spots' levels taken out of them.

A spot hangs on one number, so taking it out is a division; what is left are blocks of the views that met over it, and
what views have to do with lenses and surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.layout import Layout
from photomap_gis.slam.bundle.marks import MarkTerms
from photomap_gis.slam.bundle.model import Linearised, along_spots
from photomap_gis.slam.bundle.normal import Normal
from photomap_gis.slam.bundle.problem import BundleProblem, BundleState, IntArray, log_rotation
from photomap_gis.slam.bundle.sums import add_ties, take_spots_out

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
    """The equations of views, lenses and the surface's bends, and how the spots follow: ``dz = -(slope + V step) / A``.

    ``V`` is kept tie by tie: ``with_z`` ``(M, 16)`` by both views and both lenses, and ``held`` ``(P, 2 L + K)``.
    """

    normal: Normal
    spot_information: FloatArray
    spot_gradient: FloatArray
    with_z: FloatArray
    held: FloatArray

    def spots_for(self, problem: BundleProblem, step: FloatArray) -> FloatArray:
        """Return the spots' step ``(P,)`` that goes with one of views, lenses and bends."""
        t, n, lens_of = problem.ties, len(problem.views), problem.lens_of
        views, lenses = step[: 6 * n].reshape(n, 6), step[6 * n : 6 * n + 2 * len(problem.lenses)].reshape(-1, 2)
        moved = np.concatenate([views[t.a], views[t.b], lenses[lens_of[t.a]], lenses[lens_of[t.b]]], axis=1)
        pull = np.bincount(t.spot, np.einsum("mi,mi->m", self.with_z, moved), t.spots)
        return -(self.spot_gradient + pull + self.held @ step[6 * n :]) / self.spot_information


def reduced_equations(
    layout: Layout,
    problem: BundleProblem,
    state: BundleState,
    found: Linearised,
    information: FloatArray,
    prior: SpotPrior,
    free_lens: np.ndarray,
    marked: MarkTerms | None = None,
) -> Reduced:
    """Return the equations at a state; ``information`` ``(M, 2, 2)`` of the ties, 0 for those put aside.

    ``layout`` is that of the problem. ``free_lens`` ``(L, 2)`` says which lens numbers may change. ``marked`` are the
    terms of the known points.
    """
    t, lens_of = problem.ties, problem.lens_of
    W = np.where(found.valid[:, None, None], information, 0.0)
    J = np.concatenate([found.by_a, found.by_b, found.by_lens_a, found.by_lens_b], axis=2)
    off, unit = prior.off(state)
    known = prior.information * unit
    by_focal = -state.z * unit
    held = np.zeros((t.spots, layout.border.seen))
    held[np.arange(t.spots), 2 * prior.lens] = known * by_focal
    held[:, 2 * len(problem.lenses) :] = -known[:, None] * prior.bends
    normal = Normal.nothing(layout, problem.fix_of, problem.fix_noise)
    curvature, slope, with_z = np.zeros(len(t)), np.zeros(len(t)), np.zeros((len(t), J.shape[2]))
    lens_a, lens_b = lens_of[t.a], lens_of[t.b]
    into = normal.blocks, normal.g, normal.cross, normal.border, normal.g_border
    add_ties(t.a, t.b, lens_a, lens_b, layout.own_slot, found.residual, J, W, found.by_z, *into,
             curvature, slope, with_z)  # fmt: skip
    A = known * unit + np.bincount(t.spot, curvature, t.spots)
    gz = known * off + np.bincount(t.spot, slope, t.spots)
    take_spots_out(layout.tie_order, layout.spot_start, t.a, t.b, lens_a, lens_b, layout.own_slot, layout.met_slot,
                   A, gz, with_z, held, *into)  # fmt: skip
    if marked is not None:
        normal.add_marks(problem.marks.view, lens_of[problem.marks.view], marked)
    _add_surface(normal, prior, off, by_focal)
    _add_priors(normal, problem, state)
    fixed = np.flatnonzero(~np.asarray(free_lens, bool).ravel())
    return Reduced(normal.without(fixed), A, gz, with_z, held)


def _add_surface(normal: Normal, prior: SpotPrior, off: FloatArray, by_focal: FloatArray) -> None:
    """Add what the surface says of the lenses, which tell the unit of heights, and of its own bends."""
    H, g, lenses = normal.border, normal.g_border, len(prior.log_focal)
    surface = slice(2 * lenses, 2 * lenses + prior.bends.shape[1])
    pull = prior.information * off
    for k in range(lenses):
        row, of = 2 * k, prior.lens == k
        H[row, row] += by_focal[of] ** 2 @ prior.information[of]
        g[row] += by_focal[of] @ pull[of]
        across = -(by_focal[of] * prior.information[of]) @ prior.bends[of]
        H[row, surface] += across
        H[surface, row] += across
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
    turn, known = _turn_terms(problem, state)
    total += float(np.sum(known * turn**2))
    height, sigma = _heights(problem)
    told = np.isfinite(sigma)
    total += float(np.sum(((-state.centre[told, 2] - height[told]) / sigma[told]) ** 2))
    miss = state.centre[problem.fix_of, :2] - problem.fix_xy
    total += float(np.sum(miss * (problem.fix_noise.information @ miss)))
    for k, lens in enumerate(problem.lenses):
        total += float(((state.log_focal[k] - np.log(lens.focal_px)) / lens.focal_sigma_log) ** 2)
        total += float(((state.k1[k] - lens.camera.k1) / lens.k1_sigma) ** 2)
    return total


def _add_priors(normal: Normal, problem: BundleProblem, state: BundleState) -> None:
    n = len(problem.views)
    own, g = normal.blocks[:n], normal.g
    turn, known = _turn_terms(problem, state)
    for axis in range(3):
        own[:, 3 + axis, 3 + axis] += known[:, axis]
    g[:, 3:] += known * turn
    height, sigma = _heights(problem)
    told = np.isfinite(sigma)
    own[told, 2, 2] += sigma[told] ** -2.0
    g[told, 2] += (state.centre[told, 2] + height[told]) * sigma[told] ** -2.0
    normal.add_fixes(problem.fix_noise, state.centre[problem.fix_of, :2] - problem.fix_xy)
    for k in problem.held.tolist():
        start = problem.views[k]
        firm = (HELD_SIGMA * max(abs(float(start.centre[2])), 1e-6)) ** -2
        for axis in range(3):
            own[k, axis, axis] += firm
            g[k, axis] += firm * (state.centre[k, axis] - start.centre[axis])
        heading = log_rotation((state.R[k] @ start.R_map_camera.T)[None])[0, 2]
        own[k, 5, 5] += HELD_SIGMA**-2
        g[k, 5] += HELD_SIGMA**-2 * heading
    for k, lens in enumerate(problem.lenses):
        misses = (state.log_focal[k] - np.log(lens.focal_px), state.k1[k] - lens.camera.k1)
        for part, (sigma_of, miss) in enumerate(zip((lens.focal_sigma_log, lens.k1_sigma), misses, strict=True)):
            normal.border[2 * k + part, 2 * k + part] += sigma_of**-2
            normal.g_border[2 * k + part] += miss * sigma_of**-2


def _heights(problem: BundleProblem) -> tuple[FloatArray, FloatArray]:
    """Return the reported heights ``(N,)`` and their sigmas, ``nan`` where none was."""
    return np.array([v.height for v in problem.views]), np.array([v.height_sigma for v in problem.views])


def _turn_terms(problem: BundleProblem, state: BundleState) -> tuple[FloatArray, FloatArray]:
    """Return each view's turn from what was reported ``(N, 3)`` and that report's information along each axis."""
    turn = log_rotation(state.R @ np.array([v.R_prior for v in problem.views]).transpose(0, 2, 1))
    sigma = np.array([(v.tilt_sigma_rad, v.tilt_sigma_rad, v.heading_sigma_rad) for v in problem.views])
    return turn, sigma**-2.0


def runs_of(*keys: IntArray) -> list[tuple[int, int]]:
    """Return where each run of equal keys begins and ends."""
    changes = np.flatnonzero(np.any([np.diff(k) != 0 for k in keys], axis=0)) + 1
    bounds = [0, *changes.tolist(), len(keys[0])]
    return [(i, j) for i, j in pairwise(bounds) if j > i]
