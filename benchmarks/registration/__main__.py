"""Measure registration: ``python -m benchmarks.registration [--quick] [--only SECTION ...]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import cv2

from ..telling import LineProgress, tell_sections
from . import accuracy, covariance, real, speed, success, validity
from .pairs import CLASSES
from .pictures import find_sources
from .plot import write_curve
from .report import Section
from .running import Options
from .sheet import write_sheet

SECTIONS: dict[str, Callable[[Options], Section]] = {
    "success": success.measure,
    "accuracy": accuracy.measure,
    "covariance": covariance.measure,
    "validity": validity.measure,
    "speed": speed.measure,
    "hfov": success.measure_hfov,
    "real": real.measure,
}
FULL, QUICK = 1000, 60


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration", description=__doc__)
    parser.add_argument("--pairs", type=int, default=FULL, metavar="N", help="pairs of a success class (default 1000)")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} pairs")
    parser.add_argument("--part", choices=("tuning", "reporting"), default="reporting", help="which pictures")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS), metavar="SECTION",
                        help=", ".join(SECTIONS))  # fmt: skip
    parser.add_argument("-j", "--processes", type=int, default=1, help="processes (speed runs in one)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write success against CPU time as PNG")
    parser.add_argument("--sheet", type=Path, metavar="FILE", help="draw pairs with their truth instead of measuring")
    parser.add_argument("--classes", default="", metavar="TEXT", help="with --sheet: classes whose name contains this")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    chosen = _parser().parse_args(arguments)
    cv2.setNumThreads(1)
    if chosen.sheet is not None:
        names = [c for c in CLASSES if chosen.classes in c]
        write_sheet(chosen.sheet, chosen.part, chosen.seed, each=2 if len(names) > 4 else 10, only=chosen.classes)
        return 0
    for absent in find_sources(chosen.part).absent:
        print(f"left out: {absent.name}: {absent.reason}", file=sys.stderr)
    count = QUICK if chosen.quick else chosen.pairs

    def section(name: str) -> Section:
        options = Options(count, chosen.seed, chosen.part, chosen.processes, LineProgress(name))
        measured = SECTIONS[name](options)
        if chosen.plot is not None and name == "success":
            write_curve(chosen.plot, measured.data["curve"])
        return measured

    return tell_sections(chosen.only, section, chosen.json)


if __name__ == "__main__":
    sys.exit(main())
