"""Fly simulated flights through the product and judge each map: ``python benchmarks/flights.py [--quick] -o DIR``.

Grounds x what is known of the attitude x seeds; 80 photos 1600 pixels wide, lawnmower, GPS error 2 m an axis, tau 60 s.
Flights are kept in DIR and reused. Exits with 1 where a limit is broken.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from photomap_gis.core.errors import PhotomapError
from photomap_gis.simulate import FlightSpec, Motion, read_truth, run_simulation
from photomap_gis.simulate.evaluate import MapErrors, evaluate_map

YELLOWSTONE = (
    Path(__file__).resolve().parents[2] / "shared/data/ortho_yellowstone/2019_YELL_2_528000_4978000_image_crop2.png"
)
ATTITUDES = {
    # name: (sigma of roll and pitch in degrees, reported, limit of the relative RMSE in GSD)
    "reported": (2.0, True, 5.0),
    "level": (0.0, False, 5.0),
    "unreported": (2.0, False, 1.0),
    "leaning": (1.0, False, 3.0),
    "relief-5": (2.0, False, 2.0),
    "relief-10": (2.0, False, 3.0),
}
LEANING = {"lean_deg": 15.0, "k1": -0.04}
"""What the leaning camera does, and its file does not tell: looks 15 degrees ahead, through a lens that bends lines."""

HEIGHT_M = {"relief-5": 240.0, "relief-10": 120.0}
"""Over houses, trees and rubble of up to 12 m these make a relief of 5 and 10 % of the height; else it is 12 %."""

MAX_RATIO, MIN_COVERAGE, MAX_UNMATCHED, MAX_PIXEL_RATIO = 1.15, 0.99, 0.02, 1.03


@dataclass(frozen=True, slots=True)
class Case:
    """One flight to judge."""

    ground: str
    attitude: str
    seed: int
    frames: int = 80
    width_px: int = 1600

    @property
    def name(self) -> str:
        return f"{self.ground}-{self.attitude}-{self.seed}-{self.frames}x{self.width_px}"

    @property
    def spec(self) -> FlightSpec:
        tilt, reported, _ = ATTITUDES[self.attitude]
        leans = self.attitude == "leaning"
        return FlightSpec(
            frames=self.frames,
            altitude_m=HEIGHT_M.get(self.attitude, 100.0) if self.ground == "procedural" else None,
            width_px=self.width_px,
            height_px=self.width_px * 3 // 4,
            motion=Motion(tilt_deg=tilt, lean_deg=LEANING["lean_deg"] if leans else 0.0),
            k1=LEANING["k1"] if leans else 0.0,
            report_calibration=not leans,
            report_attitude=reported,
            seed=self.seed,
        )


@dataclass(frozen=True, slots=True)
class Cost:
    """What making a map took."""

    cpu_s: float
    peak_rss_mb: float


@dataclass(frozen=True, slots=True)
class Row:
    """A judged flight."""

    case: Case
    errors: MapErrors
    cost: Cost
    summary: Mapping[str, object]

    @property
    def broken(self) -> list[str]:
        """The limits that this map does not keep."""
        e = self.errors
        limits = (
            ("ratio", math.inf if e.ratio_to_floor is None else e.ratio_to_floor, MAX_RATIO),
            ("relative", e.relative_rmse_gsd, ATTITUDES[self.case.attitude][2]),
            ("coverage", 1.0 - e.coverage, 1.0 - MIN_COVERAGE),
            ("unmatched", e.unmatched_share, MAX_UNMATCHED),
            ("pixel", max(e.gsd_m_per_px / e.true_gsd_m_per_px, e.true_gsd_m_per_px / e.gsd_m_per_px), MAX_PIXEL_RATIO),
        )
        # a NaN keeps no limit
        return [name for name, value, limit in limits if not value <= limit]


def cases(*, quick: bool, seeds: Iterable[int]) -> list[Case]:
    """Return the flights of a run; quick ones are smaller and of one seed."""
    grounds = ["procedural", *(["yellowstone"] if YELLOWSTONE.is_file() else [])]
    size = {"frames": 30, "width_px": 1000} if quick else {}
    return [
        Case(g, a, s, **size)
        for g in grounds
        for a in ATTITUDES
        for s in (list(seeds)[:1] if quick else seeds)
        if g == "procedural" or a not in HEIGHT_M
    ]


def simulate(case: Case, folder: Path) -> Path:
    """Return the folder of a case's flight, flown now unless it lies there already."""
    if not (folder / "truth" / "truth.json").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        run_simulation("procedural" if case.ground == "procedural" else YELLOWSTONE, folder, case.spec)
    return folder


def make_map(photos: Path, mission: Path) -> tuple[Mapping[str, object], Cost]:
    """Run ``photomap map`` in its own process; return its JSON summary and what it took."""
    shutil.rmtree(mission, ignore_errors=True)
    program = "import sys; from photomap_gis.cli import main; sys.exit(main())"
    out, cost = run([sys.executable, "-c", program, "map", str(photos), "-o", str(mission), "--json", "--quiet"])
    return json.loads(out), cost


def run(command: Sequence[str]) -> tuple[bytes, Cost]:
    """Run a program; return what it printed and what it took with its children. ``RuntimeError`` where it fails."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(command, stdout=out, stderr=err)
        peak_mb, status = 0.0, None
        while status is None:
            peak_mb = max(peak_mb, _peak_rss_mb(process.pid))
            pid, code, usage = os.wait4(process.pid, os.WNOHANG)
            status = code if pid else None
            time.sleep(0.05)
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        if process.returncode != 0:
            said = err.read().decode(errors="replace")[-800:]
            raise RuntimeError(f"{Path(command[0]).name} failed ({process.returncode}): {said}")
        return out.read(), Cost(usage.ru_utime + usage.ru_stime, peak_mb)


def _peak_rss_mb(pid: int) -> float:
    """Peak memory of a running process; 0 where the system does not tell (``ru_maxrss`` holds the parent's too)."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmHWM")), 0.0)


def judge(case: Case, out: Path) -> Row:
    """Fly, map and judge one case."""
    folder = simulate(case, out / case.name)
    summary, cost = make_map(folder / "photos", out / (case.name + "-mission"))
    return Row(case, evaluate_map(str(summary["map"]), folder), cost, summary)


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table."""
    head = ("ground", "attitude", "seed", "registered", "absolute m", "floor m", "ratio", "relative GSD", "median GSD",
            "coverage %", "unmatched %", "CPU s", "MB", "limits")  # fmt: skip
    body = []
    for r in rows:
        e, frames = r.errors, r.summary.get("frames")
        counted = f"{frames['registered']}/{frames['total']}" if isinstance(frames, Mapping) else "?"
        body.append((
            r.case.ground, r.case.attitude, str(r.case.seed), counted, f"{e.absolute_rmse_m:.2f}",
            f"{_or_nan(e.floor_rmse_m):.2f}", f"{_or_nan(e.ratio_to_floor):.3f}", f"{e.relative_rmse_gsd:.2f}",
            f"{e.relative_median_m / e.true_gsd_m_per_px:.2f}", f"{100 * e.coverage:.2f}",
            f"{100 * e.unmatched_share:.2f}", f"{r.cost.cpu_s:.0f}", f"{r.cost.peak_rss_mb:.0f}",
            "kept" if not r.broken else "BROKEN: " + ", ".join(r.broken),
        ))  # fmt: skip
    lines = [head, tuple("---" for _ in head), *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/flights"), help="folder for flights and missions"
    )
    parser.add_argument("--quick", action="store_true", help="30 photos 1000 pixels wide, one seed")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--only", default="", help="run only the cases whose name contains this")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers here too")
    options = parser.parse_args(arguments)
    rows: list[Row] = []
    failed = 0
    for case in cases(quick=options.quick, seeds=options.seeds):
        if options.only not in case.name:
            continue
        print(f"{case.name} ...", file=sys.stderr, flush=True)
        try:
            rows.append(judge(case, options.output))
        except (RuntimeError, PhotomapError) as error:
            failed += 1
            print(f"{case.name}: {error}", file=sys.stderr)
    if options.json is not None:
        document = [
            {"case": asdict(r.case), "errors": dict(r.errors.as_dict()), "cost": asdict(r.cost), "broken": r.broken,
             "frames_seen": len(read_truth(options.output / r.case.name).frames), "summary": dict(r.summary)}
            for r in rows
        ]  # fmt: skip
        options.json.write_text(json.dumps(document, indent=1), encoding="utf-8")
    print(table(rows))
    return 1 if failed or not rows or any(r.broken for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
