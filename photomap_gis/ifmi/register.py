"""Registration of two frames: Algorithm 2 of the paper, with its improvements, refinement and judgement."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi.decide import decide
from photomap_gis.ifmi.features import feature_candidates
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.search import Candidate, search
from photomap_gis.ifmi.spectrum import FINEST_SIDE_PX, Spectrum, make_spectrum, of_one_scale
from photomap_gis.ifmi.validity import ACCEPT, probability_of
from photomap_gis.ifmi.working import shrink, to_grey

logger = logging.getLogger(__name__)

WORKING_SIDE_PX = 512


def register(
    spectrum_a: Spectrum, spectrum_b: Spectrum, *, prior: Prior | None = None, fallback: bool = True
) -> Registration:
    """Return the motion between two frames, in the pixels of the pictures the spectra were made of.

    Algorithm 2 of the paper: the log-polar spectra's pulse gives turn and scale, the spectra's pulse the shift
    (``search``, which tries several peaks, both twins and all wraps); then a photometric refinement and a judgement
    that may abstain. Where it abstains, ``fallback`` tries features.
    """
    spectrum_a, spectrum_b = of_one_scale(spectrum_a, spectrum_b)
    result = _registered(spectrum_a, spectrum_b, search(spectrum_a, spectrum_b, prior), prior, "ifmi")
    if fallback and not result.accepted:
        by_features = _registered(
            spectrum_a, spectrum_b, feature_candidates(spectrum_a, spectrum_b, prior), prior, "features"
        )
        if by_features.probability > result.probability:
            result = by_features
    return result


def register_images(
    a: ImageArray,
    b: ImageArray,
    *,
    fallback: bool = True,
    mask_a: npt.NDArray[np.bool_] | None = None,
    mask_b: npt.NDArray[np.bool_] | None = None,
) -> Registration:
    """Return the motion ``T_a_b`` between two uint8 pictures, grey or BGR, of the same size, without any prior.

    Masks are ``(h, w)``, True where a picture may be used. Pictures are compared at a working size; the result is in
    the pixels of the pictures given.
    """
    if a.shape[:2] != b.shape[:2]:
        raise ValueError(f"pictures must have the same size, got {a.shape[:2]} and {b.shape[:2]}")
    spectrum_a, T_a_worka = _spectrum_of(a, mask_a)
    spectrum_b, T_b_workb = _spectrum_of(b, mask_b)
    r = register(spectrum_a, spectrum_b, fallback=fallback)
    if a.shape[:2] == spectrum_a.shape:
        return r
    k = T_b_workb.scale
    unit = np.array([k, k, 1.0, 1.0])

    def carried(T: Similarity2D) -> Similarity2D:
        return T_a_worka @ T @ T_b_workb.inverse()

    return replace(
        r,
        T_a_b=carried(r.T_a_b),
        covariance=r.covariance * np.outer(unit, unit),
        model_sigma_px=r.model_sigma_px * k,
        size_b_px=(b.shape[1], b.shape[0]),
        alternatives=tuple(carried(T) for T in r.alternatives),
        ties=None if r.ties is None else r.ties.carried(T_a_worka, T_b_workb),
        H_a_b=None if r.H_a_b is None else T_a_worka.matrix @ r.H_a_b @ T_b_workb.inverse().matrix,
    )


def _registered(
    a: Spectrum, b: Spectrum, candidates: Iterable[Candidate], prior: Prior | None, method: str
) -> Registration:
    found = decide(a, b, candidates, prior)
    if found is None:
        return _nothing(a, b, prior, method)
    measured = found.measured
    probability = probability_of(found.evidence)
    if prior is not None and not prior.admits(measured.T_a_b, b.size_px):
        probability = 0.0
    logger.debug("%d-%d %s %.3f %s", a.index, b.index, method, probability, found.evidence)
    return Registration(
        T_a_b=measured.T_a_b,
        covariance=measured.covariance,
        probability=probability,
        size_b_px=b.size_px,
        model_sigma_px=measured.model_sigma_px,
        accepted=probability >= ACCEPT,
        method=method,
        overlap=measured.overlap,
        correlation=measured.correlation,
        alternatives=found.alternatives,
        a=a.index,
        b=b.index,
        H_a_b=measured.H_a_b,
        ties=measured.ties,
    )


def _nothing(a: Spectrum, b: Spectrum, prior: Prior | None, method: str) -> Registration:
    """Return the registration that says nothing: the prior's motion or none, as wide as the frame."""
    side = float(max(b.shape))
    if prior is None:
        T, wide = Similarity2D.identity(), np.diag([side**2, side**2, 4.0, 0.5])
    else:
        T = prior.T_a_b
        wide = np.diag(
            [
                (prior.sigma_xy_px / T.scale) ** 2,
                (prior.sigma_xy_px / T.scale) ** 2,
                prior.sigma_angle_rad**2,
                prior.sigma_log_scale**2,
            ]
        )
    return Registration(T, wide, 0.0, b.size_px, method=method, a=a.index, b=b.index)


def _spectrum_of(image: ImageArray, mask: npt.NDArray[np.bool_] | None) -> tuple[Spectrum, Similarity2D]:
    """Return a picture's spectrum at the working size, and ``T_image_work``."""
    grey = to_grey(image)
    if max(grey.shape) <= FINEST_SIDE_PX:
        return make_spectrum(np.ascontiguousarray(grey), mask=mask), Similarity2D.identity()
    small, T_image_small = shrink(grey, WORKING_SIDE_PX)
    small_mask = None
    if mask is not None:
        share, _ = shrink(mask.astype(np.uint8) * np.uint8(255), WORKING_SIDE_PX)
        small_mask = share > 250
    return make_spectrum(small, mask=small_mask), T_image_small
