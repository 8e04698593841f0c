"""Section ``covariance``: does the claimed uncertainty hold the truth, in every class of tilt, relief and overlap."""

from __future__ import annotations

import numpy as np

from .report import Bar, Figure, Section, Table, number
from .running import Job, Options, Outcome, only, run, together
from .score import Calibration, calibration

CLASSES = (
    "tilt-0", "nominal", "tilt-5", "tilt-10", "tilt-15", "relief-5", "relief-10", "translation-10", "translation-20",
    "translation-30", "translation-40", "translation-50", "translation-60",
)  # fmt: skip
FURTHER = ("noise-10", "noise-20", "blur", "jpeg-10", "low-contrast", "low-texture", "scale-1.6", "rotation")
"""Reported without a bar, which is asked per tilt, relief and overlap."""
HELD, NEES = Bar(0.92, 0.98), Bar(0.7, 1.5)


def measure(options: Options) -> Section:
    """Return the section: covariances of what was accepted, the paper's beside them, and the model sigma."""
    count = max(10, options.count // 2)
    jobs = [job for c in CLASSES for job in together(c, {"ifmi": count, "paper": max(10, count // 3)})]
    jobs += [Job(c, ("ifmi",), max(10, count // 2)) for c in FURTHER]
    # what the fallback gave: it only steps in where iFMI abstains
    jobs += [Job(c, ("ifmi+features",), count) for c in ("translation-60", "motion-blur", "low-contrast", "jpeg-10")]
    return section_of(run(jobs, options), options)


def section_of(outcomes: list[Outcome], options: Options) -> Section:
    """Return the section of outcomes that are already there."""
    rng = np.random.default_rng(options.seed)
    figures, rows = [], []
    for c in (*CLASSES, *FURTHER):
        found = [o for o in only(outcomes, method="ifmi", cls=c) if o.accepted]
        if len(found) < 2:
            continue
        judged = _calibration(found, rng)
        held, nees = (HELD, NEES) if c in CLASSES else (None, None)
        figures += [
            Figure(f"{c}: held, 4 DoF", judged.held_4dof, judged.count, "%", held),
            Figure(f"{c}: held, x-y", judged.held_xy, judged.count, "%", held),
            Figure(f"{c}: NEES/dof", judged.nees_per_dof, judged.count, "", nees),
        ]
        rows.append(_row(c, found, judged))
    by_features = [o for o in only(outcomes, method="ifmi+features") if o.accepted and o.by == "features"]
    if len(by_features) >= 20:
        judged = _calibration(by_features, rng)
        figures += [
            Figure("by features: held, 4 DoF", judged.held_4dof, judged.count, "%"),
            Figure("by features: held, x-y", judged.held_xy, judged.count, "%"),
            Figure("by features: NEES/dof", judged.nees_per_dof, judged.count, ""),
        ]
    head = ("class", "n", "held 4 DoF %", "held x-y %", "NEES/dof", "median", "sigma x-y px", "true x-y px",
            "model sigma px", "true", "ratio, median", "p10", "p90")  # fmt: skip
    tables = [Table("Of what was accepted; model sigma against the true residual per axis", head, tuple(rows))]
    literal = [_literal_row(c, only(outcomes, method="paper", cls=c)) for c in CLASSES]
    tables.append(
        Table(
            "Algorithm 3 to the letter (N = 2), of what is right",
            ("class", "n", "not positive definite %", "held x-y %", "NEES/dof x-y, median", "sigma x-y px", "true px"),
            tuple(row for row in literal if row),
        )
    )
    return Section("covariance", tuple(figures), tuple(tables))


def _calibration(found: list[Outcome], rng: np.random.Generator) -> Calibration:
    return calibration(np.array([o.xi for o in found]), np.array([o.covariance for o in found]), rng)


def _row(cls: str, found: list[Outcome], judged: Calibration) -> tuple[str, ...]:
    sigma = [np.sqrt(np.trace(o.covariance[:2, :2]) / 2.0) for o in found if o.covariance is not None]
    true = [np.hypot(*o.xi[:2]) / np.sqrt(2.0) for o in found]
    ratio = [o.model_sigma_px / o.model_px for o in found if o.model_px > 1e-6]
    spread = [number(float(np.quantile(ratio, q)), "px") if ratio else "-" for q in (0.5, 0.1, 0.9)]
    return (
        cls, str(len(found)), number(judged.held_4dof.value, "%"), number(judged.held_xy.value, "%"),
        number(judged.nees_per_dof.value, ""), number(judged.nees_median, ""),
        number(float(np.median(sigma)), "px"), number(float(np.median(true)), "px"),
        number(float(np.median([o.model_sigma_px for o in found])), "px"),
        number(float(np.median([o.model_px for o in found])), "px"), *spread,
    )  # fmt: skip


def _literal_row(cls: str, outcomes: list[Outcome]) -> tuple[str, ...]:
    right = [o for o in outcomes if o.right and o.covariance is not None]
    if not right:
        return ()
    xy = np.array([o.covariance[:2, :2] for o in right if o.covariance is not None])
    definite = np.linalg.eigvalsh(xy)[:, 0] > 0.0
    d = np.array([o.xi[:2] for o in right])
    d2 = np.array([v @ np.linalg.solve(c, v) for v, c in zip(d[definite], xy[definite], strict=True)])
    sigma = np.sqrt(np.maximum(np.trace(xy[definite], axis1=1, axis2=2), 0.0) / 2.0)
    if not len(d2):
        return (cls, str(len(right)), number(1.0, "%"), "-", "-", "-", "-")
    return (
        cls, str(len(right)), number(float(np.mean(~definite)), "%"), number(float(np.mean(d2 <= 5.991)), "%"),
        number(float(np.median(d2) / 2.0), ""), number(float(np.median(sigma)), "px"),
        number(float(np.median(np.hypot(*d.T) / np.sqrt(2.0))), "px"),
    )  # fmt: skip
