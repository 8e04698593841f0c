"""What all benchmarks of sections share."""

import json
import logging

import pytest

from benchmarks.registration.report import Bar, Figure, Section
from benchmarks.registration.score import Interval
from benchmarks.telling import tell_sections


def section(name: str, value: float) -> Section:
    return Section(name, (Figure("speed", Interval(value, value, value), 1, "s", Bar(high=2.0)),))


@pytest.mark.parametrize(("value", "code"), [(1.0, 0), (3.0, 1)])
def test_a_missed_bar_is_the_exit_code(value, code, tmp_path, capsys):
    assert tell_sections(["one", "two"], lambda name: section(name, value), tmp_path / "figures.json") == code
    out = capsys.readouterr().out
    assert ("- two: speed" in out) == bool(code)
    assert [s["section"] for s in json.loads((tmp_path / "figures.json").read_text())] == ["one", "two"]


def test_only_while_it_measures_are_warnings_kept_quiet(caplog):
    def loud(name: str) -> Section:
        logging.getLogger("photomap_gis").warning("while measuring")
        raise RuntimeError(name)

    with pytest.raises(RuntimeError):
        tell_sections(["one"], loud, None)
    logging.getLogger("photomap_gis").warning("afterwards")
    assert [r.message for r in caplog.records] == ["afterwards"]
