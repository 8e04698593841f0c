"""Measure the live session: ``python -m benchmarks.live [--seconds N] [--frames N] [--only SECTION ...] [-o DIR]``.

The exit code is 1 where a bar is missed. Run it on an idle machine: it plays in real time.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..registration.report import Section
from ..telling import tell_sections
from . import breaks, finished, memory, realtime


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live", description=__doc__)
    names = ("realtime", "breaks", "finished", "memory")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/live"), help="folder for videos and missions")
    parser.add_argument("--seconds", type=int, default=60, help="length of the video that is played")
    parser.add_argument("--size", default="1280x720", help="of its frames")
    parser.add_argument("--browser", action="store_true", help="open the page in a real Chromium, and take pictures")
    parser.add_argument("--frames", type=int, default=6000, help="length of the flight whose memory is watched")
    parser.add_argument("--only", nargs="+", choices=names, default=list(names), metavar="SECTION")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures here too")
    chosen = parser.parse_args(arguments)
    width, height = (int(v) for v in chosen.size.split("x"))

    def section(name: str) -> Section:
        if name == "realtime":
            return realtime.measure(
                chosen.output, seconds=chosen.seconds, width_px=width, height_px=height, in_browser=chosen.browser
            )
        if name == "breaks":
            return breaks.measure(chosen.output)
        if name == "finished":
            return finished.measure(chosen.output)
        return memory.measure(chosen.output, frames=chosen.frames, width_px=width, height_px=height)

    return tell_sections(chosen.only, section, chosen.json)


if __name__ == "__main__":
    sys.exit(main())
