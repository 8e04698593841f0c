"""The phase-only matched filter (Algorithm 1 of the paper), whole and in the pieces that caching needs.

The filter turns two spectra into a pulse at the shift between their pictures. Spectra are kept *whitened* (every
coefficient of length one), so that a pair costs one product and one inverse transform.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from photomap_gis.ifmi.kernels import Image32, Spectrum64, forward_fft, inverse_fft
from photomap_gis.ifmi.passes import phase_difference, whitened


def pomf(A: Image32, B: Image32) -> Image32:
    """Return the pulse Delta of two real matrices of equal, even shape (Algorithm 1).

    Where ``A(p) = B(p - d)`` (periodically) the result is a Dirac pulse at d, modulo the shape; rows are y.
    """
    F_A = forward_fft(A)
    F_B = forward_fft(B)
    return pulse_of(whiten(F_A), whiten(F_B))


def whiten(F: Spectrum64) -> Spectrum64:
    """Return ``exp(i PHASE(F))``; coefficients without a phase stay 0."""
    white = np.empty_like(F)
    whitened(F, white)
    return white


def half_whiten(F: Spectrum64) -> Spectrum64:
    """Return ``F / sqrt(|F|)``: between a phase-only (whitened) and an ordinary matched filter."""
    return np.asarray(F * (np.float32(1.0) / np.sqrt(np.abs(F) + np.float32(1e-12))), np.complex64)


def pulse_of(P_A: Spectrum64, P_B: Spectrum64, low_pass: Image32 | None = None) -> Image32:
    """``IFFT(exp(i D))`` of two whitened spectra, D the difference of their phases, optionally low-passed.

    ``low_pass`` is real, of the spectra's shape: the paper's interpolation filter on the pulse, which gathers the
    energy of one pulse that fell between cells; applied here, where it costs a product.
    """
    D = P_A * P_B.conj()
    if low_pass is not None:
        D *= low_pass
    return inverse_fft(D)


def phase_pulse(F_A: Spectrum64, F_B: Spectrum64, low_pass: Image32) -> Image32:
    """Return ``pulse_of`` the whitened spectra, of which neither need be whitened before."""
    D = np.empty_like(F_A)
    phase_difference(F_A, F_B, low_pass, D)
    return inverse_fft(D)


@lru_cache(maxsize=32)
def gaussian_low_pass(shape: tuple[int, int], sigma: float, sigma_rows: float | None = None) -> Image32:
    """``(h, w // 2 + 1)`` Gaussian over the half spectrum of a ``shape`` image, sigmas in cycles a sample.

    Scaled such that the pulse of two identical pictures has the height 1.
    """
    h, w = shape
    fy = np.fft.fftfreq(h)[:, None] / (sigma if sigma_rows is None else sigma_rows)
    fx = np.fft.rfftfreq(w)[None, :] / sigma
    g = np.exp(-0.5 * (fx**2 + fy**2))
    weight = np.full(g.shape[1], 2.0)
    weight[0] = weight[-1] = 1.0
    low_pass: Image32 = (g * (h * w / np.sum(g * weight))).astype(np.float32)
    low_pass.setflags(write=False)
    return low_pass
