"""How each component of frames is laid on the Earth: by its fixes, else by heights, headings and its neighbours.

A component whose fixes span a good baseline is aligned to them, whatever blunders are among them. A short one (a
single photo at worst) has no angle and scale of its own from fixes: it takes the scale from reported heights or from
the flight's other frames, the heading from reported headings, else from the course over ground as the other frames
relate to it, else from the frame next to it. What is borrowed so is told to the solver with a wide sigma.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.components import IntArray
from photomap_gis.slam.initial import RelativePoses
from photomap_gis.slam.problem import ComplexArray, PositionTerms, ScalarTerms
from photomap_gis.slam.robust import redescending

ALIGNED_SIGMA_RAD = 0.15
"""A component is aligned by its fixes where they give its angle (and log scale) at least this well."""
BORROWED_SCALE_SIGMA = 0.2
BORROWED_HEADING_SIGMA_RAD = 0.35
MIN_COURSE_BASELINE_M = 6.0
SAMPLES = 400
VOTERS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Anchored:
    """Poses ``w``, ``t`` ``(N,)`` on the map (NaN where nothing tells the scale), and the borrowed observations.

    ``heading_flip`` is whether reported headings point to the image's lower edge: the flight's fixes and
    registrations say the opposite (some gimbals report a yaw that is off by 180 degrees).
    """

    w: ComplexArray
    t: ComplexArray
    scales: ScalarTerms
    headings: ScalarTerms
    heading_flip: bool


def anchor(
    relative: RelativePoses,
    positions: PositionTerms,
    scales: ScalarTerms,
    headings: ScalarTerms,
    by_points: Mapping[int, Fit],
) -> Anchored:
    """Return all components laid on the map; those without any fix keep NaN.

    ``by_points`` tells how components (by label) lie by known points of the ground: it holds where fixes do not align.
    """
    n = len(relative.w)
    w, t = np.full(n, complex(np.nan, np.nan)), np.full(n, complex(np.nan, np.nan))
    fixes_of = _group(relative.labels[positions.node])
    nodes_of = _group(relative.labels)
    short: list[int] = []
    for label in sorted(fixes_of.keys() | by_points.keys()):
        fixes = fixes_of.get(label, np.zeros(0, np.intp))
        fit = align(relative.t[positions.node[fixes]], positions.z_m[fixes], positions.sigma_m[fixes])
        fit = fit or by_points.get(label)
        if fit is None:
            short.append(label)
            continue
        nodes = nodes_of[label]
        w[nodes] = relative.w[nodes] + np.log(fit.z)
        t[nodes] = fit.z * relative.t[nodes] + fit.t
    flip = _headings_flipped(w, headings)
    headings_used = ScalarTerms(headings.node, headings.value + (np.pi if flip else 0.0), headings.sigma)
    borrowed_scales: list[tuple[int, float, float]] = []
    borrowed_headings: list[tuple[int, float, float]] = []
    neighbours = _Neighbours(w, t, positions)
    for label in short:
        nodes, fixes = nodes_of[label], fixes_of[label]
        log_scale, scale_sigma = _scale(relative.w, nodes, scales, neighbours)
        if log_scale is None:
            log_scale, scale_sigma = _scale_from_fixes(relative.t, positions, fixes), 0.7
        if log_scale is None:
            continue
        angle, angle_sigma = _heading(relative.w, nodes, headings_used, neighbours)
        z = np.exp(complex(log_scale, angle))
        w[nodes] = relative.w[nodes] + complex(log_scale, angle)
        off = positions.z_m[fixes] - z * relative.t[positions.node[fixes]]
        t[nodes] = z * relative.t[nodes] + complex(np.median(off.real), np.median(off.imag))
        first = int(nodes[0])
        borrowed_scales.append((first, float(w[first].real), scale_sigma))
        borrowed_headings.append((first, float(w[first].imag), angle_sigma))
    angles = np.remainder(w.imag + np.pi, 2 * np.pi) - np.pi
    return Anchored(w.real + 1j * angles, t, _terms(borrowed_scales), _terms(borrowed_headings), flip)


@dataclass(frozen=True, slots=True)
class Fit:
    """``z p + t``: a component laid on its fixes; ``spread`` by what they miss it beyond their sigmas (at least 1)."""

    z: complex
    t: complex
    sigma_rad: float = 0.0
    spread: float = 1.0


def align(points: ComplexArray, fixes_m: ComplexArray, sigma_m: FloatArray, *, samples: int = SAMPLES) -> Fit | None:
    """Fit ``z p + t`` to fixes robustly (least median of squares, then re-weighted); ``None`` for a short baseline."""
    n = len(points)
    if n < 2:
        return None
    pairs = far_pairs(points, samples)
    if not len(pairs):
        return None
    i, j = pairs[:, 0], pairs[:, 1]
    z = (fixes_m[j] - fixes_m[i]) / (points[j] - points[i])
    t = (fixes_m[i] + fixes_m[j] - z * (points[i] + points[j])) / 2.0
    # all pairs against a thinned set of points at once: thousands of fixes need no more than some hundred to vote
    voters = np.linspace(0, n - 1, min(n, VOTERS)).astype(np.intp)
    score = _medians(np.abs(z[:, None] * points[voters] + t[:, None] - fixes_m[voters]))
    score[z == 0] = np.inf
    best = int(np.argmin(score))
    if not np.isfinite(score[best]):
        return None
    fit = Fit(complex(z[best]), complex(t[best]))
    for _ in range(10):
        r = np.abs(fit.z * points + fit.t - fixes_m)
        scale = max(1.0, float(_medians(r / sigma_m)) / 1.1774)
        weights = redescending((r / (sigma_m * scale)) ** 2, 3.0) / sigma_m**2
        mean_p, mean_f = (weights @ points) / weights.sum(), (weights @ fixes_m) / weights.sum()
        spread = float(weights @ np.abs(points - mean_p) ** 2)
        cross = complex(np.sum(weights * (fixes_m - mean_f) * np.conj(points - mean_p)))
        if spread <= 0.0 or cross == 0:
            return None
        refined = Fit(cross / spread, complex(mean_f - cross / spread * mean_p))
        done = abs(refined.z - fit.z) < 1e-9 * abs(fit.z)
        fit = refined
        if done:
            break
    # neighbours share their error: take every fourth fix for a sample
    effective = np.sqrt(np.sum(weights * np.abs(points - mean_p) ** 2) * abs(fit.z) ** 2 * max(0.25, 2.0 / n))
    sigma_rad = scale / float(effective)
    return replace(fit, sigma_rad=sigma_rad, spread=scale) if sigma_rad < ALIGNED_SIGMA_RAD else None


def _medians(values: FloatArray) -> FloatArray:
    """Return the medians of ``(..., n)`` finite values: thousands of short rows, for which NumPy's takes its time."""
    n = values.shape[-1]
    middle = np.partition(values, ((n - 1) // 2, n // 2), axis=-1)
    return 0.5 * (middle[..., (n - 1) // 2] + middle[..., n // 2])


def far_pairs(points: ComplexArray, samples: int) -> IntArray:
    """``(m, 2)`` pairs of points far apart, at most ``samples``, the same in every run."""
    n = len(points)
    if n * (n - 1) // 2 <= samples:
        i, j = np.triu_indices(n, 1)
    else:
        rng = np.random.default_rng(n)
        i = rng.integers(0, n, 6 * samples)
        j = (i + rng.integers(1, n, 6 * samples)) % n
    distance = np.abs(points[i] - points[j])
    keep = np.argsort(-distance, kind="stable")[:samples]
    keep = keep[distance[keep] > 0.0]
    return np.stack([i[keep], j[keep]], axis=1).astype(np.intp)


def _headings_flipped(w: ComplexArray, headings: ScalarTerms) -> bool:
    """Whether most reported headings of aligned frames point backwards."""
    off = headings.value - w.imag[headings.node]
    off = off[np.isfinite(off)]
    return len(off) >= 5 and float(np.median(np.cos(off))) < -0.7


def _scale(
    relative_w: ComplexArray, nodes: IntArray, scales: ScalarTerms, neighbours: _Neighbours
) -> tuple[float | None, float]:
    """Log scale of a component, and its sigma, from its heights, else from the aligned frames around it."""
    own = np.isin(scales.node, nodes)
    if own.any():
        values = scales.value[own] - relative_w.real[scales.node[own]]
        return float(np.median(values)), float(np.median(scales.sigma[own]))
    near = neighbours.log_scale(int(nodes[0]))
    if near is None:
        return None, BORROWED_SCALE_SIGMA
    return near - float(np.median(relative_w.real[nodes])), BORROWED_SCALE_SIGMA


def _scale_from_fixes(relative_t: ComplexArray, positions: PositionTerms, fixes: IntArray) -> float | None:
    """Log scale of two or more fixes too close to be sure of: better than nothing."""
    p, z = relative_t[positions.node[fixes]], positions.z_m[fixes]
    spread_p, spread_z = float(np.std(p)), float(np.std(z))
    return float(np.log(spread_z / spread_p)) if spread_p > 0 and spread_z > 0 else None


def _heading(
    relative_w: ComplexArray, nodes: IntArray, headings: ScalarTerms, neighbours: _Neighbours
) -> tuple[float, float]:
    """Angle of a component, and its sigma, from its headings, else course over ground, else the frame next to it."""
    own = np.isin(headings.node, nodes)
    if own.any():
        turns = np.exp(1j * (headings.value[own] - relative_w.imag[headings.node[own]]))
        return float(np.angle(turns.sum())), float(np.median(headings.sigma[own]))
    guesses = [(node, neighbours.heading(int(node))) for node in nodes]
    turns = np.array([np.exp(1j * (g - relative_w.imag[node])) for node, g in guesses if g is not None], complex)
    if not len(turns):
        return 0.0, np.pi
    return float(np.angle(turns.sum())), BORROWED_HEADING_SIGMA_RAD


class _Neighbours:
    """What the aligned frames tell of the others: scale, and heading by course or by nearness in the flight."""

    def __init__(self, w: ComplexArray, t: ComplexArray, positions: PositionTerms) -> None:
        self._nodes = np.flatnonzero(np.isfinite(w))
        self._w = w
        self._course = _courses(len(w), positions)
        self._flight = np.full(len(w), -1, np.intp)
        self._flight[positions.node] = positions.flight
        known = self._nodes[np.isfinite(self._course[self._nodes])]
        turns = np.exp(1j * (w.imag[known] - self._course[known]))
        mean = complex(turns.mean()) if len(turns) else 1.0 + 0j
        self._offset = float(np.angle(mean))
        # heading follows the course (aircraft), or it does not (a drone that flies sideways): let the frames say
        self._follows = abs(mean) > 0.7 if len(turns) >= 3 else True

    def _near(self, node: int) -> IntArray:
        same = self._nodes[self._flight[self._nodes] == self._flight[node]]
        pool = same if len(same) else self._nodes
        return pool[np.argsort(np.abs(pool - node), kind="stable")[:9]]

    def log_scale(self, node: int) -> float | None:
        """Median log scale of the aligned frames nearest in order."""
        near = self._near(node)
        return float(np.median(self._w.real[near])) if len(near) else None

    def heading(self, node: int) -> float | None:
        """Heading by the course over ground, or that of the aligned frame nearest in order."""
        course = float(self._course[node])
        if self._follows and np.isfinite(course):
            return course + self._offset
        near = self._near(node)
        if len(near):
            return float(self._w.imag[near[0]])
        return course if np.isfinite(course) else None


def _courses(n: int, positions: PositionTerms) -> FloatArray:
    """``(n,)`` course over ground (clockwise from north) at each node with a fix; NaN where it hardly moves."""
    out = np.full(n, np.nan)
    for flight in np.unique(positions.flight):
        rows = np.flatnonzero(positions.flight == flight)
        rows = rows[np.argsort(positions.node[rows], kind="stable")]
        z = positions.z_m[rows]
        for k in range(len(rows)):
            for reach in range(1, 6):
                step = z[min(k + reach, len(rows) - 1)] - z[max(k - reach, 0)]
                if abs(step) >= MIN_COURSE_BASELINE_M:
                    out[positions.node[rows[k]]] = np.arctan2(step.real, -step.imag)
                    break
    return out


def _group(labels: IntArray) -> dict[int, npt.NDArray[np.intp]]:
    """Indices by label."""
    if not len(labels):
        return {}
    order = np.argsort(labels, kind="stable")
    values, starts = np.unique(labels[order], return_index=True)
    return {int(v): part for v, part in zip(values, np.split(order, starts[1:]), strict=True)}


def _terms(rows: list[tuple[int, float, float]]) -> ScalarTerms:
    """Rows of node, value, sigma as terms."""
    return ScalarTerms.of([r[0] for r in rows], [r[1] for r in rows], [r[2] for r in rows])
