"""The same flight through other programs: ``python -m benchmarks.peers --python PEERS/bin/python [-o DIR]``.

``--python`` is the interpreter of an environment of its own that holds pyOrthomosaic and pycolmap (``pip install
pyOrthomosaic pycolmap``); what is absent there is left out. Maps are judged by the same patches as ours; pycolmap,
which makes none, by its cameras' centres after the best similarity in space.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from photomap_gis.simulate import read_truth
from photomap_gis.simulate.evaluate import MapErrors, evaluate_map

from .flights import Case, Cost, make_map, run, simulate

HEAD = "| program | photos placed | relative RMSE, GSD | median, GSD | coverage % | unmatched % | CPU s | wall s | MB |"
_COLMAP = """
import json, sys, pycolmap
from pathlib import Path
photos, work = Path(sys.argv[1]), Path(sys.argv[2])
database = work / "database.db"
pycolmap.extract_features(database, photos, camera_mode=pycolmap.CameraMode.SINGLE)
pycolmap.match_exhaustive(database)
models = pycolmap.incremental_mapping(database, photos, work)
best = max(models.values(), key=lambda m: m.num_reg_images())
print("CENTRES" + json.dumps({i.name: list(map(float, i.projection_center())) for i in best.images.values()}))
"""


def _colmap(python: str, photos: Path, work: Path, truth_dir: Path) -> tuple[tuple[str, ...], Cost]:
    out, cost = run([python, "-c", _COLMAP, str(photos), str(work)])
    centres = json.loads(out.decode().split("CENTRES", 1)[1])
    truth = read_truth(truth_dir)
    true = {f.name: (f.pose.easting_m, f.pose.northing_m, f.pose.height_m) for f in truth.frames}
    names = sorted(centres.keys() & true.keys())
    off_m = off_after_similarity(np.array([centres[n] for n in names]), np.array([true[n] for n in names]))
    gsd = truth.gsd_m_per_px
    rmse, median = float(np.sqrt(np.mean(off_m**2))) / gsd, float(np.median(off_m)) / gsd
    return (f"{len(names)}", f"{rmse:.2f} (centres)", f"{median:.2f} (centres)", "no map", "no map"), cost


def off_after_similarity(points: np.ndarray, true: np.ndarray) -> np.ndarray:
    """``(n,)`` distances of ``(n, 3)`` points from the true ones after the best similarity (Umeyama 1991)."""
    p, q = points - points.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(q.T @ p)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = float((s * sign).sum() / (p**2).sum())
    return np.asarray(np.linalg.norm(scale * p @ (u * sign @ vt).T - q, axis=1))


def _map_row(errors: MapErrors, placed: str) -> tuple[str, ...]:
    return (
        placed, f"{errors.relative_rmse_gsd:.2f}", f"{errors.relative_median_m / errors.true_gsd_m_per_px:.2f}",
        f"{100 * errors.coverage:.1f}", f"{100 * errors.unmatched_share:.1f}",
    )  # fmt: skip


def _ours(photos: Path, work: Path, flight: Path) -> tuple[tuple[str, ...], Cost]:
    summary, cost = make_map(photos, work / "mission")
    frames = summary["frames"]
    assert isinstance(frames, dict)
    return _map_row(evaluate_map(str(summary["map"]), flight), str(frames["registered"])), cost


def _orthomosaic(program: Path, photos: Path, work: Path, flight: Path) -> tuple[tuple[str, ...], Cost]:
    _, cost = run([str(program), str(photos), "-o", str(work / "ortho.tif" if program.name == "orthomosaic" else work)])
    maps = sorted(work.rglob("*ortho*.tif"))
    if not maps:
        raise RuntimeError(f"{program.name} left no map")
    return _map_row(evaluate_map(maps[0], flight), "not told"), cost


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--python", required=True, help="the interpreter of the peers' environment")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/peers"), help="folder for flights")
    parser.add_argument("--attitude", default="unreported", help="what is known of it (see benchmarks/flights.py)")
    parser.add_argument("--frames", type=int, default=80)
    parser.add_argument("--width", type=int, default=1600)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    case = Case("procedural", chosen.attitude, chosen.seed, chosen.frames, chosen.width)
    chosen.output.mkdir(parents=True, exist_ok=True)
    flight = simulate(case, chosen.output / case.name)
    photos, programs = flight / "photos", Path(chosen.python).parent
    rows: dict[str, Callable[[Path], tuple[tuple[str, ...], Cost]]] = {
        "photomap": lambda work: _ours(photos, work, flight),
        "pyOrthomosaic, affine": lambda work: _orthomosaic(programs / "orthomosaic", photos, work, flight),
        "pycolmap": lambda work: _colmap(chosen.python, photos, work, flight),
        "pyOrthomosaic, in space": lambda work: _orthomosaic(programs / "orthomosaic-3d", photos, work, flight),
    }
    print(HEAD, "|---|" + "---|" * 8, sep="\n", flush=True)
    for name, measure in rows.items():
        with tempfile.TemporaryDirectory() as scratch:
            began = time.perf_counter()
            try:
                cells, cost = measure(Path(scratch))
            except (RuntimeError, OSError) as error:
                print(f"{name}: left out: {error}", file=sys.stderr)
                continue
            wall_s = time.perf_counter() - began
        words = (*cells, f"{cost.cpu_s:.0f}", f"{wall_s:.0f}", f"{cost.peak_rss_mb:.0f}")
        print("| " + " | ".join((name, *words)) + " |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
