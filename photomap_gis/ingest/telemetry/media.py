"""Telemetry inside video files: MISB KLV in transport streams, DJI's subtitles and GoPro's metadata in MP4."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
from av.error import FFmpegError
from av.stream import Discard

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.options import SrtOrder
from photomap_gis.ingest.telemetry.beside import BesidePictures
from photomap_gis.ingest.telemetry.demux import packets
from photomap_gis.ingest.telemetry.gpmf import track_of_gpmf
from photomap_gis.ingest.telemetry.klv import UAS_KEY, KlvPacket, packets_of, track_of_packets
from photomap_gis.ingest.telemetry.srt import track_of_entries
from photomap_gis.ingest.telemetry.track import Track

_MAX_SUBTITLE_BYTES = 64 * 1024
_MAX_PACKETS = 5_000_000


def read_media(path: Path, *, order: SrtOrder = SrtOrder.AUTO) -> Track:
    """Return the track embedded in a video; ``DataError`` where there is none."""
    track = find_embedded(path, order=order)
    if track is None:
        raise DataError(f"{path}: no telemetry is embedded in this video; give a log by --track FILE")
    return track


def find_embedded(path: Path, *, order: SrtOrder = SrtOrder.AUTO) -> Track | None:
    """Return the track embedded in a video, ``None`` where there is none: data that is not telemetry is no error."""
    klv: list[tuple[float | None, KlvPacket | None]] = []
    subtitles: list[tuple[float | None, str]] = []
    gopro: list[tuple[float, float, bytes]] = []
    try:
        with av.open(str(path), metadata_errors="ignore") as container:
            video = next(iter(container.streams.video), None)
            wanted = [s for s in container.streams if s.type in ("data", "subtitle")]
            if not wanted:
                return None
            # Asynchronous metadata of a transport stream has no time stamp: it is of the picture that it came with.
            timed_by_picture = video is not None and container.format.name == "mpegts"
            for stream in container.streams:
                if stream not in wanted and not (timed_by_picture and stream is video):
                    stream.discard = Discard.all  # an MP4 of gigabytes is leapt through for its few lines of text
            start_s = _start_s(video)
            pending = bytearray()
            beside: BesidePictures[list[KlvPacket | None]] = BesidePictures()
            for count, packet in enumerate(packets(container, [*wanted, video] if timed_by_picture else wanted)):
                if count > _MAX_PACKETS:
                    break
                if packet.size == 0:
                    continue
                second = None if packet.pts is None else float(packet.pts * packet.time_base) - start_s
                if packet.stream is video:
                    klv += [(t.second, p) for t in beside.picture(packet.pos, second) for p in t.what]
                    continue
                data = bytes(packet)
                if packet.stream.type == "subtitle":
                    if len(data) <= _MAX_SUBTITLE_BYTES:
                        subtitles.append((second, _mov_text(data)))
                elif data.startswith(b"DEVC"):
                    duration_s = float((packet.duration or 0) * packet.time_base) or 1.0
                    gopro.append((second or 0.0, duration_s, data))
                elif UAS_KEY in data or pending:
                    # A packet may be split over several; asynchronous ones carry no time stamp.
                    pending += data
                    found = list(packets_of(bytes(pending)))
                    if found and found[-1] is None and len(pending) < 1 << 18:
                        continue
                    if second is None and timed_by_picture:
                        klv += [(t.second, p) for t in beside.untimed(packet.pos, found) for p in t.what]
                    else:
                        klv += [(second, p) for p in found]
                    pending.clear()
            klv += [(t.second, p) for t in beside.rest() for p in t.what]
    except FFmpegError:
        if not klv and not subtitles and not gopro:
            return None
    if klv:
        try:
            return track_of_packets(klv, str(path))
        except DataError:
            pass
    if gopro:
        track = track_of_gpmf(gopro, str(path))
        if track.points:
            return track
    if subtitles:
        track = track_of_entries(subtitles, str(path), order=order)
        return track if track.points else None
    return None


def _start_s(stream: Any) -> float:
    """Return when a stream's first frame is, on the container's clock."""
    if stream is None or stream.start_time is None or stream.time_base is None:
        return 0.0
    return float(stream.start_time * stream.time_base)


def _mov_text(data: bytes) -> str:
    """Return the text of a QuickTime text sample: two bytes of length, the text, then styles."""
    length = int.from_bytes(data[:2], "big")
    body = data[2 : 2 + length] if 0 < length <= len(data) - 2 else data
    return body.decode("utf-8", errors="replace")
