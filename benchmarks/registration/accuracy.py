"""Section ``accuracy``: how far right registrations are from the closest similarity."""

from __future__ import annotations

import numpy as np

from .report import Bar, Figure, Section
from .running import Job, Options, Outcome, only, run
from .score import Interval, median, quantile

TILT_0 = (
    ("error px", "rms_px", "px", 0.03),
    ("angle deg", "angle_deg", "deg", 0.01),
    ("scale %", "scale", "%", 0.0003),
)
NOMINAL_MEDIAN_PX, NOMINAL_P95_PX = 0.35, 0.7
SHARE_OF_ORB = 0.5


def measure(options: Options) -> Section:
    """Return the section: no tilt, then tilt up to 3 degrees against ORB, on the same pairs."""
    count = max(20, options.count)
    jobs = [Job("tilt-0", ("ifmi",), count), Job("nominal", ("ifmi", "orb"), count)]
    outcomes = run(jobs, options)
    rng = np.random.default_rng(options.seed)
    level = [o for o in only(outcomes, cls="tilt-0") if o.right]
    figures = [
        Figure(f"tilt 0, median {name}", median([getattr(o, attribute) for o in level], rng), len(level), unit,
               Bar(high=bar))
        for name, attribute, unit, bar in TILT_0
    ]  # fmt: skip
    figures.append(
        Figure("tilt 0, median at the centre px", median([o.centre_px for o in level], rng), len(level), "px")
    )
    both = _right_in_both(only(outcomes, cls="nominal"))
    ours, orb = ([pair[k].rms_px for pair in both] for k in (0, 1))
    n = len(both)
    figures += [
        Figure("tilt <= 3, median px", median(ours, rng), n, "px", Bar(high=NOMINAL_MEDIAN_PX)),
        Figure("tilt <= 3, p95 px", quantile(ours, 0.95, rng), n, "px", Bar(high=NOMINAL_P95_PX)),
        Figure("tilt <= 3, ORB median px", median(orb, rng), n, "px"),
        Figure("tilt <= 3, ORB p95 px", quantile(orb, 0.95, rng), n, "px"),
        Figure("median, share of ORB's", _ratio(ours, orb, 0.5, rng), n, "", Bar(high=SHARE_OF_ORB)),
        Figure("p95, share of ORB's", _ratio(ours, orb, 0.95, rng), n, "", Bar(high=SHARE_OF_ORB)),
    ]
    return Section("accuracy", tuple(figures), notes=("of pairs that are right; error: RMS over the true overlap",))


def _right_in_both(outcomes: list[Outcome]) -> list[tuple[Outcome, Outcome]]:
    orb = {o.index: o for o in only(outcomes, method="orb")}
    return [(o, orb[o.index]) for o in only(outcomes, method="ifmi") if o.right and orb[o.index].right]


def _ratio(ours: list[float], orb: list[float], q: float, rng: np.random.Generator) -> Interval:
    """Return the ratio of two quantiles of the same pairs, its interval by resampling pairs."""
    if not ours:
        return Interval(float("nan"), float("nan"), float("nan"))
    x, y = np.array(ours), np.array(orb)
    drawn = [np.quantile(x[k], q) / np.quantile(y[k], q) for k in rng.integers(len(x), size=(400, len(x)))]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return Interval(float(np.quantile(x, q) / np.quantile(y, q)), float(low), float(high))
