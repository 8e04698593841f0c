"""The methods that are compared, behind one interface: what is made once a frame, and what is made once a pair."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.ifmi import Prior, make_spectrum, register
from photomap_gis.ifmi.paper import register_literal

from .pairs import Pair
from .pictures import Grey
from .score import centre_of, truth_of

FEWEST_INLIERS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What a method says of a pair. ``covariance`` (4, 4) and ``model_sigma_px`` as in ``core.measurement``."""

    T_a_b: Similarity2D
    accepted: bool
    probability: float
    covariance: FloatArray | None = None
    model_sigma_px: float = 0.0
    method: str = ""


@dataclass(frozen=True, slots=True)
class Method:
    """``prepare`` makes a frame's state, once; ``match`` registers two states, with a prior where one is wanted."""

    name: str
    prepare: Callable[[Grey], Any]
    match: Callable[[Any, Any, Prior | None], Estimate]
    wants_prior: bool = False
    absent: str | None = None
    """Why the method cannot be run here."""

    def __call__(self, a: Grey, b: Grey, prior: Prior | None = None) -> Estimate:
        """Register two frames from scratch."""
        return self.match(self.prepare(a), self.prepare(b), prior)


def ours(name: str, *, fallback: bool, prior: bool = False) -> Method:
    """iFMI alone or with its fallback to features, without or with a prior."""

    def match(a: Any, b: Any, known: Prior | None) -> Estimate:
        r = register(a, b, prior=known, fallback=fallback)
        return Estimate(r.T_a_b, r.accepted, r.probability, r.covariance, r.model_sigma_px, r.method)

    return Method(name, make_spectrum, match, wants_prior=prior)


def literal() -> Method:
    """The paper's Algorithms 1 to 3 with the improvements of its section 2.2; it accepts everything."""

    def match(a: Grey, b: Grey, _: Prior | None) -> Estimate:
        r = register_literal(a, b)
        return Estimate(r.T_a_b, True, 1.0, r.covariance, 0.0, "paper")

    return Method("paper", lambda grey: grey, match)


def imreg_dft() -> Method:
    """The package imreg_dft, three iterations (the setting that its documentation gives for difficult pairs)."""
    if importlib.util.find_spec("imreg_dft") is None:
        return Method("imreg_dft", _never, _never_match, absent="imreg_dft is not installed (pip install '.[bench]')")
    import imreg_dft as package  # an optional dependency

    def match(a: npt.NDArray[Any], b: npt.NDArray[Any], _: Prior | None) -> Estimate:
        found = package.similarity(a, b, numiter=3)
        h, w = b.shape
        dy, dx = found["tvec"]
        turn = Similarity2D(0.0, 0.0, -math.radians(float(found["angle"])), math.log(float(found["scale"])))
        T = Similarity2D.translation_of(dx, dy) @ turn.about(-(w - 1) / 2.0, -(h - 1) / 2.0)
        return Estimate(T, True, float(found["success"]), method="imreg_dft")

    return Method("imreg_dft", lambda grey: grey.astype(np.float64), match)


Model = Literal["similarity", "homography"]


@dataclass(frozen=True, slots=True)
class FeatureSetting:
    """How features are found, matched and voted on.

    ``similarity`` is RANSAC on the four degrees of freedom asked for; ``homography`` is USAC (MAGSAC++) on eight, of
    which the closest similarity over what both frames then share is handed out.
    """

    detector: str
    count: int
    clahe: float = 0.0
    ratio: float = 0.85
    model: Model = "similarity"
    within_px: float = 4.0
    threshold: float = 7.0
    """ORB: FAST's threshold in grey levels. SIFT: the contrast threshold in percent."""

    @property
    def name(self) -> str:
        """A short name that tells settings apart."""
        extras = f"+clahe{self.clahe:g}" if self.clahe else ""
        vote = f"{self.model[:3]}{self.within_px:g}"
        return f"{self.detector}-{self.count}{extras}-r{self.ratio:g}-{vote}-t{self.threshold:g}"


@dataclass(frozen=True, slots=True, eq=False)
class _Features:
    shape: tuple[int, ...]
    points: npt.NDArray[np.float32]
    descriptors: npt.NDArray[Any] | None


def features(setting: FeatureSetting, name: str | None = None) -> Method:
    """Features, mutual ratio-tested matches, and a similarity voted for by RANSAC or one of its kin."""
    detector = _detector(setting)
    clahe = cv2.createCLAHE(setting.clahe, (8, 8)) if setting.clahe else None
    binary = setting.detector == "orb"
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING if binary else cv2.NORM_L2)

    def prepare(grey: Grey) -> _Features:
        keypoints, descriptors = detector.detectAndCompute(grey if clahe is None else clahe.apply(grey), None)
        if descriptors is not None and not binary:  # RootSIFT
            descriptors = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
        return _Features(grey.shape, np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2), descriptors)

    def match(a: _Features, b: _Features, _: Prior | None) -> Estimate:
        da, db = a.descriptors, b.descriptors
        if da is None or db is None or len(da) < 2 or len(db) < 2:
            return _abstention(setting.detector)
        found = [m[0] for m in matcher.knnMatch(db, da, 2) if m[0].distance < setting.ratio * m[1].distance]
        if len(found) < 4:
            return _abstention(setting.detector)
        p_b = b.points[[m.queryIdx for m in found]]
        p_a = a.points[[m.trainIdx for m in found]]
        fit = _similarity if setting.model == "similarity" else _homography
        T, votes = fit(p_a, p_b, setting.within_px, b.shape)
        if T is None:
            return _abstention(setting.detector)
        sane = 0.4 < T.scale < 2.5
        return Estimate(T, votes >= FEWEST_INLIERS and sane, votes / (votes + 10.0), method=setting.detector)

    return Method(name or setting.name, prepare, match)


def _similarity(
    p_a: npt.NDArray[np.float32], p_b: npt.NDArray[np.float32], within_px: float, _: tuple[int, ...]
) -> tuple[Similarity2D | None, int]:
    cv2.setRNGSeed(1)  # the same pair, the same answer
    M, inliers = cv2.estimateAffinePartial2D(
        p_b, p_a, method=cv2.RANSAC, ransacReprojThreshold=within_px, maxIters=2000, confidence=0.995
    )
    if M is None or not np.hypot(M[0, 0], M[1, 0]) > 1e-3:
        return None, 0
    scale = float(np.hypot(M[0, 0], M[1, 0]))
    T = Similarity2D(float(M[0, 2]), float(M[1, 2]), math.atan2(M[1, 0], M[0, 0]), math.log(scale))
    return T, int(inliers.sum())


def _homography(
    p_a: npt.NDArray[np.float32], p_b: npt.NDArray[np.float32], within_px: float, shape: tuple[int, ...]
) -> tuple[Similarity2D | None, int]:
    H, inliers = cv2.findHomography(p_b, p_a, cv2.USAC_MAGSAC, within_px, maxIters=2000, confidence=0.995)
    if H is None:
        return None, 0
    h, w = shape
    grid = np.stack([v.ravel() for v in np.meshgrid(np.linspace(0, w - 1, 17), np.linspace(0, h - 1, 17))], axis=1)
    q = np.c_[grid, np.ones(len(grid))] @ H.T
    there = q[:, :2] / q[:, 2:]
    inside = (q[:, 2] > 0) & (there >= 0).all(axis=1) & (there <= (w - 1, h - 1)).all(axis=1)
    if int(inside.sum()) < 4:
        return None, 0
    return fit_similarity(there[inside], grid[inside]), int(inliers.sum())


def _detector(setting: FeatureSetting) -> Any:
    if setting.detector == "orb":
        # The default border of 31 pixels would throw away half of a small frame.
        return cv2.ORB.create(
            nfeatures=setting.count, edgeThreshold=12, patchSize=25, fastThreshold=round(setting.threshold)
        )
    return cv2.SIFT.create(nfeatures=setting.count, contrastThreshold=setting.threshold / 100.0)


def _abstention(method: str) -> Estimate:
    return Estimate(Similarity2D.identity(), False, 0.0, method=method)


def _never(_: Grey) -> Any:
    raise RuntimeError("this method is absent")


def _never_match(a: Any, b: Any, _: Prior | None) -> Estimate:
    raise RuntimeError("this method is absent")


@dataclass(frozen=True, slots=True)
class PriorSpread:
    """One-sigmas of what is known before: shares of the width, degrees, natural logarithm."""

    xy: float
    angle_deg: float
    log_scale: float


TRACKING = PriorSpread(xy=0.03, angle_deg=2.0, log_scale=0.02)
"""What the previous motion says of the next one, at video rate."""
LOOP = PriorSpread(xy=0.06, angle_deg=4.0, log_scale=0.04)
"""What a pose graph says of two frames of a loop that is about to be closed."""


def prior_of(pair: Pair, spread: PriorSpread, rng: np.random.Generator) -> Prior:
    """Return a prior that errs from the truth as it says it does."""
    sigma_xy, sigma_angle = spread.xy * pair.size_px[0], math.radians(spread.angle_deg)
    drawn = np.clip(rng.standard_normal(4), -2.5, 2.5)
    off = Similarity2D.exp(drawn * (sigma_xy, sigma_xy, sigma_angle, spread.log_scale))
    centre = Similarity2D.translation_of(*centre_of(pair))
    T = truth_of(pair) @ centre @ off @ centre.inverse()
    return Prior(T, sigma_xy, sigma_angle, spread.log_scale)


ORB = FeatureSetting("orb", 1500, model="homography", within_px=6.0, threshold=3.0)
SIFT = FeatureSetting("sift", 1200, model="homography", threshold=0.4)
"""The settings of best success, chosen on the tuning pictures."""
CURVE: tuple[FeatureSetting, ...] = (
    *(FeatureSetting("orb", n, threshold=3.0) for n in (250, 500, 1000, 2000)),
    *(FeatureSetting("orb", n, model="homography", within_px=6.0, threshold=3.0) for n in (500, 1000, 2500)),
    FeatureSetting("orb", 1500, clahe=3.0),
    *(FeatureSetting("sift", n, threshold=0.4) for n in (150, 300, 600)),
    FeatureSetting("sift", 1200, threshold=0.4),
    FeatureSetting("sift", 800, clahe=3.0, threshold=1.5),
)
_MAKERS: dict[str, Callable[[], Method]] = {
    "ifmi": lambda: ours("ifmi", fallback=False),
    "ifmi+features": lambda: ours("ifmi+features", fallback=True),
    "ifmi-tracking": lambda: ours("ifmi-tracking", fallback=False, prior=True),
    "ifmi-loop": lambda: ours("ifmi-loop", fallback=False, prior=True),
    "paper": literal,
    "imreg_dft": imreg_dft,
    "orb": lambda: features(ORB, "orb"),
    "sift": lambda: features(SIFT, "sift"),
    **{s.name: (lambda s=s: features(s)) for s in CURVE},  # type: ignore[misc]
}


@lru_cache(maxsize=64)
def method_named(name: str) -> Method:
    """Return a method by its name, made once a process."""
    if name not in _MAKERS:
        raise ValueError(f"name must be one of {', '.join(_MAKERS)}, got {name!r}")
    return _MAKERS[name]()
