"""Measure the place on Earth: ``python -m benchmarks.georef [--quick] [--only SECTION ...]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from ..registration.report import Section
from ..telling import tell_sections
from . import reference
from .options import Options

SECTIONS: dict[str, Callable[[Options], Section]] = {"reference": reference.measure}
FULL, QUICK = 4, 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.georef", description=__doc__)
    parser.add_argument("--seeds", type=int, default=FULL, metavar="N", help=f"flights a ground (default {FULL})")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} flight a ground")
    parser.add_argument("--seed", type=int, default=0, help="the first flight's seed")
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=list(SECTIONS), metavar="SECTION",
                        help=", ".join(SECTIONS))  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="keep flights, maps and pictures here")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    chosen = _parser().parse_args(arguments)
    seeds = tuple(range(chosen.seed, chosen.seed + (QUICK if chosen.quick else chosen.seeds)))
    with tempfile.TemporaryDirectory() as scratch:
        options = Options(seeds, chosen.output or Path(scratch), lambda word: print(word, file=sys.stderr))
        return tell_sections(chosen.only, lambda name: SECTIONS[name](options), chosen.json)


if __name__ == "__main__":
    sys.exit(main())
