"""Looks: four a second whatever the rate of frames, what moves is seen to move, nothing torn is pasted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from photomap_gis.core.grid import TileIndex
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.journal import FOLDER, JOURNAL
from photomap_gis.live.light import Light
from photomap_gis.live.look import PASTED_EVERY_S, LookClock
from photomap_gis.live.painter import Painter
from photomap_gis.simulate.breakage import Breakage, break_frame
from tests.live.conftest import Flown, frame_of
from tests.live.test_canvas import H, W, lattice, placement_at


@pytest.mark.parametrize("rate_hz", [8.0, 10.0, 15.0, 20.0, 24.0, 25.0, 29.97, 30.0, 50.0, 60.0])
def test_four_a_second_at_any_rate(rate_hz: float) -> None:
    clock, pasted = LookClock(), []
    for k in range(round(20 * rate_hz)):
        if clock.is_due(k / rate_hz):
            clock.pasted(k / rate_hz)
            pasted.append(k / rate_hz)
    gaps = np.diff(pasted)
    assert gaps.max() <= PASTED_EVERY_S + 1e-2
    assert gaps.min() > PASTED_EVERY_S - 1.0 / rate_hz - 1e-9  # and no more than it takes


def test_after_a_key_frame_none_is_due_for_a_while() -> None:
    clock = LookClock()
    assert clock.is_due(10.0)
    clock.pasted(10.0)
    assert not clock.is_due(10.0 + 1 / 30) and not clock.is_due(10.0 + 2 / 30)


def test_what_moves_is_seen_to_move(tmp_path: Path, rng: np.random.Generator) -> None:
    """Hovering: no key frame comes, and yet the newest picture is shown whole, and is seen just now."""
    ground = cv2.GaussianBlur(rng.integers(0, 255, (H, W, 3), np.uint8), (0, 0), 2)
    painter = Painter(LiveCanvas(lattice(), tmp_path), lambda k: ground)
    painter.paste(0, placement_at(0.0, 0.0), ground, 0.0)
    for n in range(1, 9):
        picture = ground.copy()
        cv2.rectangle(picture, (20 + 20 * n, 80), (50 + 20 * n, 95), (0, 0, 255), -1)
        assert painter.look(0, placement_at(0.0, 0.0), picture, 0.25 * n)
        plain = Painter(LiveCanvas(lattice(), tmp_path / "plain"), lambda k: ground)
        plain.paste(0, placement_at(0.0, 0.0), picture, 0.0)
        for tile in painter.canvas.tiles():
            window = painter.canvas.window_of(tile)
            got, wanted = (p.canvas.read(window, lambda t: t.rgba(), 0).astype(int) for p in (painter, plain))
            np.testing.assert_allclose(got, wanted, atol=10)  # the same picture; its light is evened a little
            seen = painter.canvas.read(window, lambda t: t.seen_s, -np.inf)
            assert (seen[got[..., 3] > 0] == np.float32(0.25 * n)).all()
    assert (painter.canvas.read(painter.canvas.window_of(tile), lambda t: t.shown, -1) <= 0).all()


class AsItIs(Light):
    """Noise has no brightness to be told: the light is left as it is."""

    def _ratio(self, sheet: object, canvas: object) -> float:
        return 1.0


def test_a_look_moves_with_its_key_frame_and_outlasts_drawing_anew(tmp_path: Path, rng: np.random.Generator) -> None:
    images = {k: rng.integers(0, 255, (H, W, 3), np.uint8) for k in range(2)}
    looked = rng.integers(0, 255, (H, W, 3), np.uint8)
    painter = Painter(LiveCanvas(lattice(), tmp_path), lambda k: images[k], light=AsItIs())
    for k in images:
        painter.paste(k, placement_at(60.0 * k, 0.0, frame=k), images[k], float(k))
    painter.look(1, placement_at(80.0, 0.0, frame=1), looked, 1.5)
    painter.adopt(lambda k: placement_at(60.0 * k + 40.0, 0.0, frame=k), [0, 1], 2)
    while painter.step():
        pass
    fresh = Painter(LiveCanvas(lattice(), tmp_path / "fresh"), lambda k: images[k], light=AsItIs())
    for k in images:
        fresh.paste(k, placement_at(60.0 * k + 40.0, 0.0, frame=k), images[k], float(k))
    fresh.look(1, placement_at(120.0, 0.0, frame=1), looked, 1.5)
    assert set(fresh.canvas.tiles()) <= set(painter.canvas.tiles())
    for tile in painter.canvas.tiles():
        window = painter.canvas.window_of(tile)
        got, wanted = (p.canvas.read(window, lambda t: t.rgba(), 0).astype(int) for p in (painter, fresh))
        np.testing.assert_allclose(got, wanted, atol=2)  # its light was evened where it was pasted first


def test_only_tiles_that_change_are_told_of(tmp_path: Path, rng: np.random.Generator) -> None:
    image = rng.integers(0, 255, (H, W, 3), np.uint8)
    painter = Painter(LiveCanvas(lattice(), tmp_path), lambda k: image)
    painter.paste(0, placement_at(0.0, 0.0), image, 100.0)
    painter.canvas.take_changed()
    versions = {t: painter.canvas.version_of(t) for t in painter.canvas.tiles()}
    painter.look(0, placement_at(0.0, 0.0), image, 0.0)  # as if it were much older: worth less everywhere
    assert painter.canvas.take_changed() == []
    assert {t: painter.canvas.version_of(t) for t in painter.canvas.tiles()} == versions
    everywhere = painter.canvas.extent()
    assert everywhere is not None
    assert painter.canvas.version_in(everywhere, seen=True) > painter.canvas.version_in(everywhere)
    assert painter.canvas.version_of(TileIndex(50, 50)) == 0


def test_a_flight_has_looks_and_its_journal_knows_them(fly, flown: Flown) -> None:
    flight = fly(frame_of(flown, k) for k in range(60))
    lines = [json.loads(line) for line in (flight.folder / FOLDER / JOURNAL).read_text().splitlines()]
    looks = [line["s"] for line in lines if line.get("look")]
    keys = [line["s"] for line in lines if line.get("key") is not None]
    assert flight.session.hand.looks == len(looks) > 0
    assert np.diff(sorted({*looks, *keys})).max() <= PASTED_EVERY_S + 1e-3


def test_a_torn_frame_is_not_pasted_as_a_look(fly, flown: Flown) -> None:
    """Of a hovering drone every third picture is torn by little: the map shows the sound ones."""
    rng = np.random.default_rng(2)
    torn = {k: break_frame(flown.images[10], None, Breakage.TEARING, rng) for k in range(2, 24, 3)}

    def events():
        for k in range(24):
            ref = replace(flown.refs[10], pts_s=k / 8.0)
            frame = frame_of(flown, 10, torn.get(k, flown.images[10]))
            yield replace(frame, ref=replace(ref, index=k, frame_number=k))

    flight = fly(events())
    painter = flight.session.hand.painter
    assert painter is not None
    sound = fly((f for n, f in enumerate(events()) if n not in torn), name="sound").session.hand.painter
    assert sound is not None
    for tile in sound.canvas.tiles():
        window = sound.canvas.window_of(tile)
        got, wanted = (p.canvas.read(window, lambda t: t.rgba(), 0).astype(int) for p in (painter, sound))
        assert np.abs(got - wanted).mean() < 2.0
