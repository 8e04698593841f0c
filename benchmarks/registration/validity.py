"""Section ``validity``: does a registration know when it is wrong."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .pairs import SUCCESS_CLASSES
from .report import Bar, Figure, Section, Table, number
from .running import Job, Options, Outcome, only, run
from .score import Interval, wilson

METHODS = ("ifmi", "ifmi+features")
RECALL = Bar(low=0.97)
WRONG_ACCEPTED = Bar(high=0.0002)
REPETITIVE_ACCEPTED_WRONG = Bar(high=0.001)
NONE = Bar(high=0.0)
WRONG_PER_PAIR, RECALL_SHARE = 5, 0.25
"""Wrong and repetitive pairs are five times as many as those of a success class, recall is of a quarter."""
BINS = (0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0)


def measure(options: Options) -> Section:
    """Return the section, of iFMI alone and with its fallback."""
    many = WRONG_PER_PAIR * options.count
    jobs = [Job("wrong", METHODS, many), Job("repetitive", METHODS, many)]
    jobs += [Job(c, METHODS, max(5, round(RECALL_SHARE * options.count))) for c in SUCCESS_CLASSES]
    return section_of(run(jobs, options))


def section_of(outcomes: list[Outcome]) -> Section:
    """Return the section of outcomes that are already there."""
    figures, tables = [], []
    for method in METHODS:
        found = only(outcomes, method=method)
        true = [o for o in found if o.cls in SUCCESS_CLASSES]
        right = [o for o in true if o.right]
        wrong, repetitive = only(found, cls="wrong"), only(found, cls="repetitive")
        figures += [
            Figure(f"{method}: recall of the right", _share(right), len(right), "%", RECALL),
            Figure(f"{method}: wrong pairs accepted", _share(wrong), len(wrong), "%", WRONG_ACCEPTED),
            Figure(f"{method}: repetitive, accepted and off",
                   wilson(sum(o.accepted and not o.right for o in repetitive), len(repetitive)), len(repetitive), "%",
                   REPETITIVE_ACCEPTED_WRONG),
            Figure(f"{method}: repetitive, right", wilson(sum(o.right for o in repetitive), len(repetitive)),
                   len(repetitive), "%"),
            Figure(f"{method}: repetitive, right and accepted",
                   wilson(sum(o.right and o.accepted for o in repetitive), len(repetitive)), len(repetitive), "%"),
            Figure(f"{method}: same ground, accepted and off",
                   wilson(sum(o.accepted and not o.right for o in true), len(true)), len(true), "%"),
            Figure(f"{method}: corrupt rows, accepted and off",
                   wilson(sum(o.accepted and not o.right for o in only(true, cls="corrupt-rows")),
                          len(only(true, cls="corrupt-rows"))), len(only(true, cls="corrupt-rows")), "%", NONE),
        ]  # fmt: skip
        tables += [_reliability(method, found), _recall_at(method, right, [*wrong, *repetitive])]
        tables += _offenders(method, found)
    return Section("validity", tuple(figures), tuple(tables))


def _share(outcomes: list[Outcome]) -> Interval:
    return wilson(sum(o.accepted for o in outcomes), len(outcomes))


def _reliability(method: str, outcomes: list[Outcome]) -> Table:
    """Claimed against observed: of pairs of all classes with a probability within a bin, how many are right."""
    p = np.array([o.probability for o in outcomes])
    right = np.array([o.right for o in outcomes])
    rows = []
    for low, high in pairwise(BINS):
        inside = (p >= low) & ((p < high) if high < 1.0 else (p <= 1.0))
        if inside.any():
            rows.append((f"{low:g} to {high:g}", str(int(inside.sum())), number(float(p[inside].mean()), "%"),
                         number(float(right[inside].mean()), "%")))  # fmt: skip
    return Table(f"{method}: probability, claimed and observed (all classes together)",
                 ("probability", "n", "claimed %", "right %"), tuple(rows))  # fmt: skip


def _recall_at(method: str, right: list[Outcome], others: list[Outcome]) -> Table:
    """What a threshold at a given recall would let in."""
    if not right:
        return Table(f"{method}: thresholds", ("recall %", "threshold", "wrong accepted", "of"), ())
    p = np.array([o.probability for o in right])
    bad = [o for o in others if not o.right]
    rows = []
    for recall in (0.95, 0.97, 0.98, 0.99):
        threshold = float(np.quantile(p, 1.0 - recall))
        rows.append((number(recall, "%"), f"{threshold:.7f}", str(sum(o.probability >= threshold for o in bad)),
                     str(len(bad))))  # fmt: skip
    return Table(f"{method}: what thresholds of a given recall would accept wrongly (wrong and repetitive pairs)",
                 ("recall %", "threshold", "wrongly accepted", "of"), tuple(rows))  # fmt: skip


def _offenders(method: str, outcomes: list[Outcome], most: int = 25) -> list[Table]:
    bad = sorted((o for o in outcomes if o.accepted and not o.right), key=lambda o: -o.probability)[:most]
    if not bad:
        return []
    rows = tuple((o.cls, str(o.index), o.picture, o.by, f"{o.probability:.6f}", number(o.rms_px, "px")) for o in bad)
    head = ("class", "k", "picture", "by", "probability", "error px")
    return [Table(f"{method}: accepted and off, worst first", head, rows)]
