"""The benchmarks' own arithmetic: cases, limits, table; the product itself is not run here."""

import importlib.util
import sys
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType

import pytest

from photomap_gis.simulate.evaluate import MapErrors

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


def _load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", BENCHMARKS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


flights, evaluate = _load("flights"), _load("evaluate")

GOOD = MapErrors(
    **{f.name: 0.0 for f in fields(MapErrors)}
    | {
        "gsd_m_per_px": 0.1,
        "true_gsd_m_per_px": 0.1,
        "coverage": 1.0,
        "scale": 1.0,
        "floor_rmse_m": 1.0,
        "patches": 500,
    }
)


def _row(errors: MapErrors, attitude: str = "reported"):  # a Row of the module loaded above
    return flights.Row(flights.Case("procedural", attitude, 0), errors, flights.Cost(1.0, 100.0),
                       {"frames": {"registered": 80, "total": 80}})  # fmt: skip


def test_a_good_map_keeps_every_limit() -> None:
    assert _row(GOOD).broken == []


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"absolute_rmse_m": 1.2}, "ratio"),
        ({"floor_rmse_m": None}, "ratio"),
        ({"relative_rmse_m": 0.51}, "relative"),
        ({"relative_rmse_m": float("nan")}, "relative"),
        ({"coverage": 0.989}, "coverage"),
        ({"coverage": float("nan")}, "coverage"),
        ({"unmatched_share": 0.021}, "unmatched"),
        ({"gsd_m_per_px": 0.11}, "pixel"),
        ({"gsd_m_per_px": 0.09}, "pixel"),
    ],
)
def test_each_limit_is_noticed(change: dict, name: str) -> None:
    assert _row(replace(GOOD, **change)).broken == [name]


def test_each_attitude_has_its_own_limit() -> None:
    bent = replace(GOOD, relative_rmse_m=0.25)
    assert _row(bent, "leaning").broken == []
    assert _row(bent, "unreported").broken == ["relative"]


def test_the_table_has_a_line_for_each_flight() -> None:
    lines = flights.table([_row(GOOD), _row(replace(GOOD, coverage=0.5))]).splitlines()
    assert len(lines) == 4
    assert len({line.count("|") for line in lines}) == 1
    assert "kept" in lines[2] and "BROKEN: coverage" in lines[3]


def test_cases_have_names_of_their_own_and_quick_ones_are_few() -> None:
    every = flights.cases(quick=False, seeds=[0, 1])
    assert len({c.name for c in every}) == len(every)
    assert {c.attitude for c in every} == set(flights.ATTITUDES)
    assert all(c.spec.frames == 80 and c.spec.width_px == 1600 and c.spec.gps.walk_sigma_m == 2.0 for c in every)
    assert len(flights.cases(quick=True, seeds=[0, 1])) == len(every) // 2


def test_words_say_the_numbers() -> None:
    text = evaluate.words(replace(GOOD, relative_rmse_m=0.25))
    assert "2.50 GSD" in text and "ratio 0.000" in text
    assert "no GPS" in evaluate.words(replace(GOOD, floor_rmse_m=None))


def test_a_missing_map_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate.main([str(tmp_path / "map.tif"), str(tmp_path)]) == 3
    assert capsys.readouterr().err.startswith("error: ")
