"""Frames that lost a quarter of their rows, with the truth of their motion: the rest must not be registered wrongly."""

from __future__ import annotations

from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.registration.faults.broken import break_blocks
from benchmarks.registration.faults.camera import Look, Motion, draw_picture, expose, fly, fly_placed
from benchmarks.registration.faults.cases import Case, Grey, working
from benchmarks.registration.pictures import Part

LOST_ROWS = 0.25
WRONG_SHARE = 0.016
"""Error, as a share of the frame's width, from which a registration is wrong (the success rule of the benchmark)."""


class Loss(StrEnum):
    """What stands where the rows were."""

    GREY = "grey"
    BLACK = "black"
    SMEARED = "smeared"
    STALE = "stale"
    SHIFTED = "shifted"
    STRANGER = "stranger"
    BLOCKS = "blocks"
    NOISE = "noise"


def make_partly(loss: Loss, seed: int, part: Part) -> Case:
    """Return a frame a quarter of whose rows are lost, at its top, its bottom or in between."""
    rng = np.random.default_rng([seed, 300 + list(Loss).index(loss), 0 if part == "tuning" else 1])
    light, places = fly_placed(rng, draw_picture(rng, part), Motion.VIDEO, 2, tilt_deg=0.3)
    previous, clean = expose(rng, light, Look.draw(rng))
    h, w = clean.shape
    tall = round(LOST_ROWS * h)
    top = int(rng.choice((0, h - tall, int(rng.integers(0, h - tall + 1)))))
    broken = clean.copy()
    broken[top : top + tall] = _instead(rng, loss, clean, previous, top, tall, part)
    size = 256 if w <= 320 or rng.uniform() < 0.5 else 512
    small = working(broken, size)
    k = w / small.shape[1]
    T = np.array([[k, 0.0, (k - 1) / 2], [0.0, k, (k - 1) / 2], [0.0, 0.0, 1.0]])
    H = np.linalg.inv(T) @ np.linalg.inv(places[0]) @ places[1] @ T
    return Case(
        "partly", loss, True, small, working(previous, size), working(clean, size), seed=seed, H_previous_frame=H
    )


def _instead(
    rng: np.random.Generator, loss: Loss, clean: Grey, previous: Grey, top: int, tall: int, part: Part
) -> npt.NDArray[np.uint8]:
    rows = clean[top : top + tall]
    h, w = clean.shape
    if loss is Loss.GREY or loss is Loss.BLACK:
        return np.full_like(rows, 128 if loss is Loss.GREY else 0)
    if loss is Loss.SMEARED:
        return np.repeat(clean[max(top - 1, 0)][None], tall, axis=0)
    if loss is Loss.STALE:
        return previous[top : top + tall]
    if loss is Loss.SHIFTED:
        return np.roll(rows, int(rng.uniform(0.05, 0.5) * w) * int(rng.choice((-1, 1))), axis=1)
    if loss is Loss.STRANGER:
        other = fly(rng, draw_picture(rng, part), Motion.VIDEO, 1, size_wh=(w, h))[0]
        return other[:tall]
    if loss is Loss.BLOCKS:
        return break_blocks(rng, np.ascontiguousarray(rows), moved=bool(rng.uniform() < 0.5), share=0.9)
    snow = 120 + 50 * rng.standard_normal(rows.shape)
    return np.asarray(cv2.convertScaleAbs(np.maximum(snow, 0.0)))


def error_share(T_a_b: npt.NDArray[np.float64], case: Case) -> float:
    """Return the root mean square error of a motion, ``(3, 3)``, over the true overlap, as a share of the width."""
    assert case.H_previous_frame is not None
    h, w = case.frame.shape
    x, y = np.meshgrid(np.linspace(0, w - 1, 17), np.linspace(0, h - 1, 17))
    p = np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    true = case.H_previous_frame @ p
    true = true[:2] / true[2]
    seen = (true[0] >= 0) & (true[0] < w) & (true[1] >= 0) & (true[1] < h)
    told = T_a_b @ p
    d = told[:2] / told[2] - true
    return float(np.sqrt((d[:, seen] ** 2).sum(axis=0).mean())) / w if seen.any() else float("inf")
