"""What is compared with the truth, and how."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.posegraph import PoseGraph, Solution
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

from ..registration.score import Interval, bootstrap
from .world import Flown


@dataclass(frozen=True, slots=True)
class Options:
    """What a run is to do: ``seeds`` flights where figures are pooled."""

    seeds: int = 30
    seed: int = 0
    quick: bool = False
    on_progress: Callable[[int, int], None] = lambda done, total: None

    def rng(self, *what: int) -> np.random.Generator:
        """Return the random numbers of one flight of one section: the same whatever else is run."""
        return np.random.default_rng((self.seed, *what))


def rms(d: FloatArray) -> float:
    """Root mean square length of ``(N, 2)`` vectors."""
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def centres(solution: Solution) -> FloatArray:
    """``(N, 2)`` solved places of all frames, in their order."""
    return np.array([p.T_map_plane.translation for p in sorted(solution.poses, key=lambda p: p.frame)])


def relative_rmse_m(flown: Flown, solution: Solution) -> float:
    """RMSE of the image centres after the best similarity; infinite where frames are missing."""
    if len(solution.poses) != len(flown.poses):
        return float("inf")
    found = centres(solution)
    return rms(fit_similarity(flown.centres_m, found).apply(found) - flown.centres_m)


def absolute_errors_m(flown: Flown, solution: Solution) -> FloatArray:
    """``(N, 2)`` solved minus true places."""
    return centres(solution) - flown.centres_m


def absolute_nees(flown: Flown, solution: Solution) -> float:
    """Mean squared error of the places in the claimed sigmas, per degree of freedom."""
    poses = sorted(solution.poses, key=lambda p: p.frame)
    linear = np.array([p.T_map_plane.linear for p in poses])
    claimed = linear @ np.array([p.covariance[:2, :2] for p in poses]) @ linear.transpose(0, 2, 1)
    e = absolute_errors_m(flown, solution)
    return float(np.mean(np.einsum("ni,ni->n", e, np.linalg.solve(claimed, e[:, :, None])[:, :, 0])) / 2.0)


def relative_nees(flown: Flown, solution: Solution) -> float:
    """The same of all four degrees of freedom, of a solution without fixes: seen from its first frame."""
    poses = sorted(solution.poses, key=lambda p: p.frame)[1:]
    first = flown.poses[0].inverse()
    xi = np.array([(p.T_map_plane.inverse() @ first @ flown.poses[p.frame]).log() for p in poses])
    claimed = np.array([p.covariance for p in poses])
    return float(np.mean(np.einsum("ni,ni->n", xi, np.linalg.solve(claimed, xi[:, :, None])[:, :, 0])) / 4.0)


def fixes_m(graph: PoseGraph) -> tuple[list[int], FloatArray]:
    """Return the frames that have a fix, and ``(n, 2)`` where it says they are."""
    return [p.frame for p in graph.positions], np.array([p.xy_map_m for p in graph.positions])


def pooled_ratio(over: Sequence[float], under: Sequence[float], rng: np.random.Generator) -> Interval:
    """Return the ratio of two RMSE pooled over flights, its interval by resampling whole flights."""
    a, b = np.square(over), np.square(under)

    def ratio(rows: FloatArray) -> float:
        k = rows.astype(np.intp)
        return float(np.sqrt(a[k].mean() / b[k].mean()))

    return bootstrap(np.arange(len(a)), ratio, rng)


def closest_similarity(flown: Flown, graph: PoseGraph) -> Similarity2D:
    """Return how a perfect relative map is laid on the graph's fixes by plain least squares."""
    frames, fixes = fixes_m(graph)
    return fit_similarity(fixes, flown.centres_m[frames])
