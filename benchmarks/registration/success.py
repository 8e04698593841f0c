"""Section ``success``: how often registrations are right, by class and method; ``hfov``: the same for other lenses."""

from __future__ import annotations

import numpy as np

from .methods import CURVE, method_named
from .pairs import CLASSES, SUCCESS_CLASSES
from .report import Bar, Figure, Section, Table, number
from .running import Job, Options, Outcome, only, run, together
from .score import Interval, wilson

BARS: dict[str, float] = {
    **dict.fromkeys(
        ("nominal", "translation-10", "translation-20", "translation-30", "rotation", "scale-1.4", "noise-10", "blur",
         "motion-blur", "tilt-0", "tilt-5", "tilt-10", "illumination"),
        0.99,
    ),
    **dict.fromkeys(("scale-1.6", "jpeg-10", "noise-20"), 0.97),
    "translation-40": 0.92, "translation-50": 0.80, "low-contrast": 0.85, "relief-5": 0.95, "relief-10": 0.85,
}  # fmt: skip
ALL_ALONE, ALL_WITH_FALLBACK = 0.94, 0.98
RIVALS = ("paper", "imreg_dft", "orb", "sift")
SHARES = {"imreg_dft": 0.04}
"""Slow methods see only the first pairs of each class, so does the curve."""
CURVE_SHARE = 0.1
HFOVS_DEG = (40.0, 60.0, 75.0)


def measure(options: Options, *, rivals: bool = True, classes: tuple[str, ...] = SUCCESS_CLASSES) -> Section:
    """Return the section: ours alone, with fallback, and the rivals, on the same pairs."""
    counts = {"ifmi": options.count, "ifmi+features": options.count}
    if rivals:
        counts |= {m: _share(options.count, SHARES.get(m, 1.0)) for m in RIVALS if method_named(m).absent is None}
        counts |= {s.name: _share(options.count, CURVE_SHARE) for s in CURVE}
    jobs = [job for cls in classes for job in together(cls, counts)]
    return section_of(run(jobs, options), options, classes)


def section_of(outcomes: list[Outcome], options: Options, classes: tuple[str, ...]) -> Section:
    """Return the section of outcomes that are already there."""
    alone = {c: only(outcomes, method="ifmi", cls=c) for c in classes}
    figures = [
        Figure(c, _right(alone[c]), len(alone[c]), "%", Bar(low=BARS[c]) if c in BARS else None) for c in classes
    ]
    for name, method, bar in (
        ("all classes, iFMI alone", "ifmi", ALL_ALONE),
        ("all classes, with fallback", "ifmi+features", ALL_WITH_FALLBACK),
    ):
        found = only(outcomes, method=method)
        figures.append(Figure(name, _mean_of_classes(found, classes), len(found), "%", Bar(low=bar)))
    methods = [m for m in ("ifmi", "ifmi+features", *RIVALS) if any(o.method == m for o in outcomes)]
    absent = [f"{m}: {method_named(m).absent}" for m in RIVALS if method_named(m).absent]
    return Section(
        "success",
        tuple(figures),
        (_by_class(outcomes, classes, methods), *([_curve(outcomes, classes)] if len(methods) > 2 else [])),
        (
            f"{options.part} pictures, seed {options.seed}; right: RMS error over the true overlap below 1.6 % of the "
            "width, whether accepted or not; all classes: their mean",
            *absent,
        ),
        {"curve": curve_of(outcomes, classes)},
    )


def _share(count: int, share: float) -> int:
    return max(1, round(count * share))


def _right(outcomes: list[Outcome]) -> Interval:
    return wilson(sum(o.right for o in outcomes), len(outcomes))


def _mean_of_classes(outcomes: list[Outcome], classes: tuple[str, ...]) -> Interval:
    """Return the mean of the classes' shares, with a normal interval of their joint variance."""
    shares = [(sum(o.right for o in v), len(v)) for v in (only(outcomes, cls=c) for c in classes) if v]
    if not shares:
        return Interval(float("nan"), 0.0, 1.0)
    p = [k / n for k, n in shares]
    # one success and one failure more in each keeps the variance of perfect classes above zero
    variance = sum((k + 1) / (n + 2) * (1 - (k + 1) / (n + 2)) / n for k, n in shares) / len(shares) ** 2
    mean, half = float(np.mean(p)), 1.96 * variance**0.5
    return Interval(mean, max(0.0, mean - half), min(1.0, mean + half))


def _by_class(outcomes: list[Outcome], classes: tuple[str, ...], methods: list[str]) -> Table:
    head = ("class", *(f"{m} %" for m in methods), "accepted %", "error px, median", "p95", "residual px, median")
    rows = []
    for c in classes:
        ours = only(outcomes, method="ifmi", cls=c)
        good = [o.rms_px for o in ours if o.right]
        rows.append((
            c, *(number(_right(only(outcomes, method=m, cls=c)).value, "%") for m in methods),
            number(float(np.mean([o.accepted for o in ours])), "%"),
            *(number(float(np.quantile(good, q)), "px") if good else "-" for q in (0.5, 0.95)),
            number(float(np.median([o.residual_px for o in ours])), "px"),
        ))  # fmt: skip
    return Table("By class (errors of ours, of those that are right; residual: what no similarity avoids)", head,
                 tuple(rows))  # fmt: skip


def curve_of(outcomes: list[Outcome], classes: tuple[str, ...]) -> list[dict[str, float | str]]:
    """Return each method's mean success and mean CPU time: one new frame, and its match with one known before."""
    points: list[dict[str, float | str]] = []
    for method in dict.fromkeys(o.method for o in outcomes):
        found = only(outcomes, method=method)
        # means: what a fallback costs now and then is a cost
        ms = float(np.mean([o.ms_frame for o in found]) + np.mean([o.ms_pair for o in found]))
        points.append({"method": method, "ms": ms, "success": _mean_of_classes(found, classes).value,
                       "pairs": len(found)})  # fmt: skip
    return sorted(points, key=lambda p: float(p["ms"]))


def _curve(outcomes: list[Outcome], classes: tuple[str, ...]) -> Table:
    rows = tuple(
        (str(p["method"]), number(float(p["ms"]), "ms"), number(float(p["success"]), "%"), str(p["pairs"]))
        for p in curve_of(outcomes, classes)
    )
    return Table("Success against CPU time (a new frame and its match, no prior)",
                 ("method", "ms", "success %", "n"), rows)  # fmt: skip


def measure_hfov(options: Options) -> Section:
    """Return success and errors of ours for narrower and wider lenses; the bars are those of 60 degrees."""
    classes = ("nominal", "translation-30", "tilt-10", "relief-5")
    tables, figures = [], []
    for hfov in HFOVS_DEG:
        jobs = [Job(c, ("ifmi",), _share(options.count, 0.3), hfov_deg=hfov) for c in classes]
        outcomes = run(jobs, options)
        for c in classes:
            found = only(outcomes, cls=c)
            figures.append(Figure(f"{c} at {hfov:g} deg", _right(found), len(found), "%"))
        tables.append(_by_class(outcomes, classes, ["ifmi"]))
        tables[-1] = Table(f"{hfov:g} degrees: {tables[-1].title}", tables[-1].head, tables[-1].rows)
    return Section("hfov", tuple(figures), tuple(tables))


assert set(BARS) <= set(CLASSES)
