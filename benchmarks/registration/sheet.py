"""Contact sheets: pairs side by side with their truth drawn in, so that a person can look at what is measured."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from .pairs import CLASSES, Pair, pairs
from .pictures import Grey, Part

BGR = np.ndarray


def draw_pair(pair: Pair) -> BGR:
    """``(h, 3 w, 3)`` BGR: a with the outline of b, b, and both laid over each other by the truth (a red, b cyan)."""
    h, w = pair.b.shape
    a, b = (cv2.cvtColor(f, cv2.COLOR_GRAY2BGR) for f in (pair.a, pair.b))
    if pair.T_a_b is None:
        third = np.zeros_like(a)
    else:
        warped = _true_warp(pair)
        third = np.dstack([warped, warped, np.asarray(pair.a)])
        corners = pair.T_a_b.apply([[0, 0], [w - 1, 0], [w - 1, h - 1], [0, h - 1]])
        cv2.polylines(a, [np.rint(corners).astype(np.int32)], True, (0, 220, 255), 1, cv2.LINE_AA)
        for p, q in list(zip(pair.points_a, pair.points_b, strict=True))[:: max(1, len(pair.points_a) // 7)]:
            colour = tuple(int(v) for v in np.random.default_rng(int(q[0] * 999 + q[1])).integers(60, 256, 3))
            for frame, at in ((a, p), (b, q)):
                cv2.circle(frame, (round(float(at[0])), round(float(at[1]))), 4, colour, 1, cv2.LINE_AA)
    text = f"{pair.cls} {pair.picture} {pair.overlap:.2f} {pair.residual_px:.1f}"
    cv2.putText(a, text, (3, h - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.33, (0, 255, 255), 1, cv2.LINE_AA)
    return np.hstack([a, b, third])


def _true_warp(pair: Pair) -> Grey:
    """``(h, w)`` b as it lies in a by the true mapping, told by the truth's points: a homography fits them best."""
    H, _ = cv2.findHomography(pair.points_b, pair.points_a, 0)
    h, w = pair.b.shape
    return np.asarray(cv2.warpPerspective(pair.b, H, (w, h)), np.uint8)


def write_sheet(path: Path, part: Part, seed: int, each: int = 2, only: str = "", columns: int = 2) -> None:
    """Write a sheet with some pairs of every class whose name contains ``only``."""
    strips = [draw_pair(p) for c in CLASSES if only in c for p in pairs(c, each, seed, part)]
    strips += [np.zeros_like(strips[0])] * (-len(strips) % columns)
    rows = [np.hstack(strips[k : k + columns]) for k in range(0, len(strips), columns)]
    if not cv2.imwrite(str(path), np.vstack(rows)):
        raise OSError(f"cannot write {path}")
