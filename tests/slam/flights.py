"""Synthetic flights with known truth: poses, edges with honest noise, GPS with drift, blunders and dropouts."""

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.posegraph import (
    Edge,
    EdgeKind,
    HeadingObservation,
    PoseGraph,
    PositionObservation,
    ScaleObservation,
)
from photomap_gis.core.similarity import Similarity2D

SIGMA_EDGE = np.array([0.3, 0.3, 4e-4, 4e-4])
WIDTH, HEIGHT = 512, 384


@dataclass(frozen=True)
class Flight:
    poses: list[Similarity2D]
    times_s: np.ndarray

    @property
    def centres_m(self) -> np.ndarray:
        return np.array([p.translation for p in self.poses])


def lawnmower(
    rng, strips=8, per_strip=10, *, gsd=0.1, forward=0.7, side=0.6, dt_s=2.0, jitter_rad=0.03, crab=True
) -> Flight:
    """Strips flown up and down, the image's top to the nose (or fixed), heights and headings that wander."""
    step_y, step_x = (1 - forward) * HEIGHT * gsd, (1 - side) * WIDTH * gsd
    poses = []
    for s in range(strips):
        rows = range(per_strip) if s % 2 == 0 else range(per_strip - 1, -1, -1)
        for r in rows:
            heading = (0.0 if s % 2 == 0 or not crab else np.pi) + rng.normal(0, jitter_rad)
            x = s * step_x + rng.normal(0, 0.02 * step_x)
            y = -r * step_y + rng.normal(0, 0.02 * step_y)
            poses.append(Similarity2D(x, y, heading, np.log(gsd) + rng.normal(0, 0.02)))
    return Flight(poses, dt_s * np.arange(len(poses)))


def gauss_markov(rng, times_s, sigma_m=2.0, tau_s=60.0):
    out = np.empty((len(times_s), 2))
    out[0] = rng.normal(0, sigma_m, 2)
    for k in range(1, len(times_s)):
        phi = np.exp(-(times_s[k] - times_s[k - 1]) / tau_s)
        out[k] = phi * out[k - 1] + rng.normal(0, sigma_m * np.sqrt(1 - phi**2), 2)
    return out


def fixes(
    rng, flight: Flight, *, drift_m=2.0, white_m=0.5, bias_m=1.0, blunders=0.0, dropouts=0.0, number=0, first=0
) -> list[PositionObservation]:
    error = gauss_markov(rng, flight.times_s, drift_m) + rng.normal(0, white_m, (len(flight.poses), 2))
    error += rng.normal(0, bias_m, 2)
    bad = rng.random(len(error)) < blunders
    error[bad] += rng.normal(0, 60.0, (bad.sum(), 2))
    out = []
    for k, centre in enumerate(flight.centres_m):
        if rng.random() < dropouts:
            continue
        out.append(
            PositionObservation(
                first + k, centre + error[k], np.eye(2) * (2.0**2 + 0.5**2), number,
                float(flight.times_s[k]), 2.0, 60.0, 1.0,
            )
        )  # fmt: skip
    return out


def edge(
    rng, flight: Flight, a: int, b: int, kind=EdgeKind.LOOP, *, noise=1.0, claimed=1.0, false=False, first=0
) -> Edge:
    truth = flight.poses[a].inverse() @ flight.poses[b]
    xi = rng.normal(size=4) * SIGMA_EDGE * noise
    if false:
        truth = truth @ Similarity2D(*rng.normal(0, 60.0, 2), rng.normal(0, 0.3), rng.normal(0, 0.1))
    return Edge(first + a, first + b, truth @ Similarity2D.exp(xi), np.diag((SIGMA_EDGE * noise * claimed) ** 2), kind)


def pairs_by_distance(flight: Flight, reach_m: float, limit: int | None = None):
    c = flight.centres_m
    d = np.hypot(*(c[:, None] - c[None]).transpose(2, 0, 1))
    i, j = np.nonzero(np.triu(d < reach_m, 2))
    order = np.argsort(d[i, j], kind="stable")[:limit]
    return list(zip(i[order].tolist(), j[order].tolist(), strict=True))


def edges(rng, flight: Flight, *, reach_m=26.0, limit=None, false=0.0, noise=1.0, claimed=1.0, first=0) -> list[Edge]:
    out = [
        edge(rng, flight, k, k + 1, EdgeKind.SEQUENTIAL, noise=noise, claimed=claimed, first=first)
        for k in range(len(flight.poses) - 1)
    ]
    for a, b in pairs_by_distance(flight, reach_m, limit):
        out.append(edge(rng, flight, a, b, noise=noise, claimed=claimed, false=bool(rng.random() < false), first=first))
    return out


def graph(flight: Flight, all_edges, positions=(), scales=(), headings=()) -> PoseGraph:
    return PoseGraph(
        tuple(range(len(flight.poses))), tuple(all_edges), tuple(positions), tuple(scales), tuple(headings), 1
    )


def heights(rng, flight: Flight, sigma=0.1):
    common = np.exp(rng.normal(0, sigma))
    return [ScaleObservation(k, p.scale * common, sigma) for k, p in enumerate(flight.poses)]


def yaws(rng, flight: Flight, sigma=0.087, flip=False):
    common = rng.normal(0, sigma) + (np.pi if flip else 0.0)
    return [HeadingObservation(k, p.angle_rad + common, sigma) for k, p in enumerate(flight.poses)]


def centres(solution, frames) -> np.ndarray:
    by_frame = {p.frame: p.T_map_plane.translation for p in solution.poses}
    return np.array([by_frame[f] for f in frames])


def rmse(a, b) -> float:
    return float(np.sqrt(np.mean(np.sum((np.asarray(a) - b) ** 2, axis=1))))
