"""From frames to spectra: each frame's pixels are read once, levelled, made small, judged and kept on disk."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from threading import Lock

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import PlaneView
from photomap_gis.core.errors import FrameReadError, OutputError
from photomap_gis.core.frame import Frame, FrameRef, ImageArray
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import Fault, FrameLook, Spectrum, judge_frame, look_at, make_spectrum, make_working
from photomap_gis.ifmi.frames.verdict import GOOD
from photomap_gis.ifmi.working import shrink as shrink_grey
from photomap_gis.ifmi.working import to_grey
from photomap_gis.ingest import read_frame, read_frames
from photomap_gis.parallel import map_jobs
from photomap_gis.pipeline.neighbours import WorkingImages, judge_neighbours
from photomap_gis.pipeline.settings import MapSettings, Progress
from photomap_gis.publish import write_file
from photomap_gis.store import Mission, MissionPaths, PreparedFrame

logger = logging.getLogger(__name__)

_VIDEO_JPEG_QUALITY = 95  # the frames taken out of a video are what the map is rendered from


@dataclass(frozen=True, slots=True, eq=False)
class _Small:
    """A frame's raster made small, to be judged, and where its working image lies; or why there is none."""

    ref: FrameRef
    grey: ImageArray | None
    T_plane_work: Similarity2D
    reason: str | None
    is_suspect: bool = False


class SpectrumShelf:
    """Every frame's spectrum, made when it is first asked for; the least recently used ones are given up.

    Safe to share between threads. The working images lie in the mission folder, so giving a spectrum up costs a few
    milliseconds and no second look at the source.
    """

    def __init__(self, mission: Mission | MissionPaths, *, capacity: int = 160) -> None:
        self._mission = mission
        self._capacity = capacity
        self._spectra: OrderedDict[int, Spectrum] = OrderedDict()
        self._lock = Lock()

    def __getitem__(self, frame: int) -> Spectrum:
        """Return a frame's spectrum; raise ``FrameReadError`` where its working image is gone."""
        with self._lock:
            if frame in self._spectra:
                self._spectra.move_to_end(frame)
                return self._spectra[frame]
        grey, mask = load_working(self._mission, frame)
        spectrum = make_spectrum(grey, mask=mask, index=frame)
        with self._lock:
            self._spectra[frame] = spectrum
            while len(self._spectra) > self._capacity:
                self._spectra.popitem(last=False)
        return spectrum


def prepare_frames(
    mission: Mission,
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    settings: MapSettings,
    on_progress: Progress,
) -> dict[int, PreparedFrame]:
    """Judge every frame and keep its working image; frames prepared by an earlier run are not touched again.

    Each frame is judged by itself and against the last usable one before it, then once more registered to that one:
    what of it does not fit there is masked in its working image, and a frame of which too much is lost is not used.
    """
    prepared = {p.frame: p for p in mission.prepared}
    missing = [ref for ref in frames if ref.index not in prepared]

    def shrink(job: tuple[FrameRef, Frame | FrameReadError | None]) -> _Small:
        ref, content = job
        try:
            frame = read_frame(ref) if content is None else content
            if isinstance(frame, FrameReadError):
                raise frame
            if ref.frame_number is not None:
                keep_video_frame(mission, frame)
            work = make_working(frame.image, views[ref.index], size_px=settings.work_size_px)
        except FrameReadError as error:
            return _Small(ref, None, Similarity2D(), str(error))
        keep_working(mission, ref.index, work.grey, work.mask)
        # Judged is the raster as it came: levelling gives a sound frame straight, empty borders.
        raster = work.grey if work.mask is None else shrink_grey(to_grey(frame.image), settings.work_size_px)[0]
        return _Small(ref, raster, work.T_plane_work, None, frame.is_suspect)

    previous = _last_good(mission, frames, prepared, settings.work_size_px)
    done = len(frames) - len(missing)
    for small in map_jobs(shrink, _contents(missing), workers=settings.workers):
        flight = small.ref.flight
        if small.grey is None:
            record = PreparedFrame(small.ref.index, False, small.reason)
        else:
            look = look_at(small.grey)
            verdict = judge_frame(look, previous[1] if previous and previous[0] == flight else None)
            if small.ref.frame_number is None and verdict.fault in (Fault.BLURRED, Fault.FROZEN):
                verdict = (
                    GOOD  # a photo may differ much from the one before: whether it can be used, registration tells
                )
            record = PreparedFrame(small.ref.index, verdict.ok, verdict.reason, small.T_plane_work, small.is_suspect)
            if verdict.ok:
                previous = (flight, look)
        mission.prepared.append(record)
        prepared[record.frame] = record
        done += 1
        on_progress("read", done, len(frames))
    images = WorkingImages(partial(load_working, mission.paths), partial(keep_working, mission.paths))
    judge_neighbours(mission, frames, prepared, images, workers=settings.workers, scheduler=settings.scheduler,
                     on_progress=on_progress)  # fmt: skip
    return prepared


def _last_good(
    mission: Mission, frames: Sequence[FrameRef], prepared: Mapping[int, PreparedFrame], size_px: int
) -> tuple[int, FrameLook] | None:
    """Return flight and look of the newest usable frame of an earlier run: it helps to judge the next one."""
    for ref in reversed(frames):
        if ref.index in prepared and prepared[ref.index].usable:
            try:
                return ref.flight, look_at(shrink_grey(to_grey(read_pixels(mission, ref)), size_px)[0])
            except FrameReadError:
                return None
    return None


def read_pixels(mission: Mission | MissionPaths, ref: FrameRef) -> ImageArray:
    """Return a frame's pixels at full resolution, from the mission where it keeps them, else from the source."""
    kept = mission.video_frame_path(ref.index)
    if ref.frame_number is not None and kept.is_file():
        image = cv2.imdecode(np.fromfile(kept, dtype=np.uint8), cv2.IMREAD_COLOR)
        if image is not None:
            return np.asarray(image, dtype=np.uint8)
    return read_frame(ref).image


def _contents(refs: Sequence[FrameRef]) -> Iterator[tuple[FrameRef, Frame | FrameReadError | None]]:
    """Yield photos without their pixels (a worker opens them) and frames of a video with theirs (decoded in order)."""
    for is_video, group in groupby(refs, key=lambda r: r.frame_number is not None):
        if is_video:
            yield from read_frames(list(group))
        else:
            yield from ((ref, FrameReadError(ref.problem) if ref.problem else None) for ref in group)


def keep_video_frame(mission: Mission | MissionPaths, frame: Frame) -> None:
    """Keep a frame of a video in the mission: it is what the map is drawn from."""
    ok, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, _VIDEO_JPEG_QUALITY])
    if not ok:
        raise OutputError(f"cannot encode frame {frame.ref.name}")
    write_file(mission.video_frame_path(frame.ref.index), jpeg.tobytes())


def keep_working(
    mission: Mission | MissionPaths, frame: int, grey: ImageArray, mask: npt.NDArray[np.bool_] | None
) -> None:
    """Keep a frame's working image, and its mask where it has one."""
    # The mask, where there is one, is the second half of the picture's rows.
    picture = grey if mask is None else np.concatenate([grey, mask.astype(np.uint8) * 255])
    ok, png = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not ok:
        raise OutputError(f"cannot encode the working image of frame {frame}")
    path = mission.work_image_path(frame)
    write_file(path.with_suffix(".masked.png") if mask is not None else path, png.tobytes())


def load_working(mission: Mission | MissionPaths, frame: int) -> tuple[ImageArray, npt.NDArray[np.bool_] | None]:
    """Return a frame's working image and its mask; ``FrameReadError`` where it is gone."""
    path = mission.work_image_path(frame)
    masked = path.with_suffix(".masked.png")
    content = masked if masked.is_file() else path
    try:
        picture = cv2.imdecode(np.fromfile(content, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    except OSError:
        picture = None
    if picture is None:
        raise FrameReadError(f"{content} is missing or damaged: delete the mission folder and map again")
    image = np.asarray(picture, dtype=np.uint8)
    if content is path:
        return image, None
    half = image.shape[0] // 2
    return image[:half], image[half:] > 127
