"""The benchmark of exports on a small raster: both sides run, and what it compares is the same."""

import json

import pytest
import rasterio

from benchmarks.export.__main__ import Result, compare, main
from benchmarks.export.ground import write_ground


def test_both_sides_make_the_same_cogs(tmp_path):
    results = compare(write_ground(tmp_path / "ground.tif", 1500), tmp_path, 1)
    cogs = [r for r in results if r.name.startswith("COG")]
    assert len(cogs) == 8  # four codecs, from a GeoTIFF and from our tiles
    for r in cogs:
        assert r.rival_s > 0
        assert r.ours_s > 0
        assert 0.85 < r.bytes_ratio < 1.1, r
    with rasterio.open(tmp_path / "ours.tif") as ours, rasterio.open(tmp_path / "theirs.tif") as theirs:
        assert (ours.shape, ours.transform, ours.overviews(1)) == (theirs.shape, theirs.transform, theirs.overviews(1))
        assert ours.block_shapes == theirs.block_shapes


@pytest.mark.parametrize(("rival", "ours", "size", "met"), [(3, 1, 1, True), (2.9, 1, 1, False), (9, 1, 1.2, False)])
def test_bars(rival, ours, size, met):
    assert Result("x", rival, ours, size, 3.0).met is met


def test_the_exit_code_says_whether_bars_are_met(tmp_path, monkeypatch, capsys):
    import benchmarks.export.__main__ as bench

    monkeypatch.setattr(bench, "write_ground", lambda path, side: path)
    for seconds, code in ((1.0, 0), (5.0, 1)):
        monkeypatch.setattr(bench, "compare", lambda *_, s=seconds: [Result("x", 3.0, s, 1.0, 3.0)])
        assert main(["--json", str(tmp_path / "r.json")]) == code
        assert json.loads((tmp_path / "r.json").read_text())[0]["met"] is (code == 0)
        assert "| x |" in capsys.readouterr().out
