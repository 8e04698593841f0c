"""Video and JPEG streams: coded, damaged on the way as a radio link damages them, and decoded again."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from typing import Any, cast

import av
import cv2
import numpy as np
import numpy.typing as npt
from av.codec.context import Flags, Flags2

from photomap_gis.ingest.trouble import Trouble

Grey = npt.NDArray[np.uint8]
START_CODE = b"\x00\x00\x01"

av.logging.set_level(None)


class Codec(StrEnum):
    """The codecs of radio links, new and old."""

    H264 = "h264"
    MPEG4 = "mpeg4"
    MPEG2 = "mpeg2video"

    @property
    def encoder(self) -> str:
        """The encoder's name."""
        return "libx264" if self is Codec.H264 else self.value


@dataclass(frozen=True, slots=True)
class Coding:
    """How a stream is coded; ``quality`` is the quantiser (CRF for H.264), larger is worse."""

    codec: Codec
    quality: int
    key_every: int
    slices: int

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Coding:
        """Return an ordinary link's coding."""
        codec = (Codec.H264, Codec.H264, Codec.H264, Codec.MPEG4, Codec.MPEG2)[int(rng.integers(5))]
        quality = int(rng.integers(20, 36)) if codec is Codec.H264 else int(rng.integers(2, 10))
        return cls(codec, quality, int(rng.choice((8, 15, 30, 250))), int(rng.choice((1, 2, 4, 8))))


Packet = tuple[int, bytes]


def encode(frames: list[Grey], coding: Coding) -> list[Packet]:
    """Return the stream's packets, each with its frame's number."""
    context = cast(av.VideoCodecContext, av.CodecContext.create(coding.codec.encoder, "w"))
    h, w = frames[0].shape
    context.width, context.height, context.pix_fmt = w, h, "yuv420p"
    context.time_base, context.framerate, context.thread_count = Fraction(1, 25), Fraction(25), 1
    if coding.codec is Codec.H264:
        parameters = f"keyint={coding.key_every}:slices={coding.slices}:bframes=0:rc-lookahead=0"
        context.options = {"preset": "superfast", "crf": str(coding.quality), "x264-params": parameters}
    else:
        context.gop_size, context.qmin, context.qmax = coding.key_every, coding.quality, coding.quality
        if coding.slices > 1:
            context.options = {"ps": "600"} if coding.codec is Codec.MPEG4 else {}
    packets: list[Packet] = []
    for number, grey in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(grey), "gray").reformat(format="yuv420p")
        frame.pts = number
        packets += [(int(p.pts or 0), bytes(p)) for p in context.encode(frame)]
    return packets + [(int(p.pts or 0), bytes(p)) for p in context.encode(None)]


def decode(packets: list[Packet], codec: Codec) -> dict[int, Grey]:
    """Return what a decoder shows of a stream, damaged parts too, by frame number; frames it gives up are absent."""
    return decode_telling(packets, codec)[0]


def decode_telling(packets: list[Packet], codec: Codec) -> tuple[dict[int, Grey], set[int]]:
    """Return what ``decode`` does, and of which frames the decoder told that something was missing (``Trouble``)."""
    context = av.CodecContext.create(codec.value, "r")
    context.thread_count = 1
    context.flags |= Flags.output_corrupt
    context.flags2 |= Flags2.show_all
    shown: dict[int, Grey] = {}
    suspect: set[int] = set()
    trouble = Trouble()

    def take(packet: av.Packet[Any] | None) -> None:
        try:
            for frame in context.decode(packet):
                told = trouble.of(frame)
                if frame.pts is not None:
                    y = frame.to_ndarray(format="gray")
                    shown[int(frame.pts)] = np.asarray(y, np.uint8)
                    if told:
                        suspect.add(int(frame.pts))
        except av.error.FFmpegError:
            trouble.failed()  # a packet that cannot be decoded at all

    for number, content in packets:
        if content:
            packet = av.Packet(len(content))  # with the zeros behind it that decoders read into
            packet.update(content)
            packet.pts = packet.dts = number
            take(packet)
    take(None)
    return shown, suspect


def damage(rng: np.random.Generator, packets: list[Packet], *, first: int, strokes: int) -> list[Packet]:
    """Return the packets with bytes spoilt, slices lost, tails cut or packets lost, not before frame ``first``."""
    out = list(packets)
    able = [k for k, (number, _) in enumerate(out) if number >= first]
    for _ in range(strokes):
        k = able[int(rng.integers(len(able)))]
        number, content = out[k]
        out[k] = number, _spoil(rng, content)
    return out


def _spoil(rng: np.random.Generator, content: bytes) -> bytes:
    size = len(content)
    if size < 40:
        return content
    way = rng.uniform()
    b = bytearray(content)
    if way < 0.15:
        return b""
    if way < 0.35:  # cut short
        return bytes(b[: int(rng.uniform(0.1, 0.9) * size)])
    slices = _slice_starts(content)
    if way < 0.65 and len(slices) > 2:  # one slice or a run of slices lost
        k = int(rng.integers(1, len(slices)))
        last = min(len(slices) - 1, k + int(rng.integers(0, 3)))
        end = slices[last + 1] if last + 1 < len(slices) else size
        return bytes(b[: slices[k]] + b[end:])
    start = int(rng.integers(20, size))
    run = min(int(rng.choice((2, 8, 40, 200, 1000))), size - start)
    b[start : start + run] = bytes(run) if rng.uniform() < 0.3 else rng.integers(1, 256, run, dtype=np.uint8).tobytes()
    return bytes(b)


def _slice_starts(content: bytes) -> list[int]:
    found, at = [], content.find(START_CODE)
    while at >= 0:
        found.append(at)
        at = content.find(START_CODE, at + 3)
    return found


def through_jpeg(grey: Grey, quality: int) -> Grey:
    """Return a picture as a JPEG of a quality shows it."""
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0), np.uint8)


def through_bad_jpeg(rng: np.random.Generator, grey: Grey, quality: int) -> Grey | None:
    """Return what a decoder shows of a damaged JPEG, ``None`` where it shows nothing."""
    restart = int(rng.choice((0, 0, 4, 20)))
    parameters = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_RST_INTERVAL, restart]
    b = bytearray(cv2.imencode(".jpg", grey, parameters)[1].tobytes())
    body = b.find(b"\xff\xda") + 12
    if rng.uniform() < 0.3:
        b = b[: int(rng.uniform(body + 0.1 * (len(b) - body), 0.9 * len(b)))]
    else:
        for _ in range(int(rng.integers(1, 4))):
            start = int(rng.integers(body, len(b) - 4))
            run = int(rng.choice((1, 2, 8, 60)))
            b[start : start + run] = rng.integers(0, 255, len(b[start : start + run]), dtype=np.uint8).tobytes()
    shown = cv2.imdecode(np.frombuffer(bytes(b), np.uint8), cv2.IMREAD_GRAYSCALE)
    return None if shown is None or shown.shape != grey.shape else np.asarray(shown, np.uint8)
