"""Section ``real``: consecutive photos of real flights, 256 pixel central squares, against the SIFT reference."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2

from .methods import Estimate, method_named
from .pictures import SHARED
from .reference import FLIGHTS, SIDE_PX, Reference, overlap_grid, read_reference, squares
from .report import Bar, Figure, Section, Table
from .running import Options
from .score import Interval, rms_px, wilson

WITHIN_SHARE = 0.03
ALONE = {"caliterra": 1.0, "seneca": 0.75}
METHODS = ("ifmi", "ifmi+features", "paper", "orb")
OVERLAPS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.8, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class RealOutcome:
    """What a method said of two photos; ``rms_px`` is ``None`` where there is no reference."""

    flight: str
    method: str
    reference: Reference
    estimate: Estimate
    rms_px: float | None

    @property
    def right(self) -> bool:
        """Within the tolerance of the reference."""
        return self.rms_px is not None and self.rms_px <= WITHIN_SHARE * SIDE_PX

    @property
    def accepted_but_wrong(self) -> bool:
        """Accepted, and off a reference that exists."""
        return self.estimate.accepted and self.rms_px is not None and not self.right


def measure(options: Options, methods: tuple[str, ...] = METHODS) -> Section:
    """Return the section; it takes its photos from beside the repository, and is empty without them."""
    absent = [f for f in FLIGHTS if not (SHARED / f / "images").is_dir()]
    outcomes = [o for f in FLIGHTS if f not in absent for o in run_flight(f, methods, options)]
    figures, tables = [], []
    for flight in (f for f in FLIGHTS if f not in absent):
        for method in methods:
            mine = [o for o in outcomes if o.flight == flight and o.method == method]
            known = [o for o in mine if o.rms_px is not None]
            ours = method.startswith("ifmi")
            bar = None if not ours else Bar(low=ALONE[flight] if method == "ifmi" else 1.0)
            figures.append(
                Figure(
                    f"{flight}, {method}: right", wilson(sum(o.right for o in known), len(known)), len(known), "%", bar
                )
            )
            if ours:
                figures.append(
                    Figure(
                        f"{flight}, {method}: right and accepted",
                        wilson(sum(o.right and o.estimate.accepted for o in known), len(known)),
                        len(known),
                        "%",
                    )
                )
                bad = sum(o.accepted_but_wrong for o in mine)
                figures.append(
                    Figure(
                        f"{flight}, {method}: accepted but wrong", Interval(bad, bad, bad), len(known), "", Bar(high=0)
                    )
                )
        tables.append(_by_overlap(flight, [o for o in outcomes if o.flight == flight], methods))
    tables += _offenders(outcomes)
    notes = [
        f"{flight}, {method}: {sum(o.estimate.accepted for o in strangers)} of {len(strangers)} pairs that SIFT cannot "
        "match were accepted (nothing here says whether rightly)"
        for flight in FLIGHTS
        for method in methods
        if method.startswith("ifmi")
        and (strangers := [o for o in outcomes if (o.flight, o.method, o.rms_px) == (flight, method, None)])
    ]
    notes += [f"{flight} is not beside the repository: left out" for flight in absent]
    return Section("real", tuple(figures), tuple(tables), tuple(notes))


def run_flight(flight: str, methods: tuple[str, ...], options: Options) -> list[RealOutcome]:
    """Return what methods say of a flight's consecutive photos."""
    cv2.setNumThreads(1)
    references = {(r.a, r.b): r for r in read_reference()[flight]}
    photos = list(squares(flight, SIDE_PX))
    outcomes = []
    for name in methods:
        method = method_named(name)
        states = [method.prepare(grey) for _, grey in photos]
        for (a, b), (state_a, state_b) in zip(pairwise(n for n, _ in photos), pairwise(states), strict=True):
            reference = references[a, b]
            estimate = method.match(state_a, state_b, None)
            T = reference.T_a_b
            error = None if T is None else rms_px(estimate.T_a_b, T, overlap_grid(T))
            outcomes.append(RealOutcome(flight, name, reference, estimate, error))
    return outcomes


def _by_overlap(flight: str, outcomes: list[RealOutcome], methods: tuple[str, ...]) -> Table:
    head = ("overlap", "n", *(f"{m} right" for m in methods), *(f"{m} accepted" for m in methods if "ifmi" in m))
    rows = []
    for low, high in pairwise(OVERLAPS):
        within = [o for o in outcomes if o.rms_px is not None and low <= o.reference.overlap < high + (high == 1.0)]
        if within:
            count = len(within) // len(methods)
            right = (str(sum(o.right for o in within if o.method == m)) for m in methods)
            accepted = (str(sum(o.estimate.accepted for o in within if o.method == m)) for m in methods if "ifmi" in m)
            rows.append((f"{low:g} to {high:g}", str(count), *right, *accepted))
    return Table(f"{flight} by the reference's overlap", head, tuple(rows))


def _offenders(outcomes: list[RealOutcome]) -> list[Table]:
    rows = tuple(
        (o.flight, o.reference.a, o.reference.b, o.method, f"{o.rms_px:.1f}", f"{o.reference.overlap:.2f}",
         f"{o.estimate.probability:.6f}")
        for o in outcomes
        if o.accepted_but_wrong and o.method.startswith("ifmi")
    )  # fmt: skip
    head = ("flight", "a", "b", "method", "off by px", "overlap", "probability")
    return [Table("Accepted but off the reference", head, rows)] if rows else []
