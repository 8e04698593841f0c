"""Time exports against GDAL's own tools: ``python -m benchmarks.export [--side PX] [--rounds N] [--json FILE]``.

Both sides start from the same GeoTIFF and do the same: tiles of the same zooms, format and resampling; a COG of the
same compression and blocks. Times are the best of some rounds that take turns, and count only as ratios. The exit code
is 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import rasterio
import rasterio.shutil

from photomap_gis.core.mosaic import TileSource
from photomap_gis.export import write_geotiff, write_tiles
from photomap_gis.mosaic import TileStore

from .ground import write_ground
from .source import GeoTiffSource

# A stray PYTHONPATH or GDAL_DATA of this environment must not reach the system's own GDAL.
CLEAN = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "GDAL", "PROJ", "VIRTUAL"))}


@dataclass(frozen=True, slots=True)
class Result:
    """Seconds of both sides, and how many times as fast ours is; bytes ours over theirs."""

    name: str
    rival_s: float
    ours_s: float
    bytes_ratio: float
    bar: float

    @property
    def times_as_fast(self) -> float:
        """How many times as fast as the rival."""
        return self.rival_s / self.ours_s

    @property
    def met(self) -> bool:
        """Whether it is as fast as it must be, and at most a tenth larger."""
        return self.times_as_fast >= self.bar and self.bytes_ratio <= 1.10


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.export", description=__doc__)
    parser.add_argument("--side", type=int, default=6000, metavar="PX", help="of the square raster (default 6000)")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="best of N (default 3)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="photomap-bench-") as name:
        folder = Path(name)
        results = compare(write_ground(folder / "ground.tif", chosen.side), folder, chosen.rounds)
    print("| what | rival | ours | times as fast | bar | bytes ours / rival |\n|---|---|---|---|---|---|")
    for r in results:
        times = f"{r.rival_s:.2f} s | {r.ours_s:.2f} s | {r.times_as_fast:.2f}"
        print(f"| {r.name} | {times} | {r.bar or 'none'} | {r.bytes_ratio:.2f} |")
    if chosen.json is not None:
        document = [{**asdict(r), "times_as_fast": r.times_as_fast, "met": r.met} for r in results]
        chosen.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return 0 if all(r.met for r in results) else 1


def compare(ground: Path, folder: Path, rounds: int) -> list[Result]:
    """Return tiles against gdal2tiles (left out where that is not installed), COGs against GDAL's driver."""
    source = GeoTiffSource(ground)
    store = stored(source, folder / "mosaic")
    results = []
    tiler = shutil.which("gdal2tiles.py", path="/usr/bin")
    if tiler is None:
        print("gdal2tiles.py is not installed (apt-get install python3-gdal): left out", file=sys.stderr)
    else:
        results.append(_tiles(source, ground, folder, tiler, rounds))
    for compression, bars in (
        ("DEFLATE", (1.0, 1.5)),
        ("ZSTD", (1.0, 1.0)),
        ("JPEG", (1.0, 1.0)),
        ("WEBP", (1.0, 1.0)),
    ):
        for name, given, bar in (("the same GeoTIFF", source, bars[0]), ("our tiles", store, bars[1])):
            results.append(_cog(given, ground, folder, compression, f"COG {compression} from {name}", bar, rounds))
    return results


def stored(source: GeoTiffSource, folder: Path) -> TileStore:
    """Return a mission's tile store that shows the same."""
    store = TileStore.create(folder, source.grid, revision=1)
    for tile in source.grid.tiles():
        store.write(tile, source.read(source.grid.window(tile)))
    return TileStore(folder)


def _tiles(source: TileSource, ground: Path, folder: Path, tiler: str, rounds: int) -> Result:
    ours, theirs = folder / "ours", folder / "theirs"
    write_tiles(source, ours)  # also warms both sides' file cache, and says which zooms there are
    document = json.loads((ours / "tiles.json").read_text(encoding="utf-8"))
    command = [
        tiler, "--xyz", "--processes=2", "-r", "average", "-z", f"{document['minzoom']}-{document['maxzoom']}", "-q",
        "-x", "-w", "none", str(ground), str(theirs),
    ]  # fmt: skip

    def rival() -> None:
        shutil.rmtree(theirs, ignore_errors=True)
        subprocess.run(command, check=True, env=CLEAN, stdout=subprocess.DEVNULL)

    rival_s, ours_s = _best(rival, lambda: write_tiles(source, ours), rounds)
    sizes = [sum(p.stat().st_size for p in f.rglob("*.png")) for f in (ours, theirs)]
    return Result("XYZ tiles, PNG, against gdal2tiles --processes=2", rival_s, ours_s, sizes[0] / sizes[1], 3.0)


def _cog(
    source: TileSource, ground: Path, folder: Path, compression: str, name: str, bar: float, rounds: int
) -> Result:
    options = {
        "driver": "COG", "COMPRESS": compression, "BLOCKSIZE": "512", "OVERVIEW_RESAMPLING": "AVERAGE",
        "NUM_THREADS": "ALL_CPUS", "SPARSE_OK": "YES",
    }  # fmt: skip
    options |= {"QUALITY": "88"} if compression in ("JPEG", "WEBP") else {"PREDICTOR": "YES", "LEVEL": "3"}
    ours, theirs = folder / "ours.tif", folder / "theirs.tif"
    rival_s, ours_s = _best(
        lambda: rasterio.shutil.copy(str(ground), str(theirs), **options),
        lambda: write_geotiff(source, ours, compression=compression),
        rounds,
    )
    return Result(name, rival_s, ours_s, ours.stat().st_size / theirs.stat().st_size, bar)


def _best(rival: Callable[[], object], ours: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Return the least time of both, taking turns so that a busy machine is busy for both."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for run, kept in zip((rival, ours), times, strict=True):
            start = time.perf_counter()
            run()
            kept.append(time.perf_counter() - start)
    return min(times[0]), min(times[1])


if __name__ == "__main__":
    sys.exit(main())
