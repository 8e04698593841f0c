"""The lists of pictures: disjoint by ground, honest about what is absent."""

import numpy as np
import pytest

from benchmarks.registration import pictures
from benchmarks.registration.pictures import (
    REPORTING,
    TUNING,
    Origin,
    find_sources,
    read_grey,
    read_scene,
    show_different_places,
)


def test_no_ground_is_on_both_sides():
    assert not {p.ground for p in TUNING} & {p.ground for p in REPORTING}
    assert not {p.where for p in TUNING} & {p.where for p in REPORTING}
    for part in (TUNING, REPORTING):
        assert len({p.name for p in part}) == len(part)


def test_scenes_are_even_here_and_odd_there():
    for part, remainder in ((TUNING, 0), (REPORTING, 1)):
        seeds = [int(p.where) for p in part if p.origin is Origin.SCENE]
        assert seeds and {s % 2 for s in seeds} == {remainder}


def test_what_is_absent_is_told_with_its_reason(monkeypatch, tmp_path):
    monkeypatch.setattr(pictures, "SHARED", tmp_path)
    monkeypatch.setattr(pictures.importlib.util, "find_spec", lambda name: None)
    sources = find_sources("tuning")
    assert {p.origin for p in sources.pictures} == {Origin.SCENE}
    reasons = {a.name: a.reason for a in sources.absent}
    assert set(reasons) == {p.ground for p in TUNING if p.origin is not Origin.SCENE}
    assert "../shared/data" in reasons["caliterra"] and "[bench]" in reasons["grass"]


def test_a_scene_is_made_once_and_has_its_heights_in_pixels(scenes):
    scene = read_scene(scenes.pictures[0])
    assert scene is read_scene(scenes.pictures[0])
    assert scene.grey.shape == scene.height_px.shape
    assert 10.0 < np.ptp(scene.height_px) * pictures.SCENE_GSD_M / 0.15 < 200.0


@pytest.mark.shared
@pytest.mark.parametrize("part", ["tuning", "reporting"])
def test_every_listed_photo_is_there_and_can_be_read(shared_data, part):
    sources = find_sources(part)
    assert not {a.name for a in sources.absent} & {p.ground for p in sources.pictures}
    for group in sources.groups:
        assert min(read_grey(group[0]).shape) >= 400


@pytest.mark.shared
def test_the_two_parts_of_seneca_have_no_ground_in_common(shared_data):
    south = [pictures.fix_deg(p) for p in TUNING if p.ground == "seneca"]
    north = [pictures.fix_deg(p) for p in REPORTING if p.ground == "seneca-north"]
    # a photo's diagonal is some 145 m, so half of two is that too
    assert (min(n for n, _ in north) - max(s for s, _ in south)) * 111_320.0 > 145.0


@pytest.mark.shared
def test_photos_of_one_flight_count_as_different_places_only_far_apart(shared_data):
    seneca = [p for p in TUNING if p.ground == "seneca"]
    assert not show_different_places(seneca[0], seneca[0])
    apart = [(p, q) for p in seneca[::5] for q in seneca[::5] if show_different_places(p, q)]
    assert apart
    caliterra = [p for p in TUNING if p.ground == "caliterra"]  # its fixes are not to be trusted so far
    assert not show_different_places(caliterra[0], caliterra[-1])
    assert show_different_places(seneca[0], caliterra[0])
