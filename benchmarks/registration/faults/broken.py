"""Faulty frames of six kinds, as bad links, tired cards and careless operators make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum

import cv2
import numpy as np

from benchmarks.registration.faults.camera import Look, Motion, draw_picture, expose, fly, fly_placed
from benchmarks.registration.faults.cases import (
    FAULTY_SHARE,
    Case,
    Grey,
    moved_px,
    seen_before,
    strong_difference,
    working,
)
from benchmarks.registration.faults.screen import draw_menu, draw_telemetry, write
from benchmarks.registration.faults.spoilt import SpoiltStream
from benchmarks.registration.faults.streams import Coding, decode, encode, through_bad_jpeg, through_jpeg
from benchmarks.registration.pictures import Part

TAKE = 12
RIM = "rim"
"""Blocks damaged where the frame shows what its predecessor did not: nothing there can be compared."""
HEAVY_BLUR = 0.025
"""Sigma of a defocus, as a share of the width, from which a blur is heavy (6.4 px at 256)."""
HEAVY_SMEAR = 0.12
"""Length of a motion blur, as a share of the width, from which it is heavy (31 px at 256)."""


class Kind(StrEnum):
    """The six kinds of the bar."""

    BLOCKS = "blocks"
    TORN = "torn"
    FROZEN = "frozen"
    FLAT = "flat"
    BLURRED = "blurred"
    MENU = "menu"


def make_faulty(kind: Kind, seed: int, part: Part) -> Case:
    """Return the case of a kind, a seed and a part; what turns out harmless is drawn again."""
    rng = np.random.default_rng([seed, list(Kind).index(kind), 0 if part == "tuning" else 1])
    for _ in range(60):
        case = _MAKERS[kind](rng, part)
        if case is not None:
            return replace(case, seed=seed)
    raise RuntimeError(f"no faulty frame of kind {kind} came out of seed {seed}")


def take(rng: np.random.Generator, part: Part, *, count: int = TAKE, hovering: float = 0.1) -> list[Grey]:
    """Return a short take of an ordinary camera, one in four with telemetry text."""
    motion = Motion.HOVER if rng.uniform() < hovering else Motion.VIDEO
    frames = expose(rng, fly(rng, draw_picture(rng, part), motion, count), Look.draw(rng))
    return draw_telemetry(rng, frames) if rng.uniform() < 0.25 else frames


def size_of(rng: np.random.Generator, frame: Grey) -> int:
    """Return the working size at which a take is judged."""
    return 256 if max(frame.shape) <= 320 or rng.uniform() < 0.5 else 512


def coded(rng: np.random.Generator, frames: list[Grey]) -> list[Grey]:
    """Return a take as a recorder gives it: through a codec, or as it was."""
    way = rng.uniform()
    if way < 0.5:
        shown = decode(encode(frames, coding := Coding.draw(rng)), coding.codec)
        return [shown[k] for k in range(len(frames))] if len(shown) == len(frames) else frames
    if way < 0.8:
        quality = int(rng.integers(50, 96))
        return [through_jpeg(f, quality) for f in frames]
    return frames


def _compared(
    rng: np.random.Generator, kind: Kind, variety: str, *, previous: Grey, clean: Grey, frame: Grey
) -> Case | None:
    size = size_of(rng, frame)
    small, before, whole = working(frame, size), working(previous, size), working(clean, size)
    damaged = strong_difference(whole, small)
    if float(damaged.mean()) < FAULTY_SHARE:
        return None
    return Case(kind, variety, True, small, before, whole, damaged)


def _blocks(rng: np.random.Generator, part: Part) -> Case | None:
    way = rng.uniform()
    if way < 0.7:
        return _stream(rng, part)
    frames = take(rng, part, count=2)
    previous, clean = frames
    if way < 0.85:
        quality = int(rng.integers(60, 95))
        shown = through_bad_jpeg(rng, clean, quality)
        if shown is None:
            return None
        previous, clean = through_jpeg(previous, quality), through_jpeg(clean, quality)
        return _compared(rng, Kind.BLOCKS, "jpeg", previous=previous, clean=clean, frame=shown)
    moved = rng.uniform() < 0.5
    broken = break_blocks(rng, clean, moved=moved)
    previous, broken = coded(rng, [previous, broken])
    return _compared(rng, Kind.BLOCKS, "moved" if moved else "coloured", previous=previous, clean=clean, frame=broken)


def _stream(rng: np.random.Generator, part: Part) -> Case | None:
    spoilt = SpoiltStream.draw(rng, part)
    for k in (int(k) for k in rng.permutation(spoilt.numbers)):
        if float(spoilt.damaged(k).mean()) < FAULTY_SHARE:
            continue
        at = spoilt.last_sound(k)
        if at is None:
            continue
        damaged, (small, places) = spoilt.damaged(k), (spoilt.small, spoilt.places)
        known = damaged & seen_before(places[at], places[k], spoilt.shape, small[k].shape)
        rim = float(known.mean()) < FAULTY_SHARE
        variety = RIM if rim else spoilt.codec.value
        seen = damaged if rim else known
        return Case(Kind.BLOCKS, variety, True, small[k], small[at], spoilt.whole[k], seen, suspect=k in spoilt.suspect)
    return None


def break_blocks(rng: np.random.Generator, clean: Grey, *, moved: bool, share: float | None = None) -> Grey:
    """Return a frame some of whose macro blocks, in runs, come from elsewhere or hold one value each."""
    out = clean.copy()
    size = int(rng.choice((8, 16, 16, 32)))
    rows, cols = clean.shape[0] // size, clean.shape[1] // size
    total = rows * cols
    wanted = (float(rng.uniform(0.04, 0.6)) if share is None else share) * total
    done = 0
    while done < wanted:
        start, run = int(rng.integers(total)), int(rng.integers(1, max(2, cols)))
        dy, dx = int(rng.integers(-2 * size, 2 * size)), int(rng.integers(-3 * size, 3 * size))
        for block in range(start, min(start + run, total)):
            y, x = block // cols * size, block % cols * size
            if moved:
                sy = int(np.clip(y + dy, 0, clean.shape[0] - size))
                sx = int(np.clip(x + dx, 0, clean.shape[1] - size))
                out[y : y + size, x : x + size] = clean[sy : sy + size, sx : sx + size]
            else:
                out[y : y + size, x : x + size] = int(rng.integers(10, 245))
        done += run
    return out


def _torn(rng: np.random.Generator, part: Part) -> Case | None:
    frames = take(rng, part, count=6)
    previous, clean = frames[-2], frames[-1]
    h, w = clean.shape
    top = int(rng.uniform(0, 0.75) * h)
    band = int(float(rng.uniform(0.12, 0.8)) * h)
    rows = slice(top, min(h, top + band))
    broken = clean.copy()
    variety = str(rng.choice(("shifted", "shifted", "earlier", "stranger", "rolled", "skewed")))
    if variety == "shifted":
        shift = int(rng.uniform(0.04, 0.5) * w) * int(rng.choice((-1, 1)))
        broken[rows] = np.roll(clean[rows], shift, axis=1)
        if rng.uniform() < 0.4:
            broken[rows][:, : shift if shift > 0 else None][:, shift if shift < 0 else 0 :] = int(
                rng.choice((0, 16, 128))
            )
    elif variety == "earlier":
        broken[rows] = frames[int(rng.integers(0, len(frames) - 2))][rows]
    elif variety == "stranger":
        other = expose(rng, fly(rng, draw_picture(rng, part), Motion.VIDEO, 1, size_wh=(w, h)), Look.draw(rng))[0]
        broken[rows] = other[rows]
    elif variety == "rolled":
        broken = np.roll(clean, int(rng.uniform(0.15, 0.85) * h), axis=0)
    else:  # each row a little further than the one above: lost line sync
        slope = float(rng.uniform(0.3, 2.0)) * float(rng.choice((-1, 1)))
        for k in range(rows.start, rows.stop):
            broken[k] = np.roll(clean[k], int(slope * (k - rows.start) + np.sign(slope) * 0.05 * w))
    previous, broken = coded(rng, [previous, broken])
    return _compared(rng, Kind.TORN, variety, previous=previous, clean=clean, frame=broken)


def _frozen(rng: np.random.Generator, part: Part) -> Case | None:
    light, places = fly_placed(rng, draw_picture(rng, part), Motion.VIDEO, 2)
    frames = expose(rng, light, Look.draw(rng))
    if rng.uniform() < 0.25:
        frames = draw_telemetry(rng, frames)
    expected = moved_px(places[0], places[1], frames[0])
    variety = str(rng.choice(("exact", "recoded", "stream", "captured")))
    if variety == "exact":
        previous = frame = coded(rng, frames[:2])[0]
    elif variety == "recoded":
        q = rng.integers(40, 96, 2)
        previous, frame = (through_jpeg(frames[0], int(v)) for v in q)
    elif variety == "stream":
        coding = Coding.draw(rng)
        shown = decode(encode([frames[0], *[frames[1]] * 8], coding), coding.codec)
        first, last = sorted(int(v) for v in rng.choice(np.arange(2, 9), 2, replace=False))  # the codec has settled
        if first not in shown or last not in shown:
            return None
        previous, frame = shown[first], shown[last]
    else:
        still = frames[0].astype(np.float32)
        sigma = float(rng.uniform(0.4, 1.5))
        previous, frame = (
            np.clip(np.rint(still + rng.normal(0, sigma, still.shape)), 0, 255).astype(np.uint8) for _ in "ab"
        )
    if float(strong_difference(frames[1], frames[0]).mean()) < 0.02:
        return None  # nothing moved: a frozen picture would show the same
    size = size_of(rng, frame)
    return Case(
        Kind.FROZEN, variety, True, working(frame, size), working(previous, size), working(frames[1], size),
        expected_px=expected,
    )  # fmt: skip


def _flat(rng: np.random.Generator, part: Part) -> Case | None:
    previous, clean = take(rng, part, count=2)
    h, w = clean.shape
    value = int(rng.choice((0, 16, 41, 79, 88, 128, 130, 145, 235, 255)))
    variety = str(rng.choice(("whole", "most", "most", "sign", "bars", "snow", "snow")))
    broken = np.full((h, w), value, np.uint8)
    if variety == "most":
        broken = clean.copy()
        share = float(rng.uniform(0.5, 0.97))
        edge = int(share * h)
        block = 16 * int(rng.integers(0, w // 16))
        if rng.uniform() < 0.8:  # the last rows are lost, from some block on
            broken[h - edge :] = value
            broken[max(0, h - edge - 16) : h - edge, block:] = value
        else:
            broken[:edge] = value
    elif variety == "sign":
        text = str(rng.choice(("NO SIGNAL", "VIDEO LOST", "SEARCHING...", "NO VIDEO INPUT")))
        write(broken, text, (int(w * rng.uniform(0.05, 0.4)), int(h * rng.uniform(0.2, 0.9))), h * 0.09,
              255 if value < 140 else 0, outlined=False)  # fmt: skip
    elif variety == "bars":
        broken[:] = np.repeat(np.array([235, 210, 170, 145, 106, 81, 41, 16], np.uint8), -(-w // 8))[:w]
    elif variety == "snow":
        noise = rng.normal(0, 1, (h, w))
        if rng.uniform() < 0.5:
            noise = cv2.GaussianBlur(noise, (0, 0), sigmaX=float(rng.uniform(0.4, 1.5)), sigmaY=0.01)
            noise /= noise.std()
        broken = np.clip(rng.uniform(70, 160) + rng.uniform(25, 90) * noise, 0, 255).astype(np.uint8)
    if variety != "snow" and rng.uniform() < 0.5:
        broken = np.clip(broken + rng.normal(0, rng.uniform(0.3, 2.5), (h, w)), 0, 255).astype(np.uint8)
    previous, broken = coded(rng, [previous, broken])
    return _compared(rng, Kind.FLAT, variety, previous=previous, clean=clean, frame=broken)


def _blurred(rng: np.random.Generator, part: Part) -> Case | None:
    light = fly(rng, draw_picture(rng, part), Motion.VIDEO, 2)
    w = light[0].shape[1]
    variety = str(rng.choice(("soft", "disc", "smear", "smear")))
    if variety == "soft":
        light[1] = cv2.GaussianBlur(light[1], (0, 0), w * float(rng.uniform(HEAVY_BLUR, 0.06)))
    elif variety == "disc":
        r = int(w * float(rng.uniform(2 * HEAVY_BLUR, 0.1)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * r + 1, 2 * r + 1)).astype(np.float32)
        light[1] = cv2.filter2D(light[1], -1, disc / disc.sum())
    else:
        light[1] = smear(light[1], w * float(rng.uniform(HEAVY_SMEAR, 0.3)), float(rng.uniform(0, np.pi)))
    clean = expose(rng, [light[0]], look := Look.draw(rng))[0]
    previous, broken = expose(rng, light, look)
    previous, broken = coded(rng, [previous, broken])
    size = size_of(rng, broken)
    return Case(Kind.BLURRED, variety, True, working(broken, size), working(previous, size), working(clean, size))


def smear(image: Grey, length_px: float, angle_rad: float) -> Grey:
    """Return a picture as a camera that moves straight while the shutter is open takes it."""
    side = int(length_px) // 2 * 2 + 3
    kernel = np.zeros((side, side), np.float32)
    c = side // 2
    d = np.array([np.cos(angle_rad), np.sin(angle_rad)]) * length_px / 2
    start, end = np.rint(c - d).astype(int), np.rint(c + d).astype(int)
    cv2.line(kernel, (int(start[0]), int(start[1])), (int(end[0]), int(end[1])), 1.0, 1, cv2.LINE_AA)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT_101), np.uint8)


def _menu(rng: np.random.Generator, part: Part) -> Case | None:
    previous, clean = take(rng, part, count=2)
    broken = draw_menu(rng, clean)
    previous, broken = coded(rng, [previous, broken])
    return _compared(rng, Kind.MENU, "menu", previous=previous, clean=clean, frame=broken)


_MAKERS: dict[Kind, Callable[[np.random.Generator, Part], Case | None]] = {
    Kind.BLOCKS: _blocks,
    Kind.TORN: _torn,
    Kind.FROZEN: _frozen,
    Kind.FLAT: _flat,
    Kind.BLURRED: _blurred,
    Kind.MENU: _menu,
}
