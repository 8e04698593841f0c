"""One made pair of another season with known changes, as files, and what the comparison of them found."""

from pathlib import Path
from typing import NamedTuple

import pytest

from benchmarks.compare.pairs import KnownPair, Nuisance, known_pair
from photomap_gis.pipeline.compare import compare_maps
from photomap_gis.pipeline.compare_values import CompareOutputs, CompareSummary
from photomap_gis.simulate.season import write_reference

OFFSET_M = (3.1, -2.2)


class Compared(NamedTuple):
    """A pair, its files, and the comparison."""

    pair: KnownPair
    old: Path
    new: Path
    outputs: CompareOutputs
    summary: CompareSummary


@pytest.fixture(scope="session")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    folder = tmp_path_factory.mktemp("compared")
    pair = known_pair(901, Nuisance(season=0.6, warp_px=2.0, blur_px=0.8, lean=0.15))
    old, new = folder / "old.tif", folder / "new.tif"
    write_reference(pair.old, old, gsd_m=0.2, offset_m=OFFSET_M)
    write_reference(pair.new, new, gsd_m=0.16)
    outputs = CompareOutputs.of(folder / "change.tif")
    return Compared(pair, old, new, outputs, compare_maps(old, new, outputs))
