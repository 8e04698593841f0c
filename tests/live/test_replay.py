"""A replay of photos: when they came after a gap, the journal knows alone."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from photomap_gis.cli import main
from photomap_gis.live.flight import FlightRequest, open_flight
from photomap_gis.simulate import FlightSpec, run_simulation
from photomap_gis.store import Mission


def test_photos_of_two_strips_are_drawn_as_they_were(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between strips photos pause; what is newer is worth more, and feathered by that: a tenth of a second shows."""
    run_simulation("procedural", tmp_path / "sim", FlightSpec(frames=8, width_px=480, height_px=360, seed=4))
    photos, mission = str(tmp_path / "sim" / "photos"), str(tmp_path / "mission")
    assert main(["live", photos, "-o", mission, "--as-fast-as-possible", "--no-finalise", "--json"]) == 0
    capsys.readouterr()
    assert main(["replay", mission, "--json"]) == 0
    assert '"pixels_equal": true' in capsys.readouterr().out


def test_photos_that_came_out_of_order_fast_and_were_renamed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Watched in real time: none is dropped, the replay has them as they came, the final map finds them."""
    run_simulation("procedural", tmp_path / "sim", FlightSpec(frames=8, width_px=480, height_px=360, seed=4))
    photos = sorted((tmp_path / "sim" / "photos").glob("*.JPG"))
    source, mission = tmp_path / "watched", tmp_path / "mission"
    source.mkdir()
    with open_flight(FlightRequest(str(source), mission)) as flight:
        late, rest = photos[2], [p for p in photos if p is not photos[2]]
        for path in rest:
            (source / path.name).write_bytes(path.read_bytes())

        def then() -> None:
            waits, tally = threading.Event(), flight.session.loop.tally
            while tally.frames < len(rest):
                waits.wait(0.05)
            (source / late.name).write_bytes(late.read_bytes())  # taken third, comes last
            (source / photos[0].name).rename(source / "first.JPG")
            while tally.frames < len(photos) or not flight.session.pixels.renamed:
                waits.wait(0.05)
            flight.stop()

        threading.Thread(target=then, daemon=True).start()
        flight.fly()
        flight.land(lambda stage, done, total: None)
        tally = flight.session.loop.tally
    assert (tally.frames, tally.dropped, tally.tracked) == (8, 0, 8)
    with Mission.open(mission) as made:
        names = [Path(r.source).name for r in made.frames]
    assert names[0] == "first.JPG" and names[-1] == late.name and len(names) == 8
    assert main(["replay", str(mission), "--json"]) == 0
    assert '"pixels_equal": true' in capsys.readouterr().out
