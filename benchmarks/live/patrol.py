"""A long flight out of a short video: flown lap after lap, each beside the one before, over ground that is another.

Mirrored and turned to its negative, a ground is one that registration does not know: four grounds come of one. Every
fifth lap shows the first again, at a place of its own or (``rounds``) where it lay: then the drone has come back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from photomap_gis.core.frame import Attitude, FrameRef, GpsFix, ImageArray
from photomap_gis.core.live import EndReason, LiveFrame, Picture, StreamEnd, StreamEvent
from photomap_gis.ingest import IngestOptions, open_sources
from photomap_gis.ingest.stream import open_stream
from photomap_gis.ingest.stream.picture import ArrayPicture
from photomap_gis.simulate import FlightSpec, read_truth
from photomap_gis.simulate.flight import Shot
from photomap_gis.simulate.video_file import VideoFile, srt_entry

from .flights import RATE_HZ

GROUNDS = 4
ASIDE_M = 400.0
"""How far east of the one before a lap is flown."""
START_UNIX_S = 1_781_517_600.0
_M_PER_DEG = math.pi * 6378137.0 / 180.0


@dataclass(frozen=True, slots=True)
class Lap:
    """How a lap's ground differs from the video's, and how far aside it lies."""

    mirrored: bool
    negative: bool
    aside_m: float

    @classmethod
    def of(cls, number: int, *, rounds: bool) -> Lap:
        """Return the lap of this number, from 0."""
        ground = number % GROUNDS
        return cls(ground % 2 == 1, ground >= 2, ASIDE_M * (ground if rounds else number))

    def image(self, image: ImageArray) -> ImageArray:
        """Return the picture of this lap's ground."""
        out = cv2.flip(image, 1) if self.mirrored else image
        return np.asarray(cv2.bitwise_not(out) if self.negative else out, np.uint8)

    def picture(self, picture: Picture) -> Picture:
        """Return the same of a live picture; the video's own costs nothing."""
        return ArrayPicture(self.image(picture.bgr)) if self.mirrored or self.negative else picture

    def placed(self, ref: FrameRef, home: GpsFix) -> FrameRef:
        """Return a frame's ref where this lap lies: mirrored about the meridian of ``home``, then moved aside."""
        fix, attitude = ref.fix, ref.attitude
        if fix is not None:
            aside_deg = self.aside_m / (_M_PER_DEG * math.cos(math.radians(home.lat_deg)))
            east_deg = (fix.lon_deg - home.lon_deg) * (-1.0 if self.mirrored else 1.0)
            fix = replace(fix, lon_deg=home.lon_deg + east_deg + aside_deg)
        if attitude is not None and self.mirrored:
            attitude = replace(attitude, yaw_rad=-attitude.yaw_rad, roll_rad=-attitude.roll_rad)
        return replace(ref, fix=fix, attitude=attitude)


class Patrol:
    """A file's frames lap after lap, as fast as they are taken (a ``FrameSource``).

    ``on_frame`` hears the number of each before it is handed out.
    """

    name, is_live, started_utc_s = "patrol", False, None

    def __init__(
        self, video: Path, frames: int, *, rounds: bool = False, on_frame: Callable[[int], None] = lambda number: None
    ) -> None:
        self._video, self._frames, self._rounds, self._on_frame = video, frames, rounds, on_frame
        self._closed = False

    def __iter__(self) -> Iterator[StreamEvent]:
        known = {r.frame_number: r for r in open_sources([self._video], IngestOptions(frame_rate_hz=1000.0)).frames}
        home = next(r.fix for r in known.values() if r.fix is not None)
        count = lap = 0
        while count < self._frames and not self._closed:
            way = Lap.of(lap, rounds=self._rounds)
            for event in open_stream(str(self._video), realtime=False):
                if not isinstance(event, LiveFrame):
                    continue
                if count >= self._frames or self._closed:
                    break
                self._on_frame(count)
                at_s = count / RATE_HZ
                ref = replace(
                    known[event.ref.frame_number],
                    index=count,
                    frame_number=count,
                    pts_s=at_s,
                    time_s=START_UNIX_S + at_s,
                )
                yield LiveFrame(way.placed(ref, home), way.picture(event.picture), at_s)
                count += 1
            lap += 1
        yield StreamEnd(EndReason.END_OF_FILE, count / RATE_HZ, count / RATE_HZ)

    def close(self) -> None:
        """End it."""
        self._closed = True


def patrol_video(video: Path, home: Path, seconds: int) -> Path:
    """Return a recording of rounds over four grounds, made once out of a short video and kept in ``home``.

    Each ground is encoded once; laps are put together without coding them again.
    """
    made = home / "video" / video.name
    if made.is_file():
        return made
    made.parent.mkdir(parents=True, exist_ok=True)
    truth = read_truth(video.parents[1])
    spec = FlightSpec(**{k: v for k, v in truth.spec.items() if k in _PLAIN})
    refs = open_sources([video], IngestOptions(frame_rate_hz=1000.0)).frames
    home_fix = next(r.fix for r in refs if r.fix is not None)
    frames, start_s, pose = round(seconds * RATE_HZ), truth.frames[0].time_s, truth.frames[0].pose
    laps = [_encoded(video, home / f"ground-{n}.mp4", n, spec) for n in range(min(GROUNDS, -(-frames // len(refs))))]
    part = made.with_name(f"{made.name}.part")
    _put_together(laps, part, frames, len(refs), truth.frames[0].time_s)
    entries = []
    for n in range(frames):
        ref = Lap.of(n // len(refs), rounds=True).placed(refs[n % len(refs)], home_fix)
        attitude: Attitude | None = ref.attitude
        shot = Shot(n, start_s + n / RATE_HZ, pose, pose, pose, (0.0, 0.0), ref.fix, attitude, ref.height_m)
        entries.append(srt_entry(shot, spec, RATE_HZ))
    made.with_suffix(".SRT").write_text("\n".join(entries), encoding="utf-8")
    part.replace(made)
    for lap in laps:
        lap.unlink()
        lap.with_suffix(".SRT").unlink(missing_ok=True)
    return made


def _encoded(video: Path, out: Path, ground: int, spec: FlightSpec) -> Path:
    """Encode a video as it would be over another ground."""
    lap = Lap.of(ground, rounds=True)
    with VideoFile(out, spec, 0.0) as file:
        for event in open_stream(str(video), realtime=False):
            if isinstance(event, LiveFrame):
                shot = Shot(event.index, event.stream_time_s, *(None,) * 3, (0.0, 0.0), None, None, None)  # type: ignore[arg-type]
                file.add(lap.image(event.picture.bgr), shot)
    return out


def _put_together(laps: Sequence[Path], out: Path, frames: int, lap_frames: int, start_unix_s: float) -> None:
    """Copy the packets of laps one after the other, in rounds, until there are so many frames."""
    created = datetime.fromtimestamp(start_unix_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    with av.open(str(out), "w", format="mp4") as target:
        target.metadata["creation_time"] = created
        stream = None
        for n in range(-(-frames // lap_frames)):
            with av.open(str(laps[n % len(laps)])) as source:
                video = source.streams.video[0]
                if stream is None:
                    stream = target.add_stream_from_template(video)
                ticks = round(1.0 / (RATE_HZ * float(video.time_base or 1)))
                for packet in source.demux(video):
                    if packet.dts is None or packet.pts is None:
                        continue
                    if n * lap_frames + round(packet.pts / ticks) >= frames:
                        continue
                    packet.pts += n * lap_frames * ticks
                    packet.dts += n * lap_frames * ticks
                    packet.stream = stream
                    target.mux(packet)


_PLAIN: dict[str, Any] = dict.fromkeys(("width_px", "height_px", "video_rate_hz", "hfov_deg", "bitrate_bit_s"))
