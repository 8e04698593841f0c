"""Ground control through the whole corridor: control and check points, picks, nudges, missions solved again."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from photomap_gis.core.accuracy import PointMiss, predicted_sigma_m
from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.core.control import ControlPoint, Sighting
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import FrameRef
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import FramePlacement, PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.georef import crs_to_lonlat, plane_view, resolve_crs
from photomap_gis.pipeline import ControlRequest, Pick, export_mission, georeference, map_flight, solve_again
from photomap_gis.pipeline.control import ControlResult, control_observations, misses_its_points, moved
from photomap_gis.pipeline.deliver import Format
from photomap_gis.pipeline.solved import Solved
from photomap_gis.simulate import Truth
from photomap_gis.simulate.evaluate import evaluate_map
from photomap_gis.simulate.geodesy import GeoFrame
from photomap_gis.store import ControlRecord, Mission

UTM = resolve_crs("EPSG:32632")


def ground_points(truth: Truth, count: int = 9) -> np.ndarray:
    """``(count, 3)`` easting, northing, height of points all over the flight, on the ground as surveyors have them."""
    centres = np.array([(f.pose.easting_m, f.pose.northing_m) for f in truth.frames])
    level = np.median([f.ground_height_m for f in truth.frames])
    rng, ground = np.random.default_rng(11), truth.ground()
    found = []
    for centre in centres[np.linspace(0, len(centres) - 1, count).astype(int)]:
        near = centre + rng.uniform(-12, 12, (40, 2))
        heights = ground.heights_at(near)
        found.append([*near[k := int(np.argmin(np.abs(heights - level)))], heights[k]])
    return np.array(found)


def control_list(truth: Truth, path: Path, *, wrong: str | None = None, click_px: float = 0.3) -> Path:
    """Write what a surveyor and a patient person would: P1, P2, ... with up to three pictures each."""
    rng = np.random.default_rng(12)
    lines = ["WGS84 UTM 32N"]
    for n, (e, north, height) in enumerate(ground_points(truth), start=1):
        given = (e + (25.0 if wrong == f"P{n}" else 0.0), north)
        for frame in truth.frames:
            px = frame.pose.project(truth.camera, [[e, north, height]])[0]
            middle = np.abs(px - truth.camera.principal_xy_px) / (truth.camera.width_px, truth.camera.height_px)
            if np.isfinite(px).all() and middle.max() < 0.4 and sum(f" P{n}" in line for line in lines) < 3:
                x, y = px + rng.normal(0, click_px, 2)
                lines.append(f"{given[0]:.3f} {given[1]:.3f} {height:.2f} {x:.2f} {y:.2f} {frame.name} P{n}")
    path.write_text("\n".join(lines) + "\n")
    return path


def strip_gps(folder: Path, out: Path) -> Path:
    """Copy photos with the lens but without GPS."""
    out.mkdir()
    for photo in sorted(folder.glob("*.JPG")):
        with Image.open(photo) as picture:
            picture.save(out / photo.name, quality=92)
    return out


@pytest.fixture
def mission(mapped, tmp_path):
    """A copy of the mapped mission that a test may change."""
    folder = tmp_path / "mission"
    shutil.copytree(mapped.folder, folder)
    return folder


def by_name(summary):
    return {r.miss.name: r for r in summary.control}


def test_control_points_pull_a_map_with_gps_and_check_points_test_it(flown, mapped, mission, tmp_path):
    gcp = control_list(flown.truth, tmp_path / "gcp_list.txt", wrong="P5")
    registrations = (mission / "registrations.jsonl").read_bytes()
    summary = solve_again(mission, ControlRequest(gcp, check=("every-third",)))
    assert (mission / "registrations.jsonl").read_bytes() == registrations
    document = json.loads(json.dumps(summary.as_document()))
    accuracy = document["accuracy"]
    assert accuracy["n"] == 3
    assert accuracy["rmse_r_m"] < 0.3 < mapped.summary.predicted_ce90_m
    assert accuracy["nssda_95_m"] == pytest.approx(1.7308 * accuracy["rmse_r_m"])
    assert "20 or more" in accuracy["method"]
    assert 0.01 < accuracy["nees_per_dof"] < 3, "three points are few: they may all be lucky"
    roles = {p["name"]: (p["role"], p["used"]) for p in document["control"]["points"]}
    assert roles["P3"] == roles["P6"] == roles["P9"] == ("check", False)
    assert roles["P5"] == ("control", False)
    assert all(roles[f"P{n}"] == ("control", True) for n in (1, 2, 4, 7, 8))
    (word,) = [w for w in summary.warnings if "P5" in w]
    assert "misses the map by 2" in word
    assert by_name(summary)["P5"].miss.east_m == pytest.approx(-25.0, abs=0.5)
    errors = evaluate_map(summary.map, flown.truth.folder)
    assert errors.absolute_rmse_m < 0.35
    with rasterio.open(summary.map) as raster:
        tags = raster.tags()
    assert tags["CHECK_POINTS"] == "3"
    assert tags["CONTROL_POINTS"] == "5"
    assert float(tags["CHECK_NSSDA_95_M"]) == pytest.approx(accuracy["nssda_95_m"], abs=1e-3)
    assert (mission / "control-points.txt").read_text() == gcp.read_text()
    # what the mission keeps gives the same again, and an export knows it too
    again = map_flight([flown.photos], mission)
    assert again.control == summary.control
    (out,) = export_mission(mission, [Format.GEOTIFF], out=tmp_path / "again.tif")
    with rasterio.open(out) as raster:
        assert raster.tags()["CHECK_RMSE_R_M"] == tags["CHECK_RMSE_R_M"]
    other = solve_again(mission, ControlRequest(check=("P1",)))
    assert [r.miss.name for r in other.control if r.check] == ["P1"]
    with Mission.open(mission) as kept:
        trajectory = Solved.load(kept).trajectory
    sigma = predicted_sigma_m(trajectory, [trajectory.placements[5].centre_xy_map_m, [1e6, 1e6]])
    assert 0.005 < sigma[0] < 0.3
    assert np.isnan(sigma[1])


def test_a_map_without_gps_gets_its_place_from_control_points(flown, tmp_path):
    photos = strip_gps(flown.photos, tmp_path / "bare")
    gcp = control_list(flown.truth, tmp_path / "gcp_list.txt")
    summary = map_flight([photos], tmp_path / "m", control=ControlRequest(gcp, check=("P2", "P6")))
    assert summary.georeferenced
    assert summary.crs == "EPSG:32632"
    assert summary.as_document()["accuracy"]["rmse_r_m"] < 0.6
    assert summary.fit_to_gps_rms_m is None
    assert evaluate_map(summary.map, flown.truth.folder).absolute_rmse_m < 0.6
    assert (tmp_path / "m" / "map.kmz").is_file()


def test_picks_place_a_relative_map_without_registering_again(flown, tmp_path):
    photos = strip_gps(flown.photos, tmp_path / "bare")
    folder = tmp_path / "m"
    relative = map_flight([photos], folder)
    assert not relative.georeferenced
    registrations = (folder / "registrations.jsonl").read_bytes()
    with Mission.open(folder) as kept:
        solved = Solved.load(kept)
    refs, trues = {f.index: f for f in solved.frames}, {f.name: f for f in flown.truth.frames}
    picks = []
    for p in (solved.trajectory.placements[0], solved.trajectory.placements[-1]):
        px = p.centre_xy_px + np.array([30.0, -20.0])
        x, y = solved.map_frame.to_crs(p.camera_to_map.project(px))[0]
        true = trues[refs[p.frame].name]
        en = true.pose.ground_points(flown.truth.camera, px, true.ground_height_m)
        ((lon, lat),) = GeoFrame(flown.truth.crs_wkt).to_lon_lat(en)
        picks.append(Pick(float(x), float(y), float(lat), float(lon)))
    with pytest.raises(UsageError, match="two or more"):
        georeference(folder, picks=picks[:1])
    with pytest.raises(UsageError, match="two or more"):
        georeference(folder, picks=[picks[0], replace(picks[1], check=True)])
    with pytest.raises(UsageError, match="not on the map"):
        georeference(folder, picks=[picks[0], Pick(1e7, 1e7, 53.0, 8.0)])
    with pytest.raises(UsageError, match="--pick or --gcp"):
        georeference(folder, nudge=(1.0, 1.0, 0.0))
    assert not solve_again(folder).georeferenced, "what was refused has left nothing behind"
    placed = georeference(folder, picks=picks)
    assert placed.georeferenced
    assert (folder / "registrations.jsonl").read_bytes() == registrations
    assert not (folder / "map-1.tif").exists()
    errors = evaluate_map(placed.map, flown.truth.folder)
    assert errors.absolute_rmse_m < 2.0
    assert all(r.used and r.miss.miss_m < 0.3 for r in placed.control)
    assert solve_again(folder).control == placed.control


def test_a_check_pick_tells_what_the_map_misses_and_does_not_bend_it(mapped, mission):
    with Mission.open(mission) as kept:
        solved = Solved.load(kept)
    picks = []
    for p, east_m, check in zip(solved.trajectory.placements[::4], (0.0, 0.0, 5.0), (False, False, True), strict=False):
        x, y = solved.map_frame.to_crs(p.camera_to_map.project(p.centre_xy_px))[0]
        ((lon, lat),) = crs_to_lonlat(solved.map_frame.crs_wkt, np.array([[x + east_m, y]]))
        picks.append(Pick(float(x), float(y), float(lat), float(lon), check=check))
    summary = georeference(mission, picks=picks)
    assert [(r.miss.name, r.check, r.used) for r in summary.control] == [
        ("pick-1", False, True), ("pick-2", False, True), ("check-1", True, False)
    ]  # fmt: skip
    assert summary.control[2].miss.east_m == pytest.approx(-5.0, abs=0.3), "map minus given place"
    assert max(r.miss.miss_m for r in summary.control[:2]) < 0.5
    assert summary.as_document()["accuracy"]["n"] == 1
    assert georeference(mission, reset=True).control == ()


def test_a_nudge_moves_the_map_and_later_solves_keep_it(mapped, mission):
    def centres():
        with Mission.open(mission) as kept:
            return np.array([p.centre_xy_map_m for p in Solved.load(kept).trajectory.placements])

    before = centres()
    summary = georeference(mission, nudge=(3.0, -2.0, 0.0))
    np.testing.assert_allclose(centres() - before, np.broadcast_to((3.0, 2.0), before.shape), atol=1e-3)
    assert summary.as_document()["nudges"][0]["east_m"] == 3.0
    west, _, _, north = summary.bounds
    assert west - mapped.summary.bounds[0] == pytest.approx(3.0, abs=0.2)
    assert north - mapped.summary.bounds[3] == pytest.approx(-2.0, abs=0.2)
    solve_again(mission)
    np.testing.assert_allclose(centres() - before, np.broadcast_to((3.0, 2.0), before.shape), atol=1e-3)
    georeference(mission, nudge=(-3.0, 2.0, 90.0))
    turned, middle = centres(), (before.min(axis=0) + before.max(axis=0)) / 2
    d = before - middle
    np.testing.assert_allclose(turned - middle, np.stack([-d[:, 1], d[:, 0]], axis=1), atol=2e-3)  # east turns south
    georeference(mission, reset=True)
    np.testing.assert_allclose(centres(), before, atol=1e-6)


def test_what_cannot_be_used_is_told_and_changes_nothing(flown, mission, tmp_path):
    gcp = control_list(flown.truth, tmp_path / "gcp_list.txt")
    solution = (mission / "solution.json").read_bytes()

    def refused(text, message, check=None, error=DataError):
        path = tmp_path / "bad.txt"
        path.write_text(text)
        with pytest.raises(error, match=message):
            solve_again(mission, ControlRequest(path, check=check))

    refused("EPSG:99999\n1 2 3 4 5 a.jpg\n", "bad.txt: .*no coordinate reference system")
    refused(gcp.read_text().replace(".JPG", ".PNG"), "none of the pictures")
    refused("name,lat,lon\nA,53,8\n", "where its points are seen")
    refused(gcp.read_text().replace("32N", "33N"), "km from the flight")
    refused(gcp.read_text(), "no such control point", check=("P77",), error=UsageError)
    with pytest.raises(UsageError, match="--gcp FILE"):
        solve_again(mission, ControlRequest(check=("P1",)))
    with pytest.raises(UsageError, match="--pick"):
        georeference(mission)
    with pytest.raises(DataError, match="no mission folder"):
        solve_again(tmp_path / "nowhere")
    assert (mission / "solution.json").read_bytes() == solution
    assert not Mission.open(mission).load_control().points
    frames = mission / "frames.jsonl"
    frames.write_text(frames.read_text().replace(str(flown.photos), "/gone"))
    with pytest.raises(DataError, match="no longer where they were"):
        solve_again(mission)


def test_pixels_of_a_picture_of_another_size_are_told(flown, mission, tmp_path):
    lines = control_list(flown.truth, tmp_path / "gcp_list.txt").read_text().splitlines()
    cells = lines[1].split()
    cells[3] = "5000"
    path = tmp_path / "scaled.txt"
    path.write_text("\n".join([lines[0], " ".join(cells), *lines[2:]]))
    summary = solve_again(mission, ControlRequest(path))
    assert any("another size" in w for w in summary.warnings)


def test_control_of_another_place_leaves_no_trace_in_a_new_mission(flown, tmp_path):
    gcp = control_list(flown.truth, tmp_path / "gcp_list.txt")
    gcp.write_text(gcp.read_text().replace("32N", "33N"))
    with pytest.raises(DataError, match="km from the flight"):
        map_flight([flown.photos], tmp_path / "m", control=ControlRequest(gcp))
    assert not (tmp_path / "m" / "control.json").exists()


def test_a_check_point_marked_wrongly_in_one_picture_is_told(flown, mission, tmp_path):
    lines = control_list(flown.truth, tmp_path / "gcp_list.txt").read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if line.endswith(" P3"))
    cells = lines[row].split()
    cells[3] = str(float(cells[3]) + 60.0)
    lines[row] = " ".join(cells)
    (tmp_path / "gcp_list.txt").write_text("\n".join(lines))
    warnings = solve_again(mission, ControlRequest(tmp_path / "gcp_list.txt", check=("P3", "P6"))).warnings
    assert any(w.startswith(f"check point P3 as marked in {cells[5]} and in ") for w in warnings)
    assert not any("P6" in w for w in warnings)


def test_pictures_are_found_by_name_path_or_index():
    def frame(index, source, **more):
        return FrameRef(index, more.pop("name", Path(source).name), source, 10, 10, **more)

    frames = [
        frame(0, "/card/100/A.JPG", name="100/A.JPG"),
        frame(1, "/card/101/A.JPG", name="101/A.JPG"),
        frame(2, "/card/B.jpg"),
        frame(3, "/v/flight.mp4", name="flight#000030", frame_number=30),
    ]
    wanted = {"b.JPG": 2, "x/B.jpg": 2, "101/a.jpg": 1, "card/100/A.JPG": 0, "A.JPG": None, "#3": 3, "#9": None}
    wanted |= {"flight#000030": 3, "flight.mp4": None, "C.JPG": None}
    for image, index in wanted.items():
        point = ControlPoint("p", "EPSG:4326", 8.0, 53.0, sightings=(Sighting(image, (5.0, 5.0)),))
        views = {f.index: plane_view(f) for f in frames}
        found, words = control_observations(ControlRecord((point,)), frames, views, MapFrame(UTM), ())
        assert [o.frame for o in found] == ([] if index is None else [index]), image
        assert bool(words) == (index is None)


@given(
    angle=st.floats(-3.0, 3.0), shift=st.tuples(st.floats(-40, 40), st.floats(-40, 40)), px=st.floats(0.0, 199.0),
)  # fmt: skip
def test_a_moved_map_shows_everything_elsewhere_and_alike(angle, shift, px):
    motion = Similarity2D(*shift, angle)
    camera = Camera(200, 100, 180.0)
    level = np.diag([4.0, 9.0, 1.0, 1e-4, 1e-4, 4e-4])
    slope = HeightField((-60.0, -60.0), 10.0, np.add.outer(np.zeros(13), np.linspace(-2, 2, 13)), 0.1)
    frames = [
        FramePlacement(0, 200, 100, PlanePlacement(PlaneView.flat(camera), Similarity2D(3, 4, 0.2, -2)), np.eye(4)),
        FramePlacement(
            1, 200, 100, PosedPlacement(camera, np.array([2.0, 1.0, 50.0]), np.eye(3), HeightField.level(0.2)), level
        ),
        FramePlacement(2, 200, 100, PosedPlacement(camera, np.array([2.0, 1.0, 50.0]), np.eye(3), slope), level),
    ]
    turn = motion.linear
    there = moved(Trajectory(tuple(frames), 4), motion)
    assert there.revision == 4
    for before, after, close in zip(frames, there.placements, (1e-9, 1e-9, 0.05), strict=True):
        at = [[px, 40.0]]
        np.testing.assert_allclose(
            after.camera_to_map.project(at), motion.apply(before.camera_to_map.project(at)), atol=close
        )
        expected = turn @ before.position_covariance_m2(at)[0] @ turn.T
        np.testing.assert_allclose(after.position_covariance_m2(at)[0], expected, atol=max(close, 1e-6) * 2)


def test_a_solution_that_misses_its_points_is_told_from_one_that_says_so():
    def results(miss_m, sigma_m, check=False):
        return [ControlResult(PointMiss(name, miss_m, 0.0, sigma_m, 1.0), check, not check) for name in "abc"]

    assert misses_its_points(results(1.5, 0.25), results(0.3, 0.3))
    assert not misses_its_points(results(1.5, 0.8), results(0.3, 0.3)), "it says so"
    assert not misses_its_points(results(1.5, 0.25), results(1.2, 0.3)), "the other is no better"
    assert not misses_its_points(results(1.5, 0.25, check=True), results(0.3, 0.3, check=True)), "never by check points"


def test_one_point_alone_places_nothing_and_says_so(flown, tmp_path):
    photos = strip_gps(flown.photos, tmp_path / "bare")
    lines = control_list(flown.truth, tmp_path / "gcp_list.txt").read_text().splitlines()
    (tmp_path / "one.txt").write_text("\n".join(line for line in lines if line.endswith(("32N", " P1"))))
    summary = map_flight([photos], tmp_path / "m", control=ControlRequest(tmp_path / "one.txt"))
    assert not summary.georeferenced
    assert any("two or more are needed" in w for w in summary.warnings)
