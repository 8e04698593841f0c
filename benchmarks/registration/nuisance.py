"""What cameras, light, links and life do to two frames of a pair, in the order in which it happens to a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D

from .pictures import Grey

Image32 = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Nuisance:
    """How much of each; sigmas and noise in grey levels, blurs in pixels of one of the two frames."""

    noise: float = 2.0
    gain: float = 0.08
    blur_px: float = 0.0
    motion_blur_px: float = 0.0
    illumination: bool = False
    vignetting: bool = False
    contrast: float = 1.0
    jpeg_quality: int = 0
    moving_objects: bool = False
    corrupt_share: float = 0.0

    @property
    def margin_px(self) -> int:
        """How much beyond the frame has to be rendered, so that blurs need no made-up borders."""
        return math.ceil(max(4.0 * self.blur_px, self.motion_blur_px / 2.0 + 1.0 if self.motion_blur_px else 0.0))


def spoil(
    n: Nuisance, rng: np.random.Generator, a: Image32, b: Image32, T_a_b: Similarity2D | None
) -> tuple[Grey, Grey]:
    """Return both frames as the registration gets to see them; a and b still have their margins."""
    frames = [a, b]
    m = n.margin_px
    if n.moving_objects and T_a_b is not None:
        frames = list(_with_objects(rng, frames[0], frames[1], T_a_b, m))
    which = int(rng.integers(2))
    if n.blur_px:
        frames[which] = cv2.GaussianBlur(frames[which], (0, 0), n.blur_px)
    if n.motion_blur_px:
        frames[which] = cv2.filter2D(frames[which], -1, _streak(n.motion_blur_px, rng.uniform(0, math.pi)))
    frames = [f[m : f.shape[0] - m, m : f.shape[1] - m] for f in frames]
    if n.illumination:
        frames[which] = _relit(rng, frames[which])
    if n.vignetting:
        strength = rng.uniform(0.35, 0.65)
        frames = [f * _vignette(f.shape, strength) for f in frames]
    if n.contrast != 1.0:
        frames = [f.mean() + np.float32(n.contrast) * (f - f.mean()) for f in frames]
    for k in range(2):
        f = frames[k]
        if n.gain:
            f = f * np.float32(rng.uniform(1 - n.gain, 1 + n.gain)) + np.float32(rng.uniform(-4, 4))
        frames[k] = f + np.float32(n.noise) * rng.standard_normal(f.shape, dtype=np.float32)
    out = [np.clip(np.rint(f), 0, 255).astype(np.uint8) for f in frames]
    if n.jpeg_quality:
        out = [_through_jpeg(f, n.jpeg_quality) for f in out]
    if n.corrupt_share:
        out[which] = corrupted(rng, out[which], out[1 - which], n.corrupt_share)
    return out[0], out[1]


def _streak(length_px: float, angle_rad: float) -> Image32:
    """Return a centred line of even weight, drawn finely and reduced, so that it moves nothing."""
    half, fine = math.ceil(length_px / 2.0) + 1, 8
    side = (2 * half + 1) * fine
    t = np.linspace(-length_px / 2.0, length_px / 2.0, 40 * math.ceil(length_px))
    x, y = t * math.cos(angle_rad), t * math.sin(angle_rad)
    middle = (side - 1) / 2.0
    canvas = np.zeros((side, side), np.float32)
    np.add.at(canvas, (np.rint(middle + y * fine).astype(int), np.rint(middle + x * fine).astype(int)), 1.0)
    canvas = canvas + canvas[::-1, ::-1]
    kernel: Image32 = cv2.resize(canvas, (2 * half + 1, 2 * half + 1), interpolation=cv2.INTER_AREA)
    return kernel / kernel.sum()


def _relit(rng: np.random.Generator, f: Image32) -> Image32:
    """Return a frame of another exposure, under light that falls off to one side."""
    h, w = f.shape
    angle, slope = rng.uniform(0, 2 * math.pi), rng.uniform(0.1, 0.35)
    y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    gradient = 1.0 + slope * (x * math.cos(angle) + y * math.sin(angle))
    # A camera that is set too bright still has half of its picture within range.
    gain = min(math.exp(rng.uniform(math.log(0.5), math.log(1.6))), 200.0 / float(np.median(f)))
    return (f * (gain * gradient) + rng.uniform(-25, 25)).astype(np.float32)


def _vignette(shape: tuple[int, ...], strength: float) -> Image32:
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    return (1.0 - strength * (x**2 + y**2) / 2.0).astype(np.float32)


def _through_jpeg(f: Grey, quality: int) -> Grey:
    _, code = cv2.imencode(".jpg", f, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE), np.uint8)


def _with_objects(
    rng: np.random.Generator, a: Image32, b: Image32, T_a_b: Similarity2D, margin_px: int
) -> tuple[Image32, Image32]:
    """Draw vehicles that have moved between the frames, in two lanes of opposite ways, over some 8 % of the frame."""
    a, b = a.copy(), b.copy()
    h, w = (s - 2 * margin_px for s in b.shape)
    unit = w / 256.0
    T_b_a = T_a_b.inverse()
    way, share, wanted = rng.uniform(0, 2 * math.pi), 0.0, rng.uniform(0.05, 0.11)
    while share < wanted:
        length, width = rng.uniform(14, 36) * unit, rng.uniform(8, 15) * unit
        centre = rng.uniform((0, 0), (w, h))
        heading = way + (math.pi if rng.random() < 0.5 else 0.0) + rng.normal(0, 0.08)
        gone = rng.uniform(10, 45) * unit
        colour, glass = rng.uniform(15, 245), rng.uniform(10, 60)
        share += length * width / (w * h)
        for frame, T, shift in ((a, Similarity2D.identity(), 0.0), (b, T_b_a, gone)):
            at = centre + shift * np.array([math.cos(heading), math.sin(heading)])
            for half_l, half_w, value in ((length / 2, width / 2, colour), (length / 5, width / 2.6, glass)):
                box = _box(at, heading, half_l, half_w)
                cv2.fillPoly(
                    frame, [np.rint((T.apply(box) + margin_px) * 16).astype(np.int32)], value, cv2.LINE_8, shift=4
                )
    return a, b


def _box(centre: FloatArray, heading: float, half_length: float, half_width: float) -> FloatArray:
    along, across = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    return np.array([centre + i * half_length * along + j * half_width * across
                     for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])  # fmt: skip


CORRUPTIONS = ("blocks", "colours", "tear", "grey", "smear", "noise", "stale")


def corrupted(rng: np.random.Generator, frame: Grey, other: Grey, share: float) -> Grey:
    """Return a frame with ``share`` of its rows, in one to three bands, replaced by what a broken link leaves."""
    out = frame.copy()
    h, w = out.shape
    bands = int(rng.integers(1, 4))
    rows = max(8, round(h * share / bands))
    slots = rng.permutation(h // rows)[:bands]
    kind = CORRUPTIONS[int(rng.integers(len(CORRUPTIONS)))]
    for slot in slots:
        y0, y1 = int(slot) * rows, int(slot) * rows + rows
        band = out[y0:y1]
        if kind == "tear":
            band[:] = np.roll(band, int(rng.integers(w // 8, w - w // 8)), axis=1)
        elif kind == "grey":
            band[:] = int(rng.choice([0, 128, 130]))
        elif kind == "smear":
            band[:] = out[max(y0 - 1, 0)]
        elif kind == "noise":
            band[:] = rng.integers(0, 256, band.shape)
        elif kind == "stale":
            band[:] = other[y0:y1]
        else:
            cells = rng.integers(0, 256, (-(-rows // 16), -(-w // 16)))
            garbage = np.kron(cells, np.ones((16, 16)))[:rows, :w]
            if kind == "blocks":
                lost = np.kron(rng.random(cells.shape) < 0.7, np.ones((16, 16)))[:rows, :w] > 0
                sources = rng.permutation(w // 16)
                shuffled = band.reshape(rows, -1)[:, (sources[:, None] * 16 + np.arange(16)).ravel()]
                band[:, : shuffled.shape[1]] = np.where(lost[:, : shuffled.shape[1]], shuffled,
                                                        band[:, : shuffled.shape[1]])  # fmt: skip
            else:
                band[:] = garbage
    return out
