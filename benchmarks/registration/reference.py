"""Make the SIFT reference of the real flights: ``python -m benchmarks.registration.reference``.

Consecutive photos, their central squares reduced to 768 pixels; SIFT, a homography by USAC, at least 20 inliers, and
forward and back consistent. The closest similarity over the true overlap is written in pixels of the 256 pixel squares.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

from .pictures import SHARED, Grey

FILE = Path(__file__).with_name("sift_reference.json")
FLIGHTS = ("caliterra", "seneca")
SIDE_PX, REFERENCE_SIDE_PX = 256, 768
FEWEST_INLIERS = 20
CONSISTENT = 0.01
"""Largest RMS over the overlap of there and back, as a share of the width."""
RATIO, WITHIN_PX = 0.75, 5.0


@dataclass(frozen=True, slots=True)
class Reference:
    """The closest similarity ``T_a_b`` of two photos, ``None`` entries of ``similarity`` where SIFT cannot match.

    ``similarity`` is tx, ty, angle in radians, log scale, in pixels of the 256 pixel squares; ``residual_px`` what it
    leaves of the homography; ``overlap`` the share of b that a sees.
    """

    a: str
    b: str
    inliers: int
    similarity: tuple[float, float, float, float] | None = None
    overlap: float = 0.0
    residual_px: float = 0.0

    @property
    def T_a_b(self) -> Similarity2D | None:
        """The similarity."""
        return None if self.similarity is None else Similarity2D(*self.similarity)


def squares(flight: str, side_px: int) -> Iterator[tuple[str, Grey]]:
    """Yield name and central square of each photo of a flight, its shorter side reduced to ``side_px``."""
    for path in sorted((SHARED / flight / "images").iterdir()):
        yield path.name, square(path, side_px)


def square(path: Path, side_px: int) -> Grey:
    """Return the central square of a photo, reduced by area to ``side_px``."""
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if grey is None:
        raise OSError(f"cannot read {path.name}")
    h, w = grey.shape
    side = min(h, w)
    y, x = (h - side) // 2, (w - side) // 2
    cut = np.ascontiguousarray(grey[y : y + side, x : x + side])
    return np.asarray(cv2.resize(cut, (side_px, side_px), interpolation=cv2.INTER_AREA), np.uint8)


def make_reference(flight: str) -> list[Reference]:
    """Return the references of a flight's consecutive photos."""
    found = [(name, _features(grey)) for name, grey in squares(flight, REFERENCE_SIDE_PX)]
    return [_reference(a, b, fa, fb) for (a, fa), (b, fb) in pairwise(found)]


def read_reference() -> dict[str, list[Reference]]:
    """Return the committed references by flight."""
    document: dict[str, list[dict[str, Any]]] = json.loads(FILE.read_text(encoding="utf-8"))
    return {
        flight: [
            Reference(**{**entry, "similarity": entry["similarity"] and tuple(entry["similarity"])})
            for entry in entries
        ]
        for flight, entries in document.items()
    }


@lru_cache(maxsize=1)
def _sift() -> Any:
    return cv2.SIFT.create()  # as it comes: what "SIFT can match" should not hang on our tuning


def _features(grey: Grey) -> tuple[FloatArray, Any]:
    keypoints, descriptors = _sift().detectAndCompute(grey, None)
    return np.array([k.pt for k in keypoints], np.float64), descriptors


def _homography(a: tuple[FloatArray, Any], b: tuple[FloatArray, Any]) -> tuple[FloatArray | None, int]:
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(b[1], a[1], 2)
    good = [m[0] for m in matches if len(m) == 2 and m[0].distance < RATIO * m[1].distance]
    if len(good) < 8:
        return None, 0
    p_b, p_a = b[0][[m.queryIdx for m in good]], a[0][[m.trainIdx for m in good]]
    H, inliers = cv2.findHomography(p_b, p_a, cv2.USAC_MAGSAC, WITHIN_PX, maxIters=20_000, confidence=0.9999)
    if H is None:
        return None, 0
    kept = inliers.ravel() > 0
    # several keypoints of one spot (other orientations, other octaves) are one vote
    return H, len({tuple(np.rint(p / 4.0)) for p in p_b[kept]})


def _closest(H: FloatArray) -> tuple[Similarity2D, float, float] | None:
    """Return the closest similarity over the overlap, that overlap, and the residual, in pixels of 256 squares."""
    n = np.arange(0.5, SIDE_PX, 8.0) - 0.5
    grid = np.stack([v.ravel() for v in np.meshgrid(n, n)], axis=1)
    k = REFERENCE_SIDE_PX / SIDE_PX
    q = np.c_[(grid + 0.5) * k - 0.5, np.ones(len(grid))] @ H.T
    there = (q[:, :2] / q[:, 2:] + 0.5) / k - 0.5
    inside = (q[:, 2] > 0) & (there >= 0).all(axis=1) & (there <= SIDE_PX - 1).all(axis=1)
    if inside.mean() < 0.03:
        return None
    T = fit_similarity(there[inside], grid[inside])
    residual = float(np.sqrt(np.mean(np.sum((T.apply(grid[inside]) - there[inside]) ** 2, axis=1))))
    return T, float(inside.mean()), residual


def overlap_grid(T_a_b: Similarity2D) -> FloatArray:
    """``(N, 2)`` pixels of b's square that a similarity brings into a's."""
    n = np.arange(0.0, SIDE_PX, 8.0)
    grid = np.stack([v.ravel() for v in np.meshgrid(n, n)], axis=1)
    there = T_a_b.apply(grid)
    return grid[(there >= 0).all(axis=1) & (there <= SIDE_PX - 1).all(axis=1)]


def _reference(a: str, b: str, fa: tuple[FloatArray, Any], fb: tuple[FloatArray, Any]) -> Reference:
    (H, inliers), (back, inliers_back) = _homography(fa, fb), _homography(fb, fa)
    votes = min(inliers, inliers_back)
    if H is None or back is None or votes < FEWEST_INLIERS:
        return Reference(a, b, votes)
    there, here = _closest(H), _closest(back)
    if there is None or here is None or not 0.6 < there[0].scale < 1.6:
        return Reference(a, b, votes)
    T, overlap, residual = there
    grid = overlap_grid(T)
    # of the homographies: the closest similarities of there and back need not be each other's inverse
    gap = _apply(back, _apply(H, grid * 3.0 + 1.0)) - (grid * 3.0 + 1.0)
    if float(np.sqrt(np.mean(np.sum(gap**2, axis=1)))) > CONSISTENT * REFERENCE_SIDE_PX:
        return Reference(a, b, votes)
    similarity = (round(T.tx, 3), round(T.ty, 3), round(T.angle_rad, 6), round(T.log_scale, 6))
    return Reference(a, b, votes, similarity, round(overlap, 3), round(residual, 2))


def _apply(H: FloatArray, p: FloatArray) -> FloatArray:
    q = np.c_[p, np.ones(len(p))] @ H.T
    mapped: FloatArray = q[:, :2] / q[:, 2:]
    return mapped


def main() -> int:
    """Write the reference file."""
    cv2.setNumThreads(1)
    document = {flight: [asdict(r) for r in make_reference(flight)] for flight in FLIGHTS}
    lines = []
    for flight, entries in document.items():
        rows = ",\n".join("    " + json.dumps(entry) for entry in entries)
        lines.append(f'  "{flight}": [\n{rows}\n  ]')
        matched = sum(e["similarity"] is not None for e in entries)
        print(f"{flight}: {matched} of {len(entries)} consecutive pairs match", file=sys.stderr)
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
