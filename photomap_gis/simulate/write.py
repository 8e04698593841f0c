"""Simulate a flight into files: photos or a video that the ordinary ingest reads, and the truth apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from photomap_gis.core.errors import OutputError
from photomap_gis.core.frame import ImageArray
from photomap_gis.simulate.breakage import Breakage, break_frame, choose_breakages
from photomap_gis.simulate.flight import FlightPlan, Shot, Stream, fly
from photomap_gis.simulate.ground import Ground
from photomap_gis.simulate.photo_file import write_photo
from photomap_gis.simulate.render import FrameRenderer
from photomap_gis.simulate.sensor import Sensor
from photomap_gis.simulate.spec import FlightSpec
from photomap_gis.simulate.truth import TrueFrame, Truth, write_truth
from photomap_gis.simulate.video_file import VideoFile

Progress = Callable[[int, int], None]
PHOTO_FOLDER, VIDEO_FOLDER, TRUTH_FOLDER = "photos", "video", "truth"
VIDEO_NAME = "DJI_0001.MP4"


def simulate_photos(
    ground: Ground, spec: FlightSpec, out_dir: Path | str, *, on_progress: Progress | None = None
) -> Truth:
    """Fly over the ground, write ``photos/DJI_0001.JPG`` ... and ``truth/``; return the truth."""
    plan = fly(ground, spec)
    folder = _folder(Path(out_dir) / PHOTO_FOLDER)
    names = [f"DJI_{k + 1:04d}.JPG" for k in range(len(plan.shots))]
    breakages = choose_breakages(spec, len(plan.shots))
    with _writing(folder):
        for image, shot in render_flight(ground, spec, plan, breakages):
            write_photo(folder / names[shot.index], image, shot, spec)
            if on_progress is not None:
                on_progress(shot.index + 1, len(plan.shots))
    return _finished(ground, spec, plan, breakages, names, Path(out_dir))


def simulate_video(
    ground: Ground, spec: FlightSpec, out_dir: Path | str, *, on_progress: Progress | None = None
) -> Truth:
    """Fly over the ground, write ``video/DJI_0001.MP4`` with its ``.SRT`` and ``truth/``; return the truth."""
    plan = fly(ground, spec, video=True)
    folder = _folder(Path(out_dir) / VIDEO_FOLDER)
    stem = Path(VIDEO_NAME).stem
    names = [f"{stem}#{k:06d}" for k in range(len(plan.shots))]
    breakages = choose_breakages(spec, len(plan.shots))
    with _writing(folder), VideoFile(folder / VIDEO_NAME, spec, plan.shots[0].time_s) as video:
        for image, shot in render_flight(ground, spec, plan, breakages):
            video.add(image, shot)
            if on_progress is not None:
                on_progress(shot.index + 1, len(plan.shots))
    return _finished(ground, spec, plan, breakages, names, Path(out_dir))


def render_flight(
    ground: Ground, spec: FlightSpec, plan: FlightPlan, breakages: dict[int, Breakage]
) -> Iterator[tuple[ImageArray, Shot]]:
    """Yield each stored image with its shot, in order; one image is held at a time."""
    renderer, sensor = FrameRenderer(ground, spec.camera), Sensor(spec, plan.shots)
    rng = Stream.ERRORS.rng(spec.seed)
    rolling = spec.imaging.rolling_shutter_ms > 0
    last_whole: ImageArray | None = None
    for shot in plan.shots:
        light = renderer.render(shot.pose_first_row if rolling else shot.pose, shot.pose_last_row if rolling else None)
        image = sensor.expose(light, shot)
        kind = breakages.get(shot.index)
        if kind is None:
            last_whole = image
        else:
            image = break_frame(image, last_whole, kind, rng)
        yield image, shot


def _finished(
    ground: Ground, spec: FlightSpec, plan: FlightPlan, breakages: dict[int, Breakage], names: list[str], out: Path
) -> Truth:
    """Gather the truth and write it."""
    heights = ground.heights_at([(s.pose.easting_m, s.pose.northing_m) for s in plan.shots])
    # footprints on the land's level, not on the roof that happens to lie under the camera
    frames = tuple(
        TrueFrame(
            s.index, names[s.index], s.time_s, s.pose, float(heights[s.index]),
            s.pose.footprint_en_m(spec.camera, plan.take_off_height_m), s.fix, breakages.get(s.index),
        )
        for s in plan.shots
    )  # fmt: skip
    truth = Truth(out / TRUTH_FOLDER, ground.crs_wkt, spec.camera, frames, asdict(spec))
    write_truth(truth, ground)
    return truth


def _folder(path: Path) -> Path:
    """Make an empty folder: frames of an older, longer flight must not mix with the new ones."""
    with _writing(path):
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise OutputError(f"{path} is not empty: give another folder with -o, or remove it")
    return path


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write to {path}: {error.strerror or error}") from error
