"""From decoded frames and metadata to the values that a source yields: numbered, timed, with the camera they have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from av.error import FFmpegError

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import FrameRef, GpsFix
from photomap_gis.core.live import GapKind, LiveFrame, StreamFix, StreamGap
from photomap_gis.ingest.lenses import LensFacts, camera_for
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.stream.picture import DecodedPicture
from photomap_gis.ingest.stream.timeline import Moment, Timeline
from photomap_gis.ingest.telemetry.klv import UAS_KEY, packets_of, track_of_packets

_MAX_PENDING_BYTES = 1 << 18


class Delivery:
    """Numbers and times what one source decodes; owned by the thread that iterates."""

    def __init__(
        self, source: str, timeline: Timeline, options: IngestOptions, *, stem: str, lens: LensFacts | None = None
    ) -> None:
        self.source = source
        self.timeline = timeline
        self.index = 0
        self._options, self._stem, self._lens = options, stem, lens or LensFacts()
        self._camera: Camera | None = None
        self._pending = bytearray()

    def frames(
        self, decoded: Any, arrival_s: float, *, frame_number: int | None = None, moment: Moment | None = None,
        time_utc_s: float | None = None, source: str | None = None, is_suspect: bool = False,
    ) -> Iterator[LiveFrame | StreamGap]:  # fmt: skip
        """Yield a decoded frame, after what is to be told of the place at which it stands.

        ``moment`` is given by a recording, which knows the stream time; else the frame's time stamp tells it.
        """
        before_s = self.timeline.stream_time_s
        placed = self.timeline.place(pts_s(decoded), arrival_s) if moment is None else moment
        if placed.jump_s is not None:
            yield StreamGap(
                GapKind.TIME_JUMP, before_s, arrival_s,
                f"the stream's time stamps jumped by {placed.jump_s:+.3g} s; its time goes on by the clock of arrival",
            )  # fmt: skip
        width, height = decoded.width, decoded.height
        if self._camera is None or (self._camera.width_px, self._camera.height_px) != (width, height):
            if self._camera is not None:
                was = f"{self._camera.width_px} x {self._camera.height_px}"
                yield StreamGap(
                    GapKind.SIZE_CHANGED, before_s, arrival_s, f"frames are {width} x {height} from here on, not {was}"
                )
            self._camera = camera_for(
                width, height, self._lens, hfov_deg=self._options.hfov_deg, focal_35mm=self._options.focal_35mm,
                is_video=True,
            )  # fmt: skip
        ref = FrameRef(
            index=self.index,
            name=f"{self._stem}#{self.index if frame_number is None else frame_number:06d}",
            source=source or self.source,
            width_px=width,
            height_px=height,
            frame_number=frame_number,
            pts_s=placed.stream_time_s,
            time_s=time_utc_s,
            camera=self._camera,
        )
        self.index += 1
        yield LiveFrame(ref, DecodedPicture(decoded), arrival_s, is_suspect)

    def metadata(self, data: bytes, arrival_s: float, stream_time_s: float | None = None) -> Iterator[StreamFix]:
        """Yield the positions in a packet of MISB metadata; what is none, or damaged, yields nothing."""
        if UAS_KEY not in data and not self._pending:
            return
        self._pending += data
        found = list(packets_of(bytes(self._pending)))
        if found and found[-1] is None and len(self._pending) < _MAX_PENDING_BYTES:
            return  # split over several packets: the rest is still to come
        self._pending.clear()
        at_s = self.timeline.stream_time_s if stream_time_s is None else stream_time_s
        for packet in found:
            if packet is None:
                continue
            try:
                point = track_of_packets([(at_s, packet)], self._stem).points[0]
            except DataError:
                continue
            yield StreamFix(
                at_s, arrival_s, GpsFix(point.lat_deg, point.lon_deg, point.alt_m, point.sigma_m), packet.utc_s,
                point.height_m, point.attitude, point.hfov_rad,
            )  # fmt: skip


def pts_s(decoded: Any) -> float | None:
    """Return a frame's (or packet's) time stamp in seconds, ``None`` where it has none."""
    if decoded.pts is None or decoded.time_base is None:
        return None
    return float(decoded.pts * decoded.time_base)


def held_back(decoder: Any, time_base: Any) -> list[Any]:
    """Return the frames that a decoder still holds at the end of its stream, with the time base that they lack."""
    try:
        frames = list(decoder.decode(None))
    except (FFmpegError, EOFError):
        return []
    for frame in frames:
        frame.time_base = time_base
    return frames
