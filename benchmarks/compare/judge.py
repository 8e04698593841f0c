"""How well a comparison found known changes: object by object, and the false ground a square kilometre."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import rasterio
from rasterio.features import rasterize
from rasterio.warp import transform_geom

from benchmarks.compare.pairs import KnownPair

FOUND_SHARE = 0.25
"""An object counts as found where this share of it is called changed."""
SLACK_M = 0.8
"""Ground this near to a true change is neither right nor wrong: the edges of patches."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Objects found of those there are, polygons that touch a true change of those drawn, and false ground."""

    found: int
    objects: int
    right_areas: int
    areas: int
    false_m2: float
    compared_m2: float
    bins: tuple[tuple[float, float, int], ...]
    """Reliability: mean score, share truly changed and number of pixels, by fifths of the score."""

    @property
    def recall(self) -> float:
        return self.found / max(1, self.objects)

    @property
    def precision(self) -> float:
        return self.right_areas / max(1, self.areas)

    @property
    def false_m2_per_km2(self) -> float:
        return 1e6 * self.false_m2 / max(1.0, self.compared_m2)


def judge(pair: KnownPair, raster: Path, polygons: Path, threshold: float = 0.5) -> Judged:
    """Judge the files of a comparison by the changes of the pair's new ground."""
    with rasterio.open(raster) as dataset:
        score, place, crs = dataset.read(1), dataset.transform, dataset.crs
    compared = score >= 0.0
    grid = pair.new.grid
    # Where the raster's pixels lie on the truth's.
    rows, cols = np.indices(score.shape)
    x, y = place.c + (cols + 0.5) * place.a, place.f + (rows + 0.5) * place.e
    xy = grid.to_px(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(*score.shape, 2).astype(np.float32)

    def at(mask: np.ndarray) -> np.ndarray:
        return cv2.remap(mask.astype(np.uint8), xy[..., 0], xy[..., 1], cv2.INTER_NEAREST) > 0

    truth = at(pair.truth)
    slack = max(1, round(SLACK_M / place.a))
    near = cv2.dilate(truth.astype(np.uint8), np.ones((2 * slack + 1, 2 * slack + 1), np.uint8)) > 0
    called = score >= threshold
    found = objects = 0
    for change in pair.changes:
        alone = np.zeros(pair.new.colour.shape[:2], bool)
        cx, cy = change.top_left_px
        alone[cy : cy + change.mask.shape[0], cx : cx + change.mask.shape[1]] = change.mask
        here = at(alone) & compared
        if here.any():
            objects += 1
            found += called[here].mean() >= FOUND_SHARE
    features = json.loads(polygons.read_text(encoding="utf-8"))["features"]
    right, false_m2 = 0, 0.0
    for feature in features:
        shape = transform_geom("EPSG:4326", crs, feature["geometry"])
        drawn = rasterize([shape], score.shape, transform=place, all_touched=True) > 0
        right += bool((drawn & truth).any())
        false_m2 += float((drawn & ~near & compared).sum()) * place.a**2
    bins = []
    sure = compared & ~(near & ~truth)
    for low in np.arange(0.0, 1.0, 0.2):
        rows_in = sure & (score >= low) & (score < low + 0.2 + (low > 0.7))
        n = int(rows_in.sum())
        bins.append((float(score[rows_in].mean()) if n else 0.0, float(truth[rows_in].mean()) if n else 0.0, n))
    return Judged(found, objects, right, len(features), false_m2, float(compared.sum()) * place.a**2, tuple(bins))
