"""From evidence to a score: the probability that a spot has changed, by a logistic law of evidence and its products.

Its numbers are fitted to pairs of known truth by ``python -m benchmarks.compare.calibrate``, in which a twenty-fifth of
the ground had changed; the benchmark judges them on other ground. Where less has changed than that, more of what the
score calls a change is none.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib import resources

import numpy as np
import numpy.typing as npt

from photomap_gis.compare.evidence import FEATURES

FloatImage = npt.NDArray[np.float32]

LAW_FILE = "law.json"


def score_of(evidence: FloatImage) -> FloatImage:
    """``(..., )`` probabilities of ``(..., len(FEATURES))`` evidence."""
    mean, scale, weights, offset = _law()
    flat = (evidence.reshape(-1, len(FEATURES)) - mean) / scale
    out = np.empty(len(flat), np.float32)
    for start in range(0, len(flat), 1 << 18):  # the products are twelve times the evidence
        part = products_of(flat[start : start + (1 << 18)])
        out[start : start + (1 << 18)] = 1.0 / (1.0 + np.exp(-np.clip(part @ weights + offset, -30.0, 30.0)))
    return out.reshape(evidence.shape[:-1])


def products_of(evidence: FloatImage) -> FloatImage:
    """``(N, K + K (K + 1) / 2)``: the ``(N, K)`` evidence itself and all products of two of it."""
    i, j = np.triu_indices(evidence.shape[1])
    return np.concatenate([evidence, evidence[:, i] * evidence[:, j]], axis=1)


@lru_cache(maxsize=1)
def _law() -> tuple[FloatImage, FloatImage, FloatImage, float]:
    text = resources.files("photomap_gis.compare").joinpath(LAW_FILE).read_text(encoding="utf-8")
    law = json.loads(text)
    if tuple(law["features"]) != FEATURES:
        raise RuntimeError("the law of change is of other evidence: run benchmarks.compare.calibrate")
    mean, scale, weights = (np.array(law[k], np.float32) for k in ("mean", "scale", "weights"))
    return mean, scale, weights, float(law["offset"])
