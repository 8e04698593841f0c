"""Random fields for scenes and random walks for flights, all from a given generator."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray

FloatImage = npt.NDArray[np.float32]


def fractal_noise(
    shape: tuple[int, int], rng: np.random.Generator, *, wavelength_px: float, octaves: int = 4, gain: float = 0.5
) -> FloatImage:
    """``shape`` float32 smooth noise of mean 0 and sigma about 1, coarsest detail ``wavelength_px`` pixels wide."""
    h, w = shape
    coarse = 4 if min(shape) >= 256 else 1
    # octaves wider than 24 pixels are summed on every fourth pixel: their detail needs no more
    out = np.zeros((h // coarse + 4, w // coarse + 4) if coarse > 1 else shape, np.float32)
    fine = coarse == 1
    amplitude, power = 1.0, 0.0
    for octave in range(octaves):
        step = wavelength_px / 2**octave
        if step < 1.0:
            break
        if not fine and step < 24.0:
            out, fine = _enlarged(out, coarse, shape), True
        factor = 1 if fine else coarse
        _add_octave(out, rng, step / factor, amplitude)
        power += amplitude**2
        amplitude *= gain
    if not fine:
        out = _enlarged(out, coarse, shape)
    return out / np.float32(max(power, 1e-9) ** 0.5)


def _add_octave(out: FloatImage, rng: np.random.Generator, step_px: float, amplitude: float) -> None:
    """Add noise of independent nodes ``step_px`` apart, in place."""
    h, w = out.shape
    grid = rng.standard_normal((int(h / step_px) + 4, int(w / step_px) + 4), dtype=np.float32)
    # 1.18: cubic interpolation between independent nodes loses a part of their sigma
    grid *= np.float32(amplitude * 1.18)
    # the nodes start at a random place: otherwise every octave would share them with the border
    x0, y0 = rng.uniform(1.0, 2.0, 2)
    to_grid = np.array([[1.0 / step_px, 0.0, x0], [0.0, 1.0 / step_px, y0]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    cv2.add(out, cv2.warpAffine(grid, to_grid, (w, h), flags=flags, borderMode=cv2.BORDER_REFLECT), dst=out)


def _enlarged(field: FloatImage, factor: int, shape: tuple[int, int]) -> FloatImage:
    """Return ``shape`` pixels of a field whose pixels are ``factor`` wide."""
    to_field = np.array([[1.0 / factor, 0.0, 1.0], [0.0, 1.0 / factor, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    out: FloatImage = cv2.warpAffine(field, to_field, shape[::-1], flags=flags, borderMode=cv2.BORDER_REFLECT)
    return out


def gauss_markov(times_s: npt.ArrayLike, *, sigma: float, tau_s: float, rng: np.random.Generator) -> FloatArray:
    """``(N,)`` first-order Gauss-Markov process at increasing times: sigma everywhere, correlation exp(-dt / tau).

    A ``tau_s`` of 0 gives white noise.
    """
    t = np.asarray(times_s, dtype=np.float64)
    n = rng.standard_normal(len(t))
    out = np.empty(len(t))
    if len(t) == 0 or sigma == 0.0:
        return np.zeros(len(t))
    decay = np.exp(-np.diff(t) / tau_s) if tau_s > 0 else np.zeros(len(t) - 1)
    out[0] = n[0]
    for k in range(1, len(t)):
        a = decay[k - 1]
        out[k] = a * out[k - 1] + np.sqrt(1.0 - a * a) * n[k]
    return sigma * out


def smooth_process(times_s: FloatArray, *, sigma: float, tau_s: float, rng: np.random.Generator) -> FloatArray:
    """``(N,)`` process of the given sigma that moves without jumps: smooth enough to have a rate (a body's sway).

    Drawn at nodes half a time constant apart and interpolated by Catmull-Rom, so it does not depend on the sampling.
    """
    t = np.asarray(times_s, dtype=np.float64)
    if len(t) == 0 or sigma == 0.0:
        return np.zeros(len(t))
    step = max(tau_s, 1e-3) * 0.7
    nodes = rng.standard_normal(int((t[-1] - t[0]) / step) + 5)
    x = (t - t[0]) / step + 1.0
    k = x.astype(int)
    f = x - k
    p0, p1, p2, p3 = (nodes[k + i] for i in (-1, 0, 1, 2))
    cubic = p1 + 0.5 * f * (p2 - p0 + f * (2 * p0 - 5 * p1 + 4 * p2 - p3 + f * (3 * (p1 - p2) + p3 - p0)))
    # 1.08: interpolation between independent nodes loses a part of their sigma
    return np.asarray(sigma * 1.08 * cubic, dtype=np.float64)
