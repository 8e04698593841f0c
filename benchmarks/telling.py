"""What all benchmarks of sections do with them: measure in turn, print at once, keep figures, say what was missed."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from .registration.report import Section, document, markdown


def tell_sections(names: Iterable[str], measure: Callable[[str], Section], figures_file: Path | None) -> int:
    """Measure the named sections and print each as it comes; return the exit code: 1 where a bar is missed.

    Warnings of what is measured are not shown meanwhile.
    """
    sections = []
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        for name in names:
            start = time.perf_counter()
            section = measure(name)
            print(f"\r{name}: {time.perf_counter() - start:.0f} s{' ' * 20}", file=sys.stderr)
            print(markdown(section), flush=True)
            sections.append(section)
    finally:
        logging.disable(before)
    if figures_file is not None:
        figures_file.write_text(json.dumps([document(s) for s in sections], indent=1) + "\n", encoding="utf-8")
    missed = [f"{s.name}: {f.name}" for s in sections for f in s.missed]
    print("\n".join(["Missed:", *(f"- {m}" for m in missed)]) if missed else "Every bar is met.")
    return 1 if missed else 0


class LineProgress:
    """Tells on one line of the error stream how far a section is."""

    def __init__(self, name: str) -> None:
        self._name, self._told = name, 0.0

    def __call__(self, done: int, total: int) -> None:
        """Say so, once a second."""
        now = time.monotonic()
        if now - self._told > 1.0:
            self._told = now
            print(f"\r{self._name}: {done}/{total}", end="", file=sys.stderr, flush=True)
