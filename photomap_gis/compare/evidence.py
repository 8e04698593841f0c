"""What speaks for a change at a spot: its structure, and its colour beyond what light and season explain.

Structure is compared by gradients: their directions without a sign agree where a season turns the contrast upside down,
and what is flat in both says nothing. Colour is compared with what the pair itself shows that the season did: the new
colour that pixels of the same old colour mostly have, and how far they scatter about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.compare.field import steepness
from photomap_gis.compare.imagery import Colours

FloatImage = npt.NDArray[np.float32]
BoolImage = npt.NDArray[np.bool_]

STRIDE_PX = 2
"""Evidence is averaged over patches, so every second pixel of it tells all."""
NEAR_PX, WIDE_PX = 4, 10
"""Half sides of the patches."""
REACH_PX = 80
"""How far from a pixel evidence about it may lie: the margin that windows need."""
LIGHT_SIGMA_PX = 24.0
"""Sigma of the neighbourhood whose common shift of colour is light, moisture or haze."""
LIGHT_CLIP = 1.5
SOFTEN_PX = 1.0
SIGMA_FLOOR = 2.5
"""Colours (CIELAB) are not believed beyond this."""
MOST = 6.0
LEAN_M = 1.5
"""How far a roof's edge may lie from where the other picture has it: 5 m of height seen 17 degrees off nadir."""
MOST_LEAN_PX = 24.0

_SEEN = (
    "colour_near", "colour_wide", "colour_local", "colour_least", "structure_near", "structure_wide", "signed_near",
    "energy_near", "energy_wide", "texture_more", "texture_less",
)  # fmt: skip

FEATURES = (*_SEEN, *(f"{name}_leant" for name in _SEEN))
"""What speaks for a change in the pictures as they lie, and with the old one moved to where it looks like the new."""

_L_BINS, _AB_BINS = 14, 9
_AB_RANGE = 45.0
_LEAST_IN_BIN = 40


@dataclass(frozen=True, slots=True, eq=False)
class Habit:
    """What colours of one picture mostly become in the other: by bin of colour the median (CIELAB) and its scatter."""

    median: FloatImage
    sigma: FloatImage

    def of(self, lab: FloatImage) -> tuple[FloatImage, FloatImage]:
        """Return ``(h, w, 3)`` expected colours and sigmas."""
        index = _bin_of(lab)
        return self.median[index], self.sigma[index]


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """What a pair of pictures shows on the whole: habits both ways, typical gradients, whether colours tell."""

    forward: Habit
    backward: Habit
    gradient_old: float
    gradient_new: float
    has_colour: bool


def to_lab(rgb: Colours, *, has_colour: bool) -> FloatImage:
    """``(h, w, 3)`` CIELAB (L 0 to 100) of RGB 0 to 1, slightly softened; a and b 0 where colours do not tell."""
    soft = cv2.GaussianBlur(rgb, (0, 0), SOFTEN_PX)
    if not has_colour:
        grey = soft @ np.array([0.299, 0.587, 0.114], np.float32)
        soft = np.repeat(grey[..., None], 3, axis=2)
    lab = cv2.cvtColor(np.ascontiguousarray(soft), cv2.COLOR_RGB2LAB)
    if not has_colour:
        lab[..., 1:] = 0.0
    return np.asarray(lab, dtype=np.float32)


def look_at_pair(samples: list[tuple[Colours, Colours, BoolImage]], *, has_colour: bool) -> Pair:
    """Return what sample windows of old and new colours, laid on each other, and their common masks tell of a pair.

    Medians stand what changed; at least one sample must show ground.
    """
    olds, news, steep_old, steep_new = [], [], [], []
    for old, new, mask in samples:
        if not mask.any():
            continue
        lab_old, lab_new = to_lab(old, has_colour=has_colour), to_lab(new, has_colour=has_colour)
        inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=1) > 0
        olds.append(lab_old[inner][::3])
        news.append(lab_new[inner][::3])
        steep_old.append(np.hypot(*_gradient(lab_old[..., 0]))[inner][::3])
        steep_new.append(np.hypot(*_gradient(lab_new[..., 0]))[inner][::3])
    if not olds or sum(map(len, olds)) < 100:
        raise ValueError("samples must show ground in both pictures")
    a, b = np.concatenate(olds), np.concatenate(news)
    return Pair(
        _habit(a, b), _habit(b, a),
        float(np.sqrt(np.mean(np.minimum(np.concatenate(steep_old), 20.0) ** 2))) + 1e-3,
        float(np.sqrt(np.mean(np.minimum(np.concatenate(steep_new), 20.0) ** 2))) + 1e-3,
        has_colour,
    )  # fmt: skip


def leant(old: Colours, new: Colours, mask: BoolImage, most_px: float) -> Colours:
    """Return the old colours with each spot moved, by at most ``most_px``, to where it looks like the new ones.

    Roofs and tree tops lean away from the camera, each picture's in a way of its own: no smooth field can follow them.
    What is new, or gone, finds nothing like itself wherever it is moved.
    """
    pictures = []
    for rgb in (new, old):
        steep = steepness(rgb)
        top = float(np.percentile(steep[mask], 99.5)) if mask.any() else 1.0
        scaled = np.where(mask, steep * np.float32(255.0 / max(top, 1e-6)), np.float32(0.0))
        pictures.append(cv2.add(scaled.astype(np.float32), 0.0, dtype=cv2.CV_8U))
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(pictures[0], pictures[1], None)
    length = np.hypot(flow[..., 0], flow[..., 1])
    flow = flow * np.minimum(1.0, np.float32(most_px) / np.maximum(length, 1e-6))[..., None]
    x, y = np.meshgrid(np.arange(old.shape[1], dtype=np.float32), np.arange(old.shape[0], dtype=np.float32))
    moved = cv2.remap(old, x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(np.where(mask[..., None], moved, old), dtype=np.float32)


def evidence(old: Colours, new: Colours, mask: BoolImage, pair: Pair, *, most_lean_px: float) -> FloatImage:
    """``(h / 2, w / 2, len(FEATURES))``: what speaks for a change at every second pixel.

    Pictures are ``(h, w, 3)`` RGB 0 to 1, laid on each other; ``mask`` is where both show ground. What stands may lean
    by ``most_lean_px`` between them.
    """
    moved = leant(old, new, mask, most_lean_px)
    return np.concatenate([_evidence(picture, new, mask, pair) for picture in (old, moved)], axis=-1)


def lean_px(pixel_m: float) -> float:
    """Return how far what stands may lean in pixels of a size."""
    return min(MOST_LEAN_PX, LEAN_M / pixel_m)


def _evidence(old: Colours, new: Colours, mask: BoolImage, pair: Pair) -> FloatImage:
    lab_old, lab_new = to_lab(old, has_colour=pair.has_colour), to_lab(new, has_colour=pair.has_colour)
    lab_old[~mask], lab_new[~mask] = 0.0, 0.0
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=1).astype(np.float32)
    out = [*_colour_evidence(lab_old, lab_new, inner, pair), *_structure_evidence(lab_old, lab_new, inner, pair)]
    return np.stack([np.nan_to_num(v[::STRIDE_PX, ::STRIDE_PX]) for v in out], axis=-1).astype(np.float32)


def _colour_evidence(lab_old: FloatImage, lab_new: FloatImage, inner: FloatImage, pair: Pair) -> list[FloatImage]:
    residuals = []
    for habit, source, target in ((pair.forward, lab_old, lab_new), (pair.backward, lab_new, lab_old)):
        expected, sigma = habit.of(source)
        residuals.append((target - expected) / sigma)
    distances = [np.minimum(np.sqrt(np.mean(r * r, axis=2)), MOST) for r in residuals]
    both = np.sqrt(distances[0] * distances[1])
    # What a whole neighbourhood shares is light, moisture or haze: clipped before it is averaged, so that an object in
    # it does not hide itself.
    forward = residuals[0]
    weight = cv2.GaussianBlur(inner, (0, 0), LIGHT_SIGMA_PX)
    shared = cv2.GaussianBlur(np.clip(forward, -LIGHT_CLIP, LIGHT_CLIP) * inner[..., None], (0, 0), LIGHT_SIGMA_PX)
    local = forward - shared / np.maximum(weight, 1e-3)[..., None]
    local_distance = np.minimum(np.sqrt(np.mean(local * local, axis=2)), MOST)
    least = np.minimum(np.minimum(distances[0], distances[1]), local_distance)
    return [
        _mean(both, inner, NEAR_PX), _mean(both, inner, WIDE_PX), _mean(local_distance, inner, NEAR_PX),
        _mean(least, inner, NEAR_PX),
    ]  # fmt: skip


def _structure_evidence(lab_old: FloatImage, lab_new: FloatImage, inner: FloatImage, pair: Pair) -> list[FloatImage]:
    (ox, oy), (nx, ny) = _gradient(lab_old[..., 0]), _gradient(lab_new[..., 0])
    ox, oy = ox / pair.gradient_old, oy / pair.gradient_old
    nx, ny = nx / pair.gradient_new, ny / pair.gradient_new
    steep_old, steep_new = ox * ox + oy * oy, nx * nx + ny * ny
    # Directions without a sign: the angle doubled, the length kept.
    ro, rn = np.sqrt(steep_old) + 1e-6, np.sqrt(steep_new) + 1e-6
    double = ((ox * ox - oy * oy) * (nx * nx - ny * ny) + 4.0 * ox * oy * nx * ny) / (ro * rn)
    signed = ox * nx + oy * ny
    out, energies = [], []
    for half in (NEAR_PX, WIDE_PX):
        e_old, e_new = (np.maximum(_mean(e, inner, half), 0.0) for e in (steep_old, steep_new))
        size = np.sqrt(e_old * e_new) + 0.05
        agreement = np.clip(_mean(double, inner, half) / size, -1.0, 1.0)
        told = np.maximum(e_old, e_new)
        told = told / (told + 0.35)
        out.append((1.0 - agreement) * told)
        energies.append((e_old, e_new))
        if half == NEAR_PX:
            out_signed = (1.0 - np.clip(np.abs(_mean(signed, inner, half)) / size, 0.0, 1.0)) * told
    near, wide = energies
    ratios = [np.minimum(np.abs(np.log((e_new + 0.12) / (e_old + 0.12))), 4.0) for e_old, e_new in (near, wide)]
    more, less = np.maximum(*near), np.minimum(*near)
    return [*out, out_signed, *ratios, np.log1p(np.minimum(more, 50.0)), np.log1p(np.minimum(less, 50.0))]


def _gradient(grey: FloatImage) -> tuple[FloatImage, FloatImage]:
    return (
        np.asarray(cv2.Scharr(grey, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)),
        np.asarray(cv2.Scharr(grey, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)),
    )


def _mean(values: FloatImage, inner: FloatImage, half_px: int) -> FloatImage:
    """Return the mean over a patch of what is seen of it."""
    side = (2 * half_px + 1, 2 * half_px + 1)
    total = cv2.boxFilter(inner, -1, side, normalize=True, borderType=cv2.BORDER_CONSTANT)
    sums = cv2.boxFilter(values * inner, -1, side, normalize=True, borderType=cv2.BORDER_CONSTANT)
    # Running sums leave tiny negatives where there is nothing.
    return np.asarray(sums / np.maximum(total, 1e-3), dtype=np.float32)


def _bin_of(lab: FloatImage) -> npt.NDArray[np.intp]:
    bin_l = np.clip(lab[..., 0] * (_L_BINS / 100.0), 0, _L_BINS - 1).astype(np.intp)
    scale = _AB_BINS / (2.0 * _AB_RANGE)
    bin_a = np.clip((lab[..., 1] + _AB_RANGE) * scale, 0, _AB_BINS - 1).astype(np.intp)
    bin_b = np.clip((lab[..., 2] + _AB_RANGE) * scale, 0, _AB_BINS - 1).astype(np.intp)
    return np.asarray((bin_l * _AB_BINS + bin_a) * _AB_BINS + bin_b)


def _habit(source: FloatImage, target: FloatImage) -> Habit:
    """Return what ``(N, 3)`` colours became; bins that few pixels fall into are told by their lightness alone."""
    count = _L_BINS * _AB_BINS * _AB_BINS
    index = _bin_of(source)
    overall = np.median(target, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(target - overall), axis=0), SIGMA_FLOOR)
    median = np.empty((count, 3), np.float32)
    sigma = np.empty((count, 3), np.float32)
    by_light = index // (_AB_BINS * _AB_BINS)
    for level in range(_L_BINS):
        rows = by_light == level
        m, s = _spread(target[rows]) if rows.sum() >= _LEAST_IN_BIN else (overall, spread)
        part = np.s_[level * _AB_BINS**2 : (level + 1) * _AB_BINS**2]
        # A colour that is rare may be a change itself: it is expected to look like others of its lightness.
        median[part], sigma[part] = m, s
    order = np.argsort(index, kind="stable")
    starts = np.searchsorted(index[order], np.arange(count + 1))
    for k in range(count):
        if starts[k + 1] - starts[k] >= _LEAST_IN_BIN:
            median[k], sigma[k] = _spread(target[order[starts[k] : starts[k + 1]]])
    return Habit(median, sigma)


def _spread(colours: FloatImage) -> tuple[FloatImage, FloatImage]:
    middle = np.median(colours, axis=0)
    return middle, np.maximum(1.4826 * np.median(np.abs(colours - middle), axis=0), SIGMA_FLOOR)
