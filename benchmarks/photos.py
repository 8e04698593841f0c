"""What mapping a folder of photos costs: CPU seconds and peak memory of ``photomap map`` in a process of its own.

::

    python -m benchmarks.photos ../shared/data/caliterra/images
    python -m benchmarks.photos FOLDER --max-cpu-s 60 --max-mb 1536

Exits 1 where a limit is broken. ``photomap --help`` is timed beside it, as the median of five processes.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.flights import make_map

HELP = [sys.executable, "-c", "import sys; from photomap_gis.cli import main; sys.exit(main(['--help']))"]


def help_seconds(runs: int = 5) -> float:
    """Return the median wall time of ``photomap --help``."""
    times = []
    for _ in range(runs):
        started = time.perf_counter()
        subprocess.run(HELP, check=True, capture_output=True)
        times.append(time.perf_counter() - started)
    return statistics.median(times)


def main(arguments: list[str] | None = None) -> int:
    """Map the folder, print a line of figures, and return 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description="CPU and memory of mapping a folder of photos")
    parser.add_argument("photos", type=Path)
    parser.add_argument("--max-cpu-s", type=float, default=60.0)
    parser.add_argument("--max-mb", type=float, default=1536.0)
    parser.add_argument("--max-help-s", type=float, default=0.4)
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        summary, cost = make_map(chosen.photos, Path(folder) / "mission")
    help_s = help_seconds()
    print(f"{chosen.photos}: {summary['frames']}, {summary['segments']} piece(s), {summary['registrations']}")
    print(f"cpu {cost.cpu_s:.1f} s, peak {cost.peak_rss_mb:.0f} MB, seconds {summary['seconds']}")
    print(f"photomap --help {help_s:.2f} s")
    kept = cost.cpu_s <= chosen.max_cpu_s and cost.peak_rss_mb <= chosen.max_mb and help_s <= chosen.max_help_s
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
