"""Peak memory of drawing, exporting and layering a map: of 800 frames against that of 80, each in its own process."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from photomap_gis.core.grid import MapFrame
from photomap_gis.export import write_geotiff, write_layers
from photomap_gis.georef import resolve_crs
from photomap_gis.mosaic import plan_grid, render_layers, render_mosaic

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .flight import Pictures, lawnmower

MEMORY_MB = 256
KEPT = 40


def draw(frames: int, folder: Path) -> dict[str, float]:
    """Draw a map of so many frames 640 x 480, then its GeoTIFF and layers; return this process's peaks."""
    trajectory = lawnmower(frames, width_px=640, height_px=480, per_strip=20)
    map_frame = MapFrame(resolve_crs("EPSG:32632"), 500_000.0, 5_900_000.0)
    grid = plan_grid(trajectory, map_frame)
    read = Pictures(trajectory, kept=KEPT)
    store = render_mosaic(
        trajectory, map_frame, grid, read, folder / "mosaic", revision=1, workers=2, memory_mb=MEMORY_MB
    )
    drawn_mb = peak_rss_mb()
    write_geotiff(store, folder / "map.tif")
    layers = render_layers(
        store, trajectory, map_frame, times_s={p.frame: 1e9 + p.frame for p in trajectory.placements}, workers=2
    )
    write_layers(layers, folder / "layers")
    return {"drawn_mb": drawn_mb, "all_mb": peak_rss_mb(), "megapixels": grid.width * grid.height / 1e6}


def peak_rss_mb() -> float:
    """Return the most memory that this process ever had, MiB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024.0
    raise RuntimeError("this system does not tell a process's peak memory")


def measure(*, quick: bool) -> Section:
    """Return both peaks and their ratio."""
    few, many = (40, 160) if quick else (80, 800)
    told = {n: _in_its_own_process(n) for n in (few, many)}
    drawing, all_ = (told[many][k] / told[few][k] for k in ("drawn_mb", "all_mb"))
    return Section(
        "memory",
        (
            Figure(f"drawing {many} frames over {few}", _exactly(drawing), 1, "x", Bar(high=1.25)),
            Figure(f"with GeoTIFF and layers, {many} frames over {few}", _exactly(all_), 1, "x", Bar(high=1.25)),
        ),
        notes=tuple(
            f"{n} frames: {t['drawn_mb']:.0f} MB drawing, {t['all_mb']:.0f} MB in all, {t['megapixels']:.0f} megapixels"
            for n, t in told.items()
        ),
        data={str(n): t for n, t in told.items()},
    )


def _in_its_own_process(frames: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.mosaic.memory", str(frames), folder]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout))


def _exactly(value: float) -> Interval:
    return Interval(value, value, value)


if __name__ == "__main__":
    print(json.dumps(draw(int(sys.argv[1]), Path(sys.argv[2]))))
