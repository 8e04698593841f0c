"""The files a user would believe come from a drone, and the truth beside them."""

import json
import math
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.simulate import FlightSpec, GpsError, Ground, Imaging, Motion, procedural_scene, read_truth
from photomap_gis.simulate.breakage import Breakage, break_frame
from photomap_gis.simulate.run import run_simulation
from photomap_gis.simulate.write import simulate_photos, simulate_video

SMALL = FlightSpec(
    frames=9, width_px=160, height_px=120, motion=Motion(tilt_deg=1.0), gps=GpsError(dropout_share=0.3), seed=2
)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return procedural_scene((90.0, 80.0), 0.25, seed=1)


@pytest.fixture(scope="module")
def flight(ground: Ground, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    simulate_photos(ground, SMALL, folder)
    return folder


def test_photos_carry_place_time_and_lens(flight: Path) -> None:
    truth = read_truth(flight)
    for frame in truth.frames:
        with Image.open(flight / "photos" / frame.name) as photo:
            assert photo.size == (160, 120)
            exif, xmp = photo.getexif(), photo.info["xmp"].decode()
        gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
        if frame.fix is None:
            assert not gps and "GpsLatitude" not in xmp
        else:
            d, m, s = (float(v) for v in gps[ExifTags.GPS.GPSLatitude])
            assert d + m / 60 + s / 3600 == pytest.approx(frame.fix.lat_deg, abs=5e-8)
            assert f'GpsLatitude="{frame.fix.lat_deg:+.7f}"' in xmp
        detail = exif.get_ifd(ExifTags.IFD.Exif)
        assert detail[ExifTags.Base.FocalLengthIn35mmFilm] == 23  # 24 mm by width is 23 mm by diagonal at 4:3
        assert detail[ExifTags.Base.DateTimeOriginal].startswith("2026:06:15 12:0")
        assert "RelativeAltitude" in xmp and "GimbalPitchDegree" in xmp
    assert sum(f.fix is None for f in truth.frames) == 3


def test_a_flight_that_reports_less_writes_less(ground: Ground, tmp_path: Path) -> None:
    spec = replace(SMALL, frames=1, report_attitude=False, report_height=False, report_calibration=False)
    simulate_photos(ground, spec, tmp_path)
    with Image.open(tmp_path / "photos" / "DJI_0001.JPG") as photo:
        xmp = photo.info["xmp"].decode()
    assert not any(word in xmp for word in ("Gimbal", "RelativeAltitude", "Calibrated"))


def test_the_truth_reads_back(flight: Path, ground: Ground) -> None:
    truth = read_truth(flight)
    assert truth.camera.focal_px == SMALL.camera.focal_px
    assert np.array_equal(truth.ground().colour, ground.colour)
    for f in truth.frames:
        r = f.pose.R_grid_camera
        assert np.allclose(r @ r.T, np.eye(3), atol=1e-9)
        assert len(f.footprint_en_m) == 16
    assert truth.spec["gps"]["walk_tau_s"] == 60.0


def test_no_truth_and_broken_truth_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"truth\.json"):
        read_truth(tmp_path)
    (tmp_path / "truth.json").write_text('{"version": 1}')
    with pytest.raises(DataError, match="cannot read"):
        read_truth(tmp_path)


def test_an_older_flight_is_not_mixed_with_a_new_one(flight: Path, ground: Ground) -> None:
    with pytest.raises(OutputError, match="not empty"):
        simulate_photos(ground, SMALL, flight)


def test_progress_counts_frames(ground: Ground, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    simulate_photos(ground, replace(SMALL, frames=2), tmp_path, on_progress=lambda d, n: seen.append((d, n)))
    assert seen == [(1, 2), (2, 2)]


def test_a_video_decodes_and_its_subtitles_count_its_frames(ground: Ground, tmp_path: Path) -> None:
    spec = replace(SMALL, frames=14, width_px=161, bitrate_bit_s=2_000_000, video_rate_hz=4.0)
    simulate_video(ground, spec, tmp_path)
    assert sorted(p.name for p in (tmp_path / "video").iterdir()) == ["DJI_0001.MP4", "DJI_0001.SRT"]
    with av.open(str(tmp_path / "video" / "DJI_0001.MP4")) as video:
        frames = list(video.decode(video=0))
        assert video.streams.video[0].codec_context.name == "h264"
        assert video.metadata["creation_time"].startswith("2026-06-15T10:00")
    assert len(frames) == 14
    assert (frames[0].width, frames[0].height) == (160, 120)
    assert float(frames[5].pts * frames[5].time_base) == pytest.approx(5 / 4.0)
    words = (tmp_path / "video" / "DJI_0001.SRT").read_text()
    assert words.count("[latitude:") == 14 and "[latitude: 0.000000]" in words and "gb_pitch: -8" in words


def test_a_thermal_camera_is_grey_and_flat(ground: Ground, tmp_path: Path) -> None:
    simulate_photos(ground, replace(SMALL, frames=1, imaging=Imaging(thermal=True)), tmp_path)
    image = cv2.imread(str(tmp_path / "photos" / "DJI_0001.JPG"), cv2.IMREAD_UNCHANGED)
    assert image.ndim == 2
    assert 3.0 < image.std() < 30.0


def test_error_frames_are_written_and_named(ground: Ground, tmp_path: Path) -> None:
    spec = replace(SMALL, frames=15, imaging=Imaging(error_share=0.4))
    truth = simulate_photos(ground, spec, tmp_path)
    broken = [f for f in truth.frames if f.breakage is not None]
    assert {f.breakage for f in broken} == set(Breakage)
    assert truth.frames[0].breakage is None
    again = read_truth(tmp_path)
    assert [f.breakage for f in again.frames] == [f.breakage for f in truth.frames]


@pytest.mark.parametrize("kind", list(Breakage))
@pytest.mark.parametrize("channels", [0, 3])
def test_each_breakage_changes_the_frame(rng: np.random.Generator, kind: Breakage, channels: int) -> None:
    shape = (96, 128, 3) if channels else (96, 128)
    image, previous = (rng.integers(0, 256, shape, dtype=np.uint8) for _ in range(2))
    broken = break_frame(image, previous, kind, rng)
    assert broken.shape == image.shape and broken.dtype == np.uint8
    assert (broken != image).mean() > 0.2
    if kind is Breakage.FROZEN:
        assert np.array_equal(broken, previous)


def test_the_word_procedural_makes_ground_to_measure(tmp_path: Path) -> None:
    spec = FlightSpec(frames=4, width_px=160, height_px=120, altitude_m=40.0, seed=7)
    result = run_simulation("procedural", tmp_path / "sim", spec)
    assert result.source == tmp_path / "sim" / "photos"
    assert len(list(result.source.iterdir())) == 4
    assert result.truth.gsd_m_per_px == pytest.approx(40.0 / (spec.camera.focal_px or 1), rel=0.1)
    document = json.loads((tmp_path / "sim" / "truth" / "truth.json").read_text())
    assert len(document["frames"]) == 4


def test_a_read_only_place_is_one_line(ground: Ground, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot write"):
        simulate_photos(ground, replace(SMALL, frames=1), tmp_path / "file")


def test_the_ordinary_ingest_reads_the_photos(flight: Path) -> None:
    sources = pytest.importorskip("photomap_gis.ingest.sources")
    from photomap_gis.ingest.options import IngestOptions

    footage = sources.open_sources([flight / "photos"], IngestOptions())
    truth = read_truth(flight)
    assert [Path(r.source).name for r in footage.frames] == [f.name for f in truth.frames]
    for ref, frame in zip(footage.frames, truth.frames, strict=True):
        assert ref.time_s == pytest.approx(frame.time_s, abs=0.01)
        assert ref.camera is not None and ref.camera.focal_px == pytest.approx(truth.camera.focal_px, rel=1e-3)
        assert (ref.fix is None) == (frame.fix is None)
        assert ref.attitude is not None
        turn = ref.attitude.R_ned_camera.T @ frame.pose.R_grid_camera
        angle = math.acos(min(1.0, (np.trace(turn) - 1.0) / 2.0))
        assert math.degrees(angle) < 0.35  # two decimals of a degree, and the grid's convergence of 0.28
        assert ref.height_m == pytest.approx(frame.pose.height_m, abs=2.5)
