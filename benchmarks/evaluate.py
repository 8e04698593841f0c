"""Compare a map with the truth of the simulated flight it was made of.

``python benchmarks/evaluate.py MAP.tif FLIGHT``, FLIGHT a folder that ``photomap simulate`` wrote.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from photomap_gis.core.errors import PhotomapError
from photomap_gis.simulate.evaluate import MapErrors, evaluate_map


def words(e: MapErrors) -> str:
    """Say a map's errors in a few lines."""
    floor = "no GPS" if e.floor_rmse_m is None else f"{e.floor_rmse_m:.2f} m, ratio {e.ratio_to_floor:.3f}"
    return "\n".join(
        (
            f"absolute   {e.absolute_rmse_m:.3f} m RMSE, median {e.absolute_median_m:.3f} m "
            f"(floor of this GPS: {floor})",
            f"           offset {e.offset_east_m:+.2f} m east, {e.offset_north_m:+.2f} m north, turned "
            f"{e.rotation_deg:+.3f}°, scale {e.scale:.5f}",
            f"relative   {e.relative_rmse_m:.3f} m RMSE = {e.relative_rmse_gsd:.2f} GSD, "
            f"median {e.relative_median_m:.3f} m, 95 % {e.relative_p95_m:.3f} m",
            f"patches    {e.patches} on the land, {100 * e.unmatched_share:.2f} % unmatched, "
            f"{100 * e.beyond_10_gsd_share:.2f} % more than 10 GSD off",
            f"raised     {e.raised_patches} on or beside what stands on the land, "
            f"{100 * e.raised_unmatched_share:.1f} % unmatched, {e.raised_relative_rmse_m:.3f} m",
            f"coverage   {100 * e.coverage:.2f} % of the true footprints",
            f"pixel      {100 * e.gsd_m_per_px:.2f} cm; the frames' GSD is {100 * e.true_gsd_m_per_px:.2f} cm",
        )
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path, help="GeoTIFF to judge")
    parser.add_argument("flight", type=Path, help="folder that 'photomap simulate' wrote, or its truth folder")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    try:
        errors = evaluate_map(options.map, options.flight)
    except PhotomapError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    print(json.dumps(dict(errors.as_dict()), indent=1) if options.json else words(errors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
