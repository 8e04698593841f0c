"""Broken frames, as bad radio links and tired cards make them."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.simulate.flight import Stream
from photomap_gis.simulate.spec import FlightSpec


class Breakage(StrEnum):
    """What can be wrong with a frame."""

    MACROBLOCKS = "macroblocks"
    TEARING = "tearing"
    GREY = "grey"
    GREEN = "green"
    BLACK = "black"
    FROZEN = "frozen"


def choose_breakages(spec: FlightSpec, count: int) -> dict[int, Breakage]:
    """Return which of ``count`` frames are broken and how, all kinds in turn; the first frame is always whole."""
    rng = Stream.ERRORS.rng(spec.seed)
    wanted = min(round(spec.imaging.error_share * count), max(count - 1, 0))
    if wanted == 0:
        return {}
    kinds = list(Breakage)
    rng.shuffle(kinds)
    frames = sorted(int(k) for k in 1 + rng.permutation(count - 1)[:wanted])
    return {frame: kinds[i % len(kinds)] for i, frame in enumerate(frames)}


def break_frame(image: ImageArray, previous: ImageArray | None, kind: Breakage, rng: np.random.Generator) -> ImageArray:
    """Return a broken copy of an image; ``previous`` is the last whole frame stored before it."""
    out = image.copy()
    h, w = out.shape[:2]
    if kind is Breakage.FROZEN:
        return out if previous is None else previous.copy()
    if kind is Breakage.BLACK:
        out[:] = 0
    elif kind is Breakage.GREY:
        out[:] = 128
    elif kind is Breakage.GREEN:
        out[:] = (0, 135, 0) if out.ndim == 3 else 88
    elif kind is Breakage.TEARING:
        edges = np.sort(rng.integers(h // 8, h, 3))
        for top, bottom in zip(edges, [*edges[1:], h], strict=True):
            shift = int(rng.integers(w // 6, w // 2)) * int(rng.choice((-1, 1)))
            out[top:bottom] = np.roll(out[top:bottom], shift, axis=1)
    else:  # from some macroblock on, blocks are lost, smeared or taken from elsewhere
        size = 16
        rows, cols = h // size, w // size
        for block in range(int(rng.uniform(0.1, 0.35) * rows * cols), rows * cols):
            if rng.uniform() < 0.7:
                y, x = block // cols * size, block % cols * size
                sy, sx = int(rng.integers(0, rows)) * size, int(rng.integers(0, cols)) * size
                part = image[sy : sy + size, sx : sx + size]
                flat = rng.uniform() < 0.4
                out[y : y + size, x : x + size] = part.mean(axis=(0, 1)).astype(np.uint8) if flat else part
    return out
