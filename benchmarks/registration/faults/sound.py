"""Sound frames of many kinds, above all those that a naive detector takes for faulty."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from functools import lru_cache

import av
import cv2
import numpy as np

from benchmarks.registration.faults.broken import coded, size_of, smear, take
from benchmarks.registration.faults.camera import Look, Motion, draw_picture, expose, fly, sources
from benchmarks.registration.faults.cases import Case, Grey, repeats, working
from benchmarks.registration.faults.screen import draw_box, draw_propellers, draw_telemetry
from benchmarks.registration.faults.spoilt import SpoiltStream
from benchmarks.registration.faults.streams import Codec, Coding, decode, encode, through_jpeg
from benchmarks.registration.pictures import SHARED, Origin, Part, read_grey


class Sound(StrEnum):
    """Kinds of sound frames."""

    VIDEO = "video"
    PHOTOS = "photos"
    FIRST = "first of a flight"
    STRANGERS = "no common ground"
    HOVER = "hovering"
    NOISE = "noise"
    CODED = "coded badly"
    SOFT = "light blur"
    DULL = "low contrast"
    BARE = "low texture"
    REPEATS = "repeats"
    EDGES = "straight edges"
    BOX = "letter box"
    TEXT = "telemetry text"
    PROPELLERS = "propellers"
    LIGHT = "illumination"
    GLARE = "glare and shadow"
    TILT = "tilt"
    RELIEF = "relief"
    MOVERS = "moving objects"
    MENDED = "mended stream"
    REAL = "real photos"
    REAL_VIDEO = "real video"


_NUMBERS = {s: k for k, s in enumerate([s for s in Sound if s is not Sound.MENDED] + [Sound.MENDED])}
"""What the random numbers of a kind begin with: those of a new kind come last."""


def make_sound(kind: Sound, seed: int, part: Part) -> Case:
    """Return the case of a kind, a seed and a part."""
    rng = np.random.default_rng([seed, 100 + _NUMBERS[kind], 0 if part == "tuning" else 1])
    for _ in range(60):
        previous, frame = _MAKERS[kind](rng, part)
        if previous is None or not repeats(frame, previous):
            size = size_of(rng, frame)
            before = None if previous is None else working(previous, size)
            suspect = kind is Sound.MENDED
            return Case(kind, "", False, working(frame, size), before, seed=seed, suspect=suspect)
    raise RuntimeError(f"no sound frame of kind {kind} came out of seed {seed}")


Pair = tuple[Grey | None, Grey]


def available(part: Part) -> list[Sound]:
    """Return the kinds that can be made of what lies here."""
    missing: set[Sound] = set()
    if not (SHARED / "misb_video" / "sample-stream.ts").is_file() or part == "tuning":
        missing.add(Sound.REAL_VIDEO)
    if not any(p.origin is Origin.SHARED for p in sources(part).pictures):
        missing.add(Sound.REAL)
    return [s for s in Sound if s not in missing]


def _last_two(frames: list[Grey]) -> Pair:
    return frames[-2], frames[-1]


def _video(rng: np.random.Generator, part: Part) -> Pair:
    return _last_two(coded(rng, take(rng, part, count=4)))


def _photos(rng: np.random.Generator, part: Part) -> Pair:
    return _last_two(coded(rng, expose(rng, fly(rng, draw_picture(rng, part), Motion.PHOTOS, 2), Look.draw(rng))))


def _first(rng: np.random.Generator, part: Part) -> Pair:
    return None, coded(rng, take(rng, part, count=2))[0]


def _strangers(rng: np.random.Generator, part: Part) -> Pair:
    """The camera looks somewhere else: a cut, a gap, the next strip."""
    look = Look.draw(rng)
    frame = coded(rng, expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 2), look))[1]
    wh = (frame.shape[1], frame.shape[0])
    return expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 1, size_wh=wh), look)[0], frame


def _hover(rng: np.random.Generator, part: Part) -> Pair:
    frames = expose(rng, fly(rng, draw_picture(rng, part), Motion.HOVER, 5), Look.draw(rng))
    if rng.uniform() < 0.5:
        frames = draw_telemetry(rng, frames)
    return _last_two(coded(rng, frames))


def _noise(rng: np.random.Generator, part: Part) -> Pair:
    look = Look(float(rng.uniform(6, 20)), 0.6, 0.1, 0.01)
    return _last_two(coded(rng, expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 3), look)))


def _coded_badly(rng: np.random.Generator, part: Part) -> Pair:
    frames = take(rng, part, count=5)
    if rng.uniform() < 0.4:
        quality = int(rng.integers(8, 31))
        return _last_two([through_jpeg(f, quality) for f in frames])
    coding = Coding(Codec.H264, int(rng.integers(34, 44)), int(rng.choice((4, 30))), 1)
    if rng.uniform() < 0.4:
        coding = Coding(Codec.MPEG2 if rng.uniform() < 0.5 else Codec.MPEG4, int(rng.integers(10, 25)), 4, 1)
    shown = decode(encode(frames, coding), coding.codec)
    return shown[3], shown[4]


def _soft(rng: np.random.Generator, part: Part) -> Pair:
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 2)
    w = light[1].shape[1]
    if rng.uniform() < 0.5:
        light[1] = cv2.GaussianBlur(light[1], (0, 0), w * float(rng.uniform(0.002, 3.0 / 256)))
    else:
        light[1] = smear(light[1], w * float(rng.uniform(0.01, 16 / 256)), float(rng.uniform(0, np.pi)))
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _dull(rng: np.random.Generator, part: Part) -> Pair:
    look = Look(float(rng.uniform(0.5, 2.0)), 0.6, 0.05, 0.005, contrast=float(rng.uniform(0.12, 0.35)))
    return _last_two(coded(rng, expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 3), look)))


def _bare(rng: np.random.Generator, part: Part) -> Pair:
    """Fields, sand, water: hardly any detail, all of it soft."""
    ground = read_grey(draw_picture(rng, part)).astype(np.float32)
    smooth = cv2.GaussianBlur(ground, (0, 0), float(rng.uniform(4, 14)))
    fine = cv2.GaussianBlur(ground, (0, 0), 1.0) - cv2.GaussianBlur(ground, (0, 0), 3.0)
    bare = np.clip(128 + 0.5 * (smooth - smooth.mean()) + float(rng.uniform(0.1, 0.4)) * fine, 0, 255).astype(np.uint8)
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 3, ground=bare)
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _repeats(rng: np.random.Generator, part: Part) -> Pair:
    """Crop rows, roofs, parking bays: level with the frame as often as not."""
    y, x = np.mgrid[0:1200, 0:1600].astype(np.float32)
    period = float(rng.uniform(8, 60))
    kind = int(rng.integers(3))
    pattern = np.sin(2 * np.pi * y / period)
    if kind == 1:
        pattern = np.sign(np.sin(2 * np.pi * y / period)) * np.sign(np.sin(2 * np.pi * x / (period * 1.7)))
    elif kind == 2:
        pattern = (np.mod(x, period) < 3).astype(np.float32) * (np.mod(y, 6 * period) < 2.5 * period) * 2
    texture = cv2.resize(read_grey(draw_picture(rng, part)), (1600, 1200)).astype(np.float32)
    ground = np.clip(
        110 + float(rng.uniform(15, 50)) * pattern + float(rng.uniform(0.1, 0.6)) * (texture - 128), 0, 255
    )
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 3, ground=ground.astype(np.uint8))
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _edges(rng: np.random.Generator, part: Part) -> Pair:
    """Roads, walls and field borders that run level through the whole frame, another ground on each side."""
    h, w = 1200, 1600
    ground = np.empty((h, w), np.uint8)
    y = 0
    while y < h:
        tall = int(rng.uniform(60, 350))
        part_of = cv2.resize(read_grey(draw_picture(rng, part)), (w, h)).astype(np.float32)
        gain, offset = float(rng.uniform(0.4, 1.0)), float(rng.uniform(-50, 50))
        ground[y : y + tall] = np.clip(128 + offset + gain * (part_of[y : y + tall] - 128), 0, 255)
        if rng.uniform() < 0.5:
            road = int(rng.uniform(4, 40))
            ground[y : y + road] = np.clip(rng.uniform(60, 220) + rng.normal(0, 4, ground[y : y + road].shape), 0, 255)
        y += tall
    if rng.uniform() < 0.4:  # and some across
        for _ in range(int(rng.integers(2, 8))):
            x, road = int(rng.integers(0, w - 50)), int(rng.uniform(4, 40))
            ground[:, x : x + road] = np.clip(rng.uniform(60, 220) + rng.normal(0, 4, (h, road)), 0, 255)
    if rng.uniform() < 0.5:
        ground = np.ascontiguousarray(ground.T)
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 3, ground=ground, tilt_deg=float(rng.choice((0.0, 1.5))))
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _box(rng: np.random.Generator, part: Part) -> Pair:
    return _last_two(coded(rng, draw_box(rng, take(rng, part, count=3))))


def _text(rng: np.random.Generator, part: Part) -> Pair:
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 3)
    return _last_two(coded(rng, draw_telemetry(rng, expose(rng, light, Look.draw(rng)))))


def _propellers(rng: np.random.Generator, part: Part) -> Pair:
    return _last_two(coded(rng, draw_propellers(rng, take(rng, part, count=3))))


def _light(rng: np.random.Generator, part: Part) -> Pair:
    """A cloud's shadow comes, the exposure jumps."""
    frames = expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 3), Look.draw(rng))
    h, w = frames[0].shape
    y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    c, s = rng.normal(0, 1, 2)
    ramp = 1.0 / (1.0 + np.exp(-(c * x + s * y) * float(rng.uniform(1, 6))))
    gain = float(rng.uniform(0.6, 1.5)) * (1.0 - float(rng.uniform(0.1, 0.5)) * ramp)
    frames[-1] = np.clip(frames[-1] * gain + rng.uniform(-20, 20), 0, 255).astype(np.uint8)
    return _last_two(coded(rng, frames))


def _glare(rng: np.random.Generator, part: Part) -> Pair:
    """Snow, wet roofs and deep shadow: a good part of the picture is white or black."""
    frames = take(rng, part, count=3)
    level = float(np.percentile(frames[-1], rng.uniform(30, 75)))
    steep = float(rng.uniform(1.5, 5.0))
    bright = rng.uniform() < 0.5
    middle = 255.0 if bright else 0.0
    table = np.clip(middle + steep * (np.arange(256) - level), 0, 255).astype(np.uint8)
    return _last_two(coded(rng, [table[f] for f in frames]))


def _tilt(rng: np.random.Generator, part: Part) -> Pair:
    motion = Motion.VIDEO if rng.uniform() < 0.5 else Motion.PHOTOS
    light = fly(rng, draw_picture(rng, part), motion, 2, tilt_deg=12.0)
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _relief(rng: np.random.Generator, part: Part) -> Pair:
    motion = Motion.VIDEO if rng.uniform() < 0.7 else Motion.PHOTOS
    picture = draw_picture(rng, part, scene=True)
    light = fly(rng, picture, motion, 2, relief=float(rng.uniform(0.03, 0.12)))
    return _last_two(coded(rng, expose(rng, light, Look.draw(rng))))


def _movers(rng: np.random.Generator, part: Part) -> Pair:
    """Cars and people: small things that move by themselves."""
    frames = take(rng, part, count=2)
    h, w = frames[0].shape
    for _ in range(int(rng.integers(3, 13))):
        at, step = rng.uniform(0, 1, 2) * (w, h), rng.normal(0, 0.04 * w, 2)
        long, wide = w * float(rng.uniform(0.015, 0.05)), w * float(rng.uniform(0.008, 0.02))
        angle = float(np.degrees(np.arctan2(step[1], step[0])))
        value = int(rng.integers(0, 256))
        for k, frame in enumerate(frames):
            x, y = at + k * step
            box = cv2.boxPoints(((float(x), float(y)), (long, wide), angle))
            cv2.fillPoly(frame, [np.rint(box).astype(np.int32)], value, cv2.LINE_AA)
    return _last_two(coded(rng, frames))


def _mended(rng: np.random.Generator, part: Part) -> Pair:
    """Frames that show no damage although the decoder lost data shortly before: concealed well, or overwritten."""
    for _ in range(60):
        spoilt = SpoiltStream.draw(rng, part)
        for k in (int(k) for k in rng.permutation(sorted(spoilt.suspect & set(spoilt.numbers)))):
            at = spoilt.last_sound(k)
            if at is not None and spoilt.is_sound(k):
                return spoilt.small[at], spoilt.small[k]
    raise RuntimeError("no damaged stream had a sound frame")


def _real(rng: np.random.Generator, part: Part) -> Pair:
    """A photo and the next one of its flight, as they are."""
    groups = [g for g in sources(part).groups if g[0].origin is Origin.SHARED and len(g) > 1]
    group = groups[int(rng.integers(len(groups)))]
    k = int(rng.integers(1, len(group)))
    a, b = read_grey(group[k - 1]), read_grey(group[k])
    if rng.uniform() < 0.5:  # a part of them
        h, w = a.shape
        side = int(min(h, w) * float(rng.uniform(0.5, 1.0)))
        y, x = int(rng.integers(0, h - side + 1)), int(rng.integers(0, w - side + 1))
        a, b = a[y : y + side, x : x + side], b[y : y + side, x : x + side]
    return a, b


@lru_cache(maxsize=1)
def _video_frames() -> list[Grey]:
    with av.open(str(SHARED / "misb_video" / "sample-stream.ts")) as container:
        return [np.asarray(f.to_ndarray(format="gray"), np.uint8) for f in container.decode(video=0)]


def _real_video(rng: np.random.Generator, part: Part) -> Pair:
    """Frames of the MISB sample, one to ten apart."""
    frames = _video_frames()
    gap = int(rng.integers(1, 11))
    k = int(rng.integers(gap, len(frames)))
    return frames[k - gap], frames[k]


_MAKERS: dict[Sound, Callable[[np.random.Generator, Part], Pair]] = {
    Sound.VIDEO: _video,
    Sound.PHOTOS: _photos,
    Sound.FIRST: _first,
    Sound.STRANGERS: _strangers,
    Sound.HOVER: _hover,
    Sound.NOISE: _noise,
    Sound.CODED: _coded_badly,
    Sound.SOFT: _soft,
    Sound.DULL: _dull,
    Sound.BARE: _bare,
    Sound.REPEATS: _repeats,
    Sound.EDGES: _edges,
    Sound.BOX: _box,
    Sound.TEXT: _text,
    Sound.PROPELLERS: _propellers,
    Sound.LIGHT: _light,
    Sound.GLARE: _glare,
    Sound.TILT: _tilt,
    Sound.RELIEF: _relief,
    Sound.MOVERS: _movers,
    Sound.MENDED: _mended,
    Sound.REAL: _real,
    Sound.REAL_VIDEO: _real_video,
}
