"""A video as a drone records it: H.264 in MP4, and the subtitle track with the flight's telemetry beside it."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.simulate.flight import Shot
from photomap_gis.simulate.photo_file import LOCAL_ZONE
from photomap_gis.simulate.spec import FlightSpec


class VideoFile:
    """An MP4 and its SRT being written frame by frame (a context manager; both appear under their names at the end)."""

    def __init__(self, path: Path, spec: FlightSpec, start_unix_s: float) -> None:
        self._path, self._spec = path, spec
        self._part = path.with_name(path.name + ".part")
        self._entries: list[str] = []
        self._rate = Fraction(spec.video_rate_hz).limit_denominator(1001)
        # H.264's half-resolution colour wants even sides
        self._size = (spec.width_px // 2 * 2, spec.height_px // 2 * 2)
        created = datetime.fromtimestamp(start_unix_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        self._container = av.open(str(self._part), "w", format="mp4")
        self._container.metadata["creation_time"] = created
        stream = self._container.add_stream("libx264", rate=self._rate)
        stream.width, stream.height, stream.pix_fmt = *self._size, "yuv420p"
        stream.bit_rate = spec.bitrate_bit_s
        stream.codec_context.gop_size = max(2, round(2.0 * float(self._rate)))
        stream.options = {
            "preset": "veryfast",
            "maxrate": str(round(1.5 * spec.bitrate_bit_s)),
            "bufsize": str(2 * spec.bitrate_bit_s),
        }
        self._stream = stream

    def __enter__(self) -> VideoFile:
        return self

    def add(self, image: ImageArray, shot: Shot) -> None:
        """Append one frame and its subtitle."""
        picture = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        picture = np.ascontiguousarray(picture[: self._size[1], : self._size[0]])
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
        frame.pts, frame.time_base = shot.index, 1 / self._rate
        self._container.mux(self._stream.encode(frame))
        self._entries.append(srt_entry(shot, self._spec, float(self._rate)))

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._container.mux(self._stream.encode())
        self._container.close()
        if kind is not None:
            self._part.unlink(missing_ok=True)
            return
        self._path.with_suffix(".SRT").write_text("\n".join(self._entries), encoding="utf-8")
        self._part.replace(self._path)


def srt_entry(shot: Shot, spec: FlightSpec, rate_hz: float) -> str:
    """Return one subtitle in the dialect of DJI's Mavic 3: clock, exposure, position, heights, gimbal."""
    begin, end = shot.index / rate_hz, (shot.index + 1) / rate_hz
    clock = datetime.fromtimestamp(shot.time_s, LOCAL_ZONE).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]
    lat, lon, alt = (shot.fix.lat_deg, shot.fix.lon_deg, shot.fix.alt_m or 0.0) if shot.fix else (0.0, 0.0, 0.0)
    words = [
        f"[iso: 100] [shutter: 1/{1000.0 / max(spec.imaging.exposure_ms, 0.01):.1f}] [fnum: 2.8] [ev: 0]",
        f"[color_md: default] [focal_len: {spec.focal_35mm:.2f}]",
        f"[latitude: {lat:.6f}] [longitude: {lon:.6f}]",
    ]
    if shot.relative_height_m is not None:
        words.append(f"[rel_alt: {shot.relative_height_m:.3f} abs_alt: {alt:.3f}]")
    else:
        words.append(f"[altitude: {alt:.3f}]")
    words.append("[ct: 5500]")
    if shot.attitude is not None:
        yaw, pitch, roll = (
            math.degrees(a) for a in (shot.attitude.yaw_rad, shot.attitude.pitch_rad, shot.attitude.roll_rad)
        )
        words.append(f"[gb_yaw: {yaw:.2f} gb_pitch: {pitch:.2f} gb_roll: {roll:.2f}]")
    return (
        f"{shot.index + 1}\n{_stamp(begin)} --> {_stamp(end)}\n"
        f'<font size="28">FrameCnt: {shot.index + 1}, DiffTime: {round(1000 / rate_hz)}ms\n{clock}\n'
        f"{' '.join(words)}</font>\n"
    )


def _stamp(seconds: float) -> str:
    ms = round(seconds * 1000)
    return f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"
