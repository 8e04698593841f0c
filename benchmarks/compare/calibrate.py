"""Fit the law of change to pairs of known truth: ``python -m benchmarks.compare.calibrate``.

Needs scikit-learn (extra ``bench``). The scenes' seeds are not those that the benchmark reports on.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from sklearn.linear_model import LogisticRegression

import photomap_gis.compare
from benchmarks.compare.laid import laid_on
from benchmarks.compare.pairs import MIX, PIXEL_M, known_pair
from photomap_gis.compare.evidence import FEATURES, STRIDE_PX, evidence, lean_px, look_at_pair
from photomap_gis.compare.score import LAW_FILE, products_of

SEEDS = range(100, 140)
SAMPLES = 12_000
BORDER_PX = 7
"""The borders of objects are left out: what a pixel there shows is half of each."""


def main() -> None:
    rng = np.random.default_rng(0)
    told, truth = [], []
    for seed in SEEDS:
        nuisance = MIX[seed % len(MIX)]
        pair = known_pair(seed, nuisance)
        old, new, mask = laid_on(pair)
        look = look_at_pair([(old, new, mask)], has_colour=not nuisance.grey)
        found = evidence(old, new, mask, look, most_lean_px=lean_px(PIXEL_M))
        kernel = np.ones((BORDER_PX, BORDER_PX), np.uint8)
        changed = pair.truth.astype(np.uint8)
        sure = cv2.erode(changed, kernel)[::STRIDE_PX, ::STRIDE_PX] > 0
        never = cv2.dilate(changed, kernel)[::STRIDE_PX, ::STRIDE_PX] == 0
        rows = np.flatnonzero(((sure | never) & mask[::STRIDE_PX, ::STRIDE_PX]).ravel())
        rows = rng.choice(rows, SAMPLES, replace=False)
        told.append(found.reshape(-1, len(FEATURES))[rows])
        truth.append(sure.ravel()[rows])
    x, y = np.concatenate(told), np.concatenate(truth)
    mean, scale = x.mean(axis=0), x.std(axis=0)
    law = LogisticRegression(max_iter=4000, C=0.3).fit(products_of((x - mean) / scale), y)
    document = {
        "features": list(FEATURES),
        "mean": [round(float(v), 6) for v in mean],
        "scale": [round(float(v), 6) for v in scale],
        "weights": [round(float(v), 6) for v in law.coef_[0]],
        "offset": round(float(law.intercept_[0]), 6),
        "changed_share": round(float(y.mean()), 4),
    }
    path = Path(photomap_gis.compare.__file__).parent / LAW_FILE
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(f"{path}: {len(y)} spots, {100 * y.mean():.1f} % of them changed")


if __name__ == "__main__":
    main()
