"""Measure the place on Earth: ``python -m benchmarks.georef [--quick] [--only SECTION ...]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ..registration.report import Section, document, markdown
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
    logging.disable(logging.WARNING)
    sections = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = chosen.output or Path(scratch)
        for name in chosen.only:
            start = time.perf_counter()
            seeds = range(chosen.seed, chosen.seed + (QUICK if chosen.quick else chosen.seeds))
            section = SECTIONS[name](Options(tuple(seeds), folder, lambda word: print(word, file=sys.stderr)))
            print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
            print(markdown(section), flush=True)
            sections.append(section)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps([document(s) for s in sections], indent=1) + "\n", encoding="utf-8")
    missed = [f"{s.name}: {f.name}" for s in sections for f in s.missed]
    print("\n".join(["Missed:", *(f"- {m}" for m in missed)]) if missed else "Every bar is met.")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
