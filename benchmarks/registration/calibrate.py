"""Fit what the registration believes of itself: ``python -m benchmarks.registration.calibrate [--pairs N]``.

Pairs of the *tuning* pictures of every class, wrong ones and repeating ground. Printed are the weights of the
probability (``photomap_gis/ifmi/validity.py``), by logistic regression, and how far the weights of the covariance
(``photomap_gis/ifmi/uncertainty.py``) hold, class by class: NEES per degree of freedom and the share held by the 95 %
region. Nothing is written: the numbers are looked at, and then copied.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.decide import Finding, decide
from photomap_gis.ifmi.search import search
from photomap_gis.ifmi.spectrum import make_spectrum
from photomap_gis.ifmi.validity import ACCEPT, WEIGHTS, probability_of

from .pairs import CLASSES, Pair, pairs
from .score import SUCCESS_SHARE, error_of, mahalanobis2, xi_of

NEAR_MISS = 3.0
"""An error below so many times the limit says little of what a wrong registration looks like."""
RIDGE, WRONG_WEIGHT, NEAR_MISS_WEIGHT = 1.0, 2.0, 0.2
CHI2_95_4DOF = 9.488


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


def main(arguments: list[str] | None = None) -> int:
    """Print the fitted weights beside those in use, and the covariance's standing."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration.calibrate", description=__doc__)
    parser.add_argument("--pairs", type=int, default=150, help="pairs a class; 10 times of repeats, 20 of wrong ones")
    parser.add_argument("--seed", type=int, default=1)
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
    return 0


def _nees(s: Sample) -> float:
    measured = s.finding.measured
    return mahalanobis2(xi_of(measured.T_a_b, s.pair), measured.covariance)


if __name__ == "__main__":
    sys.exit(main())
