"""A replay of photos: when they came after a gap, the journal knows alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from photomap_gis.cli import main
from photomap_gis.simulate import FlightSpec, run_simulation


def test_photos_of_two_strips_are_drawn_as_they_were(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between strips photos pause; what is newer is worth more, and feathered by that: a tenth of a second shows."""
    run_simulation("procedural", tmp_path / "sim", FlightSpec(frames=8, width_px=480, height_px=360, seed=4))
    photos, mission = str(tmp_path / "sim" / "photos"), str(tmp_path / "mission")
    assert main(["live", photos, "-o", mission, "--as-fast-as-possible", "--no-finalise", "--json"]) == 0
    capsys.readouterr()
    assert main(["replay", mission, "--json"]) == 0
    assert '"pixels_equal": true' in capsys.readouterr().out
