"""Measure the pose graph: ``python -m benchmarks.slam [--quick] [--only SECTION ...]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from pathlib import Path

from ..registration.report import document, markdown
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
    logging.disable(logging.WARNING)
    sections = []
    for name in chosen.only:
        start = time.perf_counter()
        seeds = QUICK if chosen.quick else chosen.seeds
        section = SECTIONS[name](Options(seeds, chosen.seed, chosen.quick, _Progress(name)))
        print(f"\r{name}: {time.perf_counter() - start:.0f} s{' ' * 20}", file=sys.stderr)
        print(markdown(section), flush=True)
        sections.append(section)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps([document(s) for s in sections], indent=1) + "\n", encoding="utf-8")
    missed = [f"{s.name}: {f.name}" for s in sections for f in s.missed]
    print("\n".join(["Missed:", *(f"- {m}" for m in missed)]) if missed else "Every bar is met.")
    return 1 if missed else 0


class _Progress:
    """Tells on one line of the error stream how far a section is."""

    def __init__(self, name: str) -> None:
        self._name, self._told = name, 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._told > 1.0:
            self._told = now
            print(f"\r{self._name}: {done}/{total}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
