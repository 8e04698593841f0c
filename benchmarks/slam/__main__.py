"""Measure the pose graph: ``python -m benchmarks.slam [--quick] [--only SECTION ...]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..registration.report import Section
from ..telling import LineProgress, tell_sections
from .measure import Options
from .sections import SECTIONS

FULL, QUICK = 40, 8


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slam", description=__doc__)
    parser.add_argument("--seeds", type=int, default=FULL, metavar="N", help=f"flights of a pool (default {FULL})")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} flights: the bars want 30 and more")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS), metavar="SECTION",
                        help=", ".join(SECTIONS))  # fmt: skip
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    chosen = _parser().parse_args(arguments)
    seeds = QUICK if chosen.quick else chosen.seeds

    def section(name: str) -> Section:
        return SECTIONS[name](Options(seeds, chosen.seed, chosen.quick, LineProgress(name)))

    return tell_sections(chosen.only, section, chosen.json)


if __name__ == "__main__":
    sys.exit(main())
