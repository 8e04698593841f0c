"""Samples of every kind, and every miss, as one picture for the eye."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.registration.faults.cases import Case, Grey

TILE_PX = 220
COLUMNS = 3
MOST_CASES = 240


def write_sheet(path: Path, cases: Sequence[tuple[Case, str]]) -> None:
    """Draw cases with a caption each: the predecessor, the frame, and the frame before it was broken."""
    tiles = [_tile(case, caption) for case, caption in cases[:MOST_CASES]]
    while len(tiles) % COLUMNS:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[k : k + COLUMNS]) for k in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(path), np.vstack(rows))


def _tile(case: Case, caption: str) -> Grey:
    nothing = np.zeros_like(case.frame)
    pictures = (case.previous if case.previous is not None else nothing, case.frame,
                case.clean if case.clean is not None else nothing)  # fmt: skip
    row = np.hstack([_fitted(p) for p in pictures])
    line = np.zeros((16, row.shape[1]), np.uint8)
    cv2.putText(line, caption[:100], (3, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.38, 255, 1, cv2.LINE_AA)
    return np.vstack([row, line])


def _fitted(picture: Grey) -> Grey:
    scale = (TILE_PX - 4) / max(picture.shape)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=method)
    out = np.zeros((TILE_PX, TILE_PX), np.uint8)
    out[: small.shape[0], : small.shape[1]] = small
    return out
