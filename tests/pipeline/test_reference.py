"""A map laid on existing imagery of another season: where it lands, what is kept, what is said where nothing fits."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from photomap_gis.cli.app import cli
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.pipeline import MapSettings, MapSummary, map_flight, reference_mission, solve_again
from photomap_gis.simulate import FlightSpec, GpsError, Motion, Truth, procedural_scene, simulate_photos
from photomap_gis.simulate.evaluate import evaluate_map
from photomap_gis.simulate.season import Season, another_season, write_reference
from photomap_gis.store import Mission

pytestmark = pytest.mark.slow

SPEC = FlightSpec(
    frames=12, altitude_m=80.0, width_px=800, height_px=600, motion=Motion(tilt_deg=1.0), seed=5,
    gps=GpsError(bias_east_m=2.0, bias_north_m=-1.5),
)  # fmt: skip
SIZE_M, PIXEL_M = (240.0, 240.0), 0.16
RATIO = 4.0


class World(NamedTuple):
    """A flight, the imagery of another season, the mission by GPS alone, and the imagery's pixel."""

    truth: Truth
    reference: str
    by_gps: MapSummary
    gsd_m: float


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    now, then = (procedural_scene(SIZE_M, PIXEL_M, 5, sun_azimuth_deg=sun) for sun in (None, 90.0))
    truth = simulate_photos(now, SPEC, folder)
    gsd_m = RATIO * truth.gsd_m_per_px
    write_reference(another_season(then, Season(seed=5)), folder / "old.tif", gsd_m=gsd_m)
    return World(truth, folder / "old.tif", map_flight([folder / "photos"], folder / "m"), gsd_m)


@pytest.fixture
def mission(world, tmp_path):
    """A copy of the mission that a test may change."""
    folder = tmp_path / "m"
    shutil.copytree(world.by_gps.mission, folder)
    return folder


@pytest.fixture(scope="module")
def laid(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("laid") / "m"
    shutil.copytree(world.by_gps.mission, folder)
    return reference_mission(folder, [world.reference])


def test_the_map_lies_where_the_truth_is_within_two_pixels_of_the_reference(world, laid):
    before, after = (evaluate_map(s.map, world.truth.folder) for s in (world.by_gps, laid))
    assert before.absolute_rmse_m > 1.5
    assert after.absolute_rmse_m <= 2 * world.gsd_m
    assert after.absolute_rmse_m < 0.35 * before.absolute_rmse_m
    assert after.relative_rmse_m < 1.2 * before.relative_rmse_m + 0.02
    assert after.coverage > 0.98


def test_the_prediction_holds_the_references_own_error(world, laid):
    """A map is no surer than what it lies on, however many frames agree."""
    sigma = laid.references[0].sigma_m
    assert sigma == pytest.approx(world.gsd_m, rel=0.01)
    assert laid.predicted_ce90_m < 0.6 * world.by_gps.predicted_ce90_m
    assert laid.predicted_ce90_m > 2.146 * sigma * 0.7
    errors = evaluate_map(laid.map, world.truth.folder)
    assert errors.absolute_rmse_m < laid.predicted_ce90_m


def test_what_came_of_it_is_told_and_kept(world, laid):
    document = json.loads(json.dumps(laid.as_document()))
    (told,) = document["references"]
    assert told["ties"] >= 8
    assert told["ties"] <= told["places"] <= 12
    assert not [w for w in laid.warnings if "reference" in w]
    with Mission.open(world.truth.folder.parent / "m") as untouched:
        assert untouched.references == ()
    with Mission.open(laid_folder(laid)) as kept:
        (ties,) = kept.references
    assert len(ties.kept) == told["ties"]
    assert {len(t.xy_px) for t in ties.ties} == {4}


def laid_folder(summary):
    return Path(summary.mission)


def test_mapping_with_the_reference_is_the_same_as_laying_the_map_on_it_later(world, laid, tmp_path):
    settings = MapSettings(references=(str(world.reference),))
    photos = world.truth.folder.parent / "photos"
    at_once = map_flight([photos], tmp_path / "m", settings)
    assert at_once.references == laid.references
    assert at_once.bounds == pytest.approx(laid.bounds, abs=0.3)
    again = map_flight([photos], tmp_path / "m", settings)
    assert again.bounds == at_once.bounds
    assert again.predicted_ce90_m == pytest.approx(at_once.predicted_ce90_m)


def test_a_reference_is_not_measured_twice(world, laid, monkeypatch):
    def never(*_, **__):
        raise AssertionError("it was compared again")

    monkeypatch.setattr("photomap_gis.pipeline.reference.find_ties", never)
    again = reference_mission(laid_folder(laid), [world.reference])
    assert again.references == laid.references
    assert again.bounds == laid.bounds


def test_imagery_of_another_ground_leaves_the_map_as_it_was(world, mission, tmp_path):
    other = procedural_scene(SIZE_M, PIXEL_M, 77)
    write_reference(another_season(other), tmp_path / "other.tif", gsd_m=world.gsd_m)
    s = reference_mission(mission, [tmp_path / "other.tif"])
    assert [w for w in s.warnings if "other.tif" in w and "could be matched" in w and "as without it" in w]
    assert s.references[0].ties == 0
    assert s.bounds == world.by_gps.bounds
    assert s.predicted_ce90_m == pytest.approx(world.by_gps.predicted_ce90_m)


def test_imagery_of_elsewhere_says_that_it_does_not_show_the_map(world, mission, tmp_path):
    far = procedural_scene(SIZE_M, PIXEL_M, 7, origin_lat_lon=(48.0, 9.0))
    write_reference(far, tmp_path / "far.tif", gsd_m=world.gsd_m)
    s = reference_mission(mission, [tmp_path / "far.tif"])
    assert [w for w in s.warnings if "far.tif" in w and "does not show the ground" in w]
    assert s.bounds == world.by_gps.bounds


def test_the_command_says_what_it_did(world, mission):
    result = CliRunner().invoke(
        cli, ["reference", str(mission), str(world.reference), "-q", "--reference-sigma", "0.9"]
    )
    assert result.exit_code == 0, result.output
    assert "reference  old.tif" in result.output
    assert "0.90 m of its own error" in result.output


def test_what_cannot_be_used_is_refused_before_anyone_waits(world, mission, tmp_path):
    with pytest.raises(DataError, match="no such reference"):
        map_flight([world.truth.folder.parent / "photos"], tmp_path / "new",
                   MapSettings(references=(str(tmp_path / "absent.tif"),)))  # fmt: skip
    assert not (tmp_path / "new").exists()
    with pytest.raises(DataError, match="no such reference"):
        reference_mission(mission, [tmp_path / "absent.tif"])
    with pytest.raises(UsageError, match="positive"):
        reference_mission(mission, [world.reference], sigma_m=-1.0)


class Lost(NamedTuple):
    """A flight without any metadata, and imagery of a much larger ground around it."""

    truth: Truth
    photos: Path
    reference: Path
    gsd_m: float


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lost")
    now, then = (procedural_scene((420.0, 420.0), 0.2, 9, sun_azimuth_deg=sun) for sun in (None, 90.0))
    write_reference(another_season(then, Season(seed=9)), folder / "old.tif", gsd_m=0.5)
    row, col, side = 700, 250, 1300
    part = np.s_[row : row + side, col : col + side]
    flown = replace(
        now, colour=now.colour[part].copy(), height_m=now.height_m[part].copy(),
        west=now.west + col * 0.2, north=now.north - row * 0.2,
    )  # fmt: skip
    spec = replace(SPEC, frames=14, altitude_m=60.0, width_px=640, height_px=480, headings_deg=(37.0,), seed=9)
    truth = simulate_photos(flown, spec, folder)
    bare = folder / "bare"
    bare.mkdir()
    for photo in sorted((folder / "photos").glob("*.JPG")):
        with Image.open(photo) as picture:
            picture.save(bare / photo.name, quality=92)
    return Lost(truth, bare, folder / "old.tif", 0.5)


def test_a_map_without_positions_is_found_in_the_whole_of_the_imagery(lost, tmp_path):
    s = map_flight([lost.photos], tmp_path / "m", MapSettings(references=(str(lost.reference),)))
    assert s.georeferenced
    assert s.crs == "EPSG:32632"
    errors = evaluate_map(s.map, lost.truth.folder)
    # Nothing is known of the lens and its lean: the map is not better in itself than that allows.
    assert errors.absolute_rmse_m <= 2 * lost.gsd_m
    again = map_flight([lost.photos], tmp_path / "m", MapSettings(references=(str(lost.reference),)))
    assert again.bounds == s.bounds
    solved = solve_again(tmp_path / "m")  # its ties are all that places it, and they are kept
    assert solved.georeferenced
    assert solved.bounds == s.bounds


def test_a_map_that_is_nowhere_in_the_imagery_stays_relative(lost, world, tmp_path):
    folder = tmp_path / "m"
    assert not map_flight([lost.photos], folder).georeferenced
    s = reference_mission(folder, [world.reference])
    assert not s.georeferenced
    assert [w for w in s.warnings if "was not found in it" in w]
    found = reference_mission(folder, [lost.reference])
    assert found.georeferenced
    assert evaluate_map(found.map, lost.truth.folder).absolute_rmse_m <= 2 * lost.gsd_m
