"""Measure the detection of error frames: ``python -m benchmarks.registration.faults [--count N] [--sheet FILE.png]``.

The exit code is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import cv2

from benchmarks.registration.faults.broken import Kind
from benchmarks.registration.faults.cases import Case
from benchmarks.registration.faults.judging import Outcome
from benchmarks.registration.faults.measure import FAULTY_COUNT, batches, make_case, misses, run, section_of
from benchmarks.registration.faults.partly import Loss
from benchmarks.registration.faults.sheet import write_sheet
from benchmarks.registration.faults.sound import available
from benchmarks.registration.pictures import find_sources
from benchmarks.registration.report import document, markdown


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration.faults", description=__doc__)
    parser.add_argument("--count", type=int, default=FAULTY_COUNT, metavar="N", help="faulty frames a kind")
    parser.add_argument("--quick", action="store_true", help="a tenth of them")
    parser.add_argument("--part", choices=("tuning", "reporting"), default="reporting", help="which pictures")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-j", "--processes", type=int, default=1, help="processes")
    parser.add_argument("--only", nargs="+", default=[], metavar="KIND", help="kinds whose name contains one of these")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    parser.add_argument("--sheet", type=Path, metavar="FILE", help="draw samples of each kind and every miss")
    chosen = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    for absent in find_sources(chosen.part).absent:
        print(f"left out: {absent.name}: {absent.reason}", file=sys.stderr)
    count = chosen.count // 10 if chosen.quick else chosen.count
    todo = [
        b for b in batches(count, chosen.seed, chosen.part) if not chosen.only or any(k in b.kind for k in chosen.only)
    ]
    outcomes: list[Outcome] = []
    for k, some in enumerate(run(todo, chosen.processes)):
        outcomes += some
        print(f"\r{k + 1}/{len(todo)} {some[0].kind:20}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    section = section_of(outcomes)
    print(markdown(section))
    for o in misses(outcomes):
        print(f"- {o.kind} {o.variety} seed {o.seed}: {o.reason or 'passed'}")
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(document(section), indent=1) + "\n", encoding="utf-8")
    if chosen.sheet is not None:
        write_sheet(chosen.sheet, _cases(chosen, outcomes))
    return 1 if section.missed else 0


def _cases(chosen: argparse.Namespace, outcomes: list[Outcome]) -> list[tuple[Case, str]]:
    groups = {**{k.value: "faulty" for k in Kind}, **{s.value: "sound" for s in available(chosen.part)}}
    groups |= {loss.value: "partly" for loss in Loss if loss.value not in groups}
    out = []
    for o in [*misses(outcomes), *_samples(outcomes)]:
        kind = o.variety if o.kind == "partly" else o.kind
        group = "partly" if o.kind == "partly" else groups[o.kind]
        case = make_case(group, kind, o.seed, chosen.part)
        out.append((case, f"{o.kind} {o.variety} {o.seed}: {o.reason or 'passed'}, masked {o.masked:.2f}"))
    return out


def _samples(outcomes: list[Outcome]) -> list[Outcome]:
    """Return the first three of each kind."""
    out: list[Outcome] = []
    for o in outcomes:
        if sum((p.kind, p.variety) == (o.kind, o.variety) for p in out) < (1 if o.faulty else 3):
            out.append(o)
    return out


if __name__ == "__main__":
    sys.exit(main())
