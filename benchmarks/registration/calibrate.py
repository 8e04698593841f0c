"""Fit what the registration believes of itself: ``python -m benchmarks.registration.calibrate [--pairs N] [--fit]``.

Pairs of the *tuning* pictures of every class, wrong ones and repeating ground. Printed are the weights of the
probability (``photomap_gis/ifmi/validity.py``), by logistic regression, and how far the weights of the covariance
(``photomap_gis/ifmi/uncertainty.py``) hold, class by class: NEES per degree of freedom and the share held by the 95 %
region. ``--fit`` looks for better ones, which takes minutes more. Nothing is written: the numbers are looked at, and
then copied.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import astuple, dataclass

import numpy as np
from scipy.optimize import minimize

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.decide import Finding, decide
from photomap_gis.ifmi.search import search
from photomap_gis.ifmi.spectrum import make_spectrum
from photomap_gis.ifmi.uncertainty import WEIGHTS as WEIGHTS_OF_COVARIANCE
from photomap_gis.ifmi.uncertainty import Spread, Weights
from photomap_gis.ifmi.validity import ACCEPT, WEIGHTS, probability_of

from .pairs import CLASSES, Pair, pairs
from .score import SUCCESS_SHARE, error_of, mahalanobis2, xi_of

NEAR_MISS = 3.0
"""An error below so many times the limit says little of what a wrong registration looks like."""
RIDGE, WRONG_WEIGHT, NEAR_MISS_WEIGHT = 1.0, 2.0, 0.2
FIT_STEPS = 1500
HELD_WITHIN, LOG_NEES_WITHIN = (0.936, 0.965), (float(np.log(0.78)), float(np.log(1.3)))
"""What the fit asks of every class: a little more than the bars, since the pictures that report are others."""
MOST_NEES, TAIL_DOF, LIKELIHOOD_COUNTS = 80.0, 6.0, 0.1
CHI2_95_4DOF, CHI2_95_2DOF = 9.488, 5.991
NOT_FITTED = ("repetitive", "wrong", "moving-objects", "corrupt-rows")
"""Of these the covariance may be wide: what moved or broke is not told from what stands high."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A pair's finding, and whether it is right."""

    pair: Pair
    finding: Finding
    error: float

    @property
    def right(self) -> bool:
        """By the success rule."""
        return self.error < SUCCESS_SHARE


def samples(cls: str, count: int, seed: int) -> list[Sample]:
    """Return what is found on pairs of the tuning pictures, without a prior; pairs without any lead are left out."""
    found = []
    for pair in pairs(cls, count, seed, "tuning"):
        a, b = make_spectrum(pair.a), make_spectrum(pair.b)
        finding = decide(a, b, search(a, b), None)
        if finding is not None and finding.evidence.tiles:
            error = np.inf if pair.T_a_b is None else error_of(finding.measured.T_a_b, pair).rms_px / pair.size_px[0]
            found.append(Sample(pair, finding, float(error)))
    return found


def logistic(X: FloatArray, y: FloatArray, weight: FloatArray, rounds: int = 60) -> FloatArray:
    """Return the ``(n,)`` weights of a ridge logistic regression of ``(N, n)`` features; the first is the constant."""
    ridge = np.full(X.shape[1], RIDGE)
    ridge[0] = 1e-6
    beta = np.zeros(X.shape[1])
    for _ in range(rounds):
        p = 1.0 / (1.0 + np.exp(-X @ beta))
        gradient = X.T @ (weight * (p - y)) + ridge * beta
        beta = beta - np.linalg.solve((X.T * (weight * p * (1.0 - p))) @ X + np.diag(ridge), gradient)
    return np.asarray(beta, np.float64)


Error = tuple[Spread, FloatArray]
"""What a registration says of its spread, and its true error xi."""


def errors(found: dict[str, list[Sample]]) -> list[list[Error]]:
    """Return the errors, class by class, of what is right."""
    return [
        [(m.spread, xi_of(m.T_a_b, s.pair)) for s in group if s.right and (m := s.finding.measured).spread is not None]
        for cls, group in found.items()
        if cls not in NOT_FITTED
    ]


def fit_weights(classes: list[list[Error]]) -> Weights:
    """Return the covariance's weights that hold the truth of every class as often as they should, and no wider.

    Classes cost by how far they lie outside of what is asked of them; among weights that satisfy all, those of the
    highest likelihood (Student's, or a few bad pairs would decide) win.
    """

    def loss(logs: FloatArray) -> float:
        weights = Weights(*np.exp(logs).tolist())
        total, unlikely, count = 0.0, 0.0, 0
        for group in classes:
            P = np.stack([spread.covariance(weights) for spread, _ in group])
            xi = np.stack([xi for _, xi in group])
            nees = np.einsum("ni,ni->n", xi, np.linalg.solve(P, xi[:, :, None])[:, :, 0])
            xy = np.einsum("ni,ni->n", xi[:, :2], np.linalg.solve(P[:, :2, :2], xi[:, :2, None])[:, :, 0])
            for values, limit in ((nees, CHI2_95_4DOF), (xy, CHI2_95_2DOF)):
                total += (_outside(_softly_below(values, limit), HELD_WITHIN) / 0.01) ** 2
            log_nees = float(np.log(np.minimum(nees, MOST_NEES).mean() / 4.0))
            total += (_outside(log_nees, LOG_NEES_WITHIN) / 0.1) ** 2
            unlikely += float(np.sum(0.5 * np.linalg.slogdet(P)[1] + 5.0 * np.log1p(nees / TAIL_DOF)))
            count += len(group)
        return total / len(classes) + LIKELIHOOD_COUNTS * unlikely / count

    start = np.log(np.array(astuple(WEIGHTS_OF_COVARIANCE)))
    best = minimize(loss, start, method="Nelder-Mead", options={"maxfev": FIT_STEPS, "adaptive": True})
    return Weights(*(float(f"{v:.3g}") for v in np.exp(best.x)))


def _softly_below(values: FloatArray, limit: float) -> float:
    """Return the share of values below a limit, half of it smooth in the values."""
    smooth = np.mean(1.0 / (1.0 + np.exp(np.clip(8.0 * (values / limit - 1.0), -50.0, 50.0))))
    return 0.5 * float(smooth) + 0.5 * float(np.mean(values < limit))


def _outside(value: float, within: tuple[float, float]) -> float:
    """Return how far a value lies outside of an interval."""
    return max(within[0] - value, value - within[1], 0.0)


def main(arguments: list[str] | None = None) -> int:
    """Print the fitted weights beside those in use, and the covariance's standing."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration.calibrate", description=__doc__)
    parser.add_argument("--pairs", type=int, default=150, help="pairs a class; 10 times of repeats, 20 of wrong ones")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fit", action="store_true", help="look for better weights of the covariance too")
    chosen = parser.parse_args(arguments)
    found: dict[str, list[Sample]] = {}
    for cls in CLASSES:
        times = {"repetitive": 10, "wrong": 20}.get(cls, 1)
        found[cls] = samples(cls, chosen.pairs * times, chosen.seed)
        print(f"{cls}: {len(found[cls])}", file=sys.stderr)
    every = [s for group in found.values() for s in group]
    X = np.array([list(s.finding.evidence.features().values()) for s in every])
    y = np.array([float(s.right) for s in every])
    near = np.array([not s.right and s.error < NEAR_MISS * SUCCESS_SHARE for s in every])
    beta = logistic(X, y, np.where(near, NEAR_MISS_WEIGHT, np.where(y > 0, 1.0, WRONG_WEIGHT)))
    print("probability: fitted (in use)")
    for name, value in zip(WEIGHTS, beta, strict=True):
        print(f"  {name}: {value:.2f} ({WEIGHTS[name]:.2f})")
    accepted = np.array([probability_of(s.finding.evidence) >= ACCEPT for s in every])
    print(f"in use: recall {accepted[y > 0].mean():.4f}, wrong accepted {int((accepted & (y == 0)).sum())}")
    print("covariance: class, NEES/dof, share held by the 95 % region")
    for cls, group in found.items():
        right = [s for s in group if s.right]
        if right:
            nees = np.array([_nees(s) for s in right])
            print(f"  {cls}: {nees.mean() / 4.0:.2f} {np.mean(nees < CHI2_95_4DOF):.3f} (n {len(nees)})")
    if chosen.fit:
        print(f"covariance: fitted {fit_weights(errors(found))}\n            in use {WEIGHTS_OF_COVARIANCE}")
    return 0


def _nees(s: Sample) -> float:
    measured = s.finding.measured
    return mahalanobis2(xi_of(measured.T_a_b, s.pair), measured.covariance)


if __name__ == "__main__":
    sys.exit(main())
