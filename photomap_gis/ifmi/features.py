"""The fallback: features where the spectra abstain (small overlap, parallax), behind the same judgement.

SIFT keypoints of the working picture, made on first use and kept with the spectrum; mutual matches by the ratio test;
similarities by RANSAC. They are only *candidates*: refinement and judgement are those of the spectra's.
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from weakref import WeakKeyDictionary

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import fit_similarity
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.search import Candidate
from photomap_gis.ifmi.spectrum import Spectrum

MOST_FEATURES = 1500
CONTRAST_THRESHOLD = 0.01
RATIO = 0.85
RANSAC_PX = 4.0
FEWEST_INLIERS = 4
"""Few are enough for a candidate: whether it is right, refinement and judgement will tell."""
EQUALISER = cv2.createCLAHE(2.0, (8, 8))
"""Calm ground has its detail raised before features are looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """``(N, 2)`` float32 points and their ``(N, 128)`` uint8 RootSIFT descriptors (scaled by 512)."""

    points: npt.NDArray[np.float32]
    descriptors: npt.NDArray[np.uint8]


_KEPT: WeakKeyDictionary[Spectrum, Features] = WeakKeyDictionary()
_KEPT_LOCK = Lock()


def features_of(spectrum: Spectrum) -> Features:
    """Return a frame's features, made once and kept as long as its spectrum lives."""
    with _KEPT_LOCK:
        kept = _KEPT.get(spectrum)
    if kept is None:  # two threads may both make them: they come out equal
        kept = make_features(spectrum)
        with _KEPT_LOCK:
            _KEPT[spectrum] = kept
    return kept


def make_features(spectrum: Spectrum) -> Features:
    """Return the features of a frame's working picture."""
    sift = cv2.SIFT.create(nfeatures=MOST_FEATURES, contrastThreshold=CONTRAST_THRESHOLD)
    mask = None if spectrum.mask is None else spectrum.mask.astype(np.uint8) * 255
    keypoints, descriptors = sift.detectAndCompute(EQUALISER.apply(spectrum.grey), mask)
    if descriptors is None or len(keypoints) == 0:
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    points = np.array([k.pt for k in keypoints], np.float32)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
    return Features(points, np.clip(np.rint(root * 512.0), 0, 255).astype(np.uint8))


def feature_candidates(a: Spectrum, b: Spectrum, prior: Prior | None) -> list[Candidate]:
    """Return the motions that matched features propose, best first; empty where there are too few."""
    fa, fb = features_of(a), features_of(b)
    if len(fa.points) < FEWEST_INLIERS or len(fb.points) < FEWEST_INLIERS:
        return []
    rows, columns = _mutual_matches(fa, fb)
    if len(rows) < FEWEST_INLIERS:
        return []
    pa, pb = fa.points[rows], fb.points[columns]
    found: list[Candidate] = []
    for _ in range(3):  # every further round looks for another motion among what the others left over
        matrix, inliers = cv2.estimateAffinePartial2D(
            pb, pa, method=cv2.RANSAC, ransacReprojThreshold=RANSAC_PX, maxIters=3000, confidence=0.999
        )
        if matrix is None:
            break
        inside = inliers.ravel().astype(bool)
        n = int(inside.sum())
        if n < FEWEST_INLIERS:
            break
        try:
            T = fit_similarity(pa[inside], pb[inside])
        except ValueError:
            break
        if abs(T.log_scale) < 1.2 and (prior is None or prior.admits(T, b.size_px)):
            found.append(Candidate(T, float(n)))
        pa, pb = pa[~inside], pb[~inside]
        if len(pa) < FEWEST_INLIERS:
            break
    return sorted(found, key=lambda c: -c.snr)


def _mutual_matches(fa: Features, fb: Features) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return index pairs of features that are each other's nearest and clearly nearer than the second."""
    A, B = fa.descriptors.astype(np.float32), fb.descriptors.astype(np.float32)
    distance2 = np.sum(A * A, axis=1)[:, None] + np.sum(B * B, axis=1)[None, :] - 2.0 * (A @ B.T)
    index = np.arange(len(A))
    nearest = np.argmin(distance2, axis=1)
    first = distance2[index, nearest]
    back = np.argmin(distance2, axis=0)
    distance2[index, nearest] = np.inf
    second = distance2.min(axis=1)
    keep = (back[nearest] == index) & (first < RATIO**2 * second)
    return index[keep], nearest[keep]
