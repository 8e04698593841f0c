"""Measure the drawing of maps: ``python -m benchmarks.mosaic [--quick] [--only SECTION ...] [-o DIR]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from ..telling import tell_sections
from . import memory, seams, speed


def seam_section(folder: Path, *, quick: bool) -> Section:
    """Fly, map and judge, with relief and without; the same map with straight seams beside it."""
    figures: list[Figure] = []
    notes = []
    frames, width = (16, 640) if quick else (40, 1000)
    folder.mkdir(parents=True, exist_ok=True)
    for name, relief in (("hills", True), ("flat", False)):
        flight = folder / f"{name}-{frames}x{width}"
        truth = seams.fly(flight, relief=relief, frames=frames, width_px=width)
        ours = seams.judge(*seams.map_it(flight), truth)
        straight = seams.judge(*seams.map_it(flight, straight=True), truth)
        for words, q in ((name, ours), (f"{name}, straight seams", straight)):
            bar = Bar(0.9, 1.1) if q is ours else None
            figures += [
                Figure(f"{words}: gradient energy off seams (p5, p95)", _spread(q.energy), len(q.energy), "x", bar),
                Figure(f"{words}: the same within 8 px of seams", _spread(q.energy_on_seams), len(q.energy_on_seams),
                       "x", bar),
                Figure(f"{words}: patches unmatched", _exactly(q.unmatched), len(q.energy), "%",
                       Bar(high=0.02) if q is ours else None),
                Figure(f"{words}: windows across seams that are not of the ground", _exactly(q.broken_on_seams),
                       q.seam_windows, "%"),
            ]  # fmt: skip
        notes.append(f"{name}: elsewhere {100 * ours.broken_elsewhere:.2f} % of windows are not of the ground")
    return Section("seams", tuple(figures), notes=tuple(notes))


def _spread(values: np.ndarray) -> Interval:
    low, middle, high = (float(v) for v in np.percentile(values, (5, 50, 95)))
    return Interval(middle, low, high)


def _exactly(value: float) -> Interval:
    return Interval(value, value, value)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mosaic", description=__doc__)
    names = ("speed", "memory", "seams")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/mosaic"), help="folder for flights and missions")
    parser.add_argument("--quick", action="store_true", help="fewer and smaller frames")
    parser.add_argument(
        "--only", nargs="+", choices=names, default=list(names), metavar="SECTION", help=", ".join(names)
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    chosen = parser.parse_args(arguments)

    def section(name: str) -> Section:
        if name == "seams":
            return seam_section(chosen.output, quick=chosen.quick)
        return (speed if name == "speed" else memory).measure(quick=chosen.quick)

    return tell_sections(chosen.only, section, chosen.json)


if __name__ == "__main__":
    sys.exit(main())
