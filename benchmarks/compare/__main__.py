"""Maps of change judged by known truth: ``python -m benchmarks.compare -o DIR``.

Made scenes whose seeds the calibration has not seen; 12 objects each, half came and half went; old imagery of 0.2 m,
some metres off, new one of 0.16 m.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.compare.judge import Judged, judge
from benchmarks.compare.pairs import MIX, KnownPair, known_pair
from photomap_gis.pipeline.compare import compare_maps
from photomap_gis.pipeline.compare_values import CompareOutputs
from photomap_gis.simulate.season import write_reference

NAMES = (
    "same day", "drift, walls lean", "season 0.3, lean", "season 0.6, lean", "season 1.0, noise",
    "other hour's shadows, lean",
    "season 0.5, other hour", "season 0.3, old is grey",
)  # fmt: skip
SEEDS = 4


def compared(pair: KnownPair, folder: Path) -> Judged:
    """Write a pair as GeoTIFFs, compare them, and judge what comes of it."""
    folder.mkdir(parents=True, exist_ok=True)
    old, new, outputs = folder / "old.tif", folder / "new.tif", CompareOutputs.of(folder / "change.tif")
    write_reference(pair.old, old, gsd_m=0.2, offset_m=(2.1, -1.4))
    write_reference(pair.new, new, gsd_m=0.16)
    compare_maps(old, new, outputs)
    return judge(pair, outputs.raster, outputs.polygons)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/compare"))
    parser.add_argument("--seeds", type=int, default=SEEDS)
    chosen = parser.parse_args()
    print("| pair | objects found | polygons that are right | false m2/km2 |\n| --- | --- | --- | --- |")
    everything: list[Judged] = []
    for kind, (name, nuisance) in enumerate(zip(NAMES, MIX, strict=True)):
        told = [
            compared(known_pair(900 + 8 * k + kind, nuisance), chosen.output / f"{kind}-{k}")
            for k in range(chosen.seeds)
        ]
        everything += told
        print(line(name, told), flush=True)
    print(line("all", everything))
    print("\nscore: share truly changed (pixels)")
    for n in range(5):
        count = sum(j.bins[n][2] for j in everything)
        mean, share = (sum(j.bins[n][k] * j.bins[n][2] for j in everything) / max(1, count) for k in (0, 1))
        print(f"{mean:.2f}: {share:.2f} ({count})")


def line(name: str, told: list[Judged]) -> str:
    found, objects = sum(j.found for j in told), sum(j.objects for j in told)
    right, areas = sum(j.right_areas for j in told), sum(j.areas for j in told)
    false_km2 = 1e6 * sum(j.false_m2 for j in told) / sum(j.compared_m2 for j in told)
    return f"| {name} | {found} of {objects} | {right} of {areas} | {false_km2:.0f} |"


if __name__ == "__main__":
    main()
