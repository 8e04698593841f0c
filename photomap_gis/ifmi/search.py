"""The coarse search: from two frames' spectra to candidate motions, the likeliest first.

Without a prior the log-polar spectra propose turns and scales, each of which is tried with its twin half a turn
further. With one, only what it admits is tried, and both pictures are windowed to the overlap it predicts: a small
overlap is then compared with nothing but itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D, wrap_angle
from photomap_gis.ifmi.kernels import Image32, Spectrum64, fft_size, forward_fft, warp_similarity
from photomap_gis.ifmi.logpolar import ANGLE_STEP_RAD, ANGLES, LOG_RADIUS_STEP, RADII
from photomap_gis.ifmi.overlap import agreement, on_floor
from photomap_gis.ifmi.pomf import gaussian_low_pass, phase_pulse, pulse_of, whiten
from photomap_gis.ifmi.prior import GATE_SIGMAS, Prior
from photomap_gis.ifmi.pulse import find_peaks
from photomap_gis.ifmi.spectrum import SHIFT_TAPER, Floor, Spectrum, on_canvas, windowed
from photomap_gis.ifmi.window import tukey

ROTATION_LOW_PASS = 0.08
SHIFT_LOW_PASS = 0.24
BOX_TAPER = 0.4
NARROWEST_BOX_PX = 8
LARGEST_LOG_SCALE = math.log(2.2)
SMALLEST_OVERLAP = 0.08
BATCHES = (2, 4, 6)
"""How many log-polar peaks are tried at a time, before the best of them are handed out."""
HANDED_OUT = 2
PEAKS = 2
SURE_ANGLE_RAD = math.radians(0.7)
SURE_LOG_SCALE = 0.01
"""A prior that is surer than this of turn and scale is taken at its word by the matched filter of the shift."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A motion that the matched filters propose; ``snr`` is its pulse's height over the pulse's scatter."""

    T_a_b: Similarity2D
    snr: float


def search(a: Spectrum, b: Spectrum, prior: Prior | None = None) -> Iterator[Candidate]:
    """Yield candidates, the likeliest first; later ones cost more work, so stop when one has convinced."""
    if prior is not None and prior.restricts(a.size_px):
        yield from _near(a, b, prior)
        return
    delta = pulse_of(a.log_polar_phases, b.log_polar_phases, gaussian_low_pass((ANGLES, RADII), ROTATION_LOW_PASS))
    turns = turns_and_scales(delta, sum(BATCHES), prior)
    left: list[tuple[float, Similarity2D, float, float]] = []
    done = 0
    for size in BATCHES:
        batch = turns[done : done + size]
        done += size
        for angle_rad, log_scale in batch:
            left += _pulses(a, b, angle_rad, log_scale)
        left.sort(key=lambda found: -found[0])
        for snr, T0, column, row in left[:HANDED_OUT]:
            T = _unwrapped(a, b, T0, column, row)
            if T is not None:
                yield Candidate(T, snr)
        left = left[HANDED_OUT:]


def turns_and_scales(delta: Image32, count: int, prior: Prior | None) -> list[tuple[float, float]]:
    """Return up to ``count`` (angle modulo pi, log scale) of the log-polar pulse's peaks, within the prior's gate."""
    row = np.arange(ANGLES) * ANGLE_STEP_RAD
    column = -np.fft.fftfreq(RADII, 1.0 / RADII) * LOG_RADIUS_STEP
    if prior is None:
        admitted = np.broadcast_to((np.abs(column) <= LARGEST_LOG_SCALE)[None, :], delta.shape)
    else:
        turn = np.abs((row - prior.T_a_b.angle_rad + math.pi / 2) % math.pi - math.pi / 2)
        growth = np.abs(column - prior.T_a_b.log_scale)
        admitted = (turn <= GATE_SIGMAS * prior.sigma_angle_rad + 2 * ANGLE_STEP_RAD)[:, None] & (
            growth <= GATE_SIGMAS * prior.sigma_log_scale + 2 * LOG_RADIUS_STEP
        )[None, :]
    found = []
    for p in find_peaks(delta, count, radius=4, allowed=admitted):
        shift = p.column if p.column <= RADII / 2 else p.column - RADII
        found.append((p.row * ANGLE_STEP_RAD, -shift * LOG_RADIUS_STEP))
    return found


def _pulses(
    a: Spectrum, b: Spectrum, angle_rad: float, log_scale: float
) -> list[tuple[float, Similarity2D, float, float]]:
    """Return (snr, T0, column, row) of the shift pulses at one turn and scale and at its twin.

    ``T0`` lays b's centre on a's, in the spectral floor's pixels; the shift is still modulo the canvas.
    """
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    T0 = _centred(floor_a, floor_b, angle_rad, log_scale)
    (hb, wb), canvas = floor_b.shape, _canvas(a.phases)
    faded = windowed(floor_b.values, floor_b.mask, SHIFT_TAPER)[:hb, :wb]
    P_B = whiten(forward_fft(on_canvas(warp_similarity(faded, T0, floor_a.shape), canvas)))
    low_pass = gaussian_low_pass(canvas, SHIFT_LOW_PASS)
    found = [(p.snr, T0, p.column, p.row) for p in find_peaks(pulse_of(a.phases, P_B, low_pass), PEAKS)]
    # A picture turned by half a turn about pixel (0, 0) has the conjugate spectrum: the twin costs one transform.
    twin = Similarity2D(0.0, 0.0, math.pi, 0.0) @ T0
    found += [(p.snr, twin, p.column, p.row) for p in find_peaks(pulse_of(a.phases, P_B.conj(), low_pass), PEAKS)]
    return found


def _unwrapped(a: Spectrum, b: Spectrum, T0: Similarity2D, column: float, row: float) -> Similarity2D | None:
    """Return the motion in frame pixels, of all shifts modulo the canvas the one whose overlap agrees best."""
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    (h, w), (hb, wb), f = _canvas(a.phases), floor_b.shape, floor_a.factor
    (ha, wa) = floor_a.shape
    cx, cy = T0.apply(((wb - 1) / 2.0, (hb - 1) / 2.0))
    best, best_evidence = None, 0.0
    for dy in (row - 2 * h, row - h, row, row + h):
        for dx in (column - 2 * w, column - w, column, column + w):
            # Centres further apart than this leave no overlap to speak of.
            if abs(cx + dx - wa / 2) > 0.95 * wa or abs(cy + dy - ha / 2) > 0.95 * ha:
                continue
            T = Similarity2D((T0.tx + dx) * f, (T0.ty + dy) * f, wrap_angle(T0.angle_rad), T0.log_scale)
            seen = agreement(a.floors[-1], b.floors[-1], T)
            if seen.overlap >= SMALLEST_OVERLAP and seen.evidence > best_evidence:
                best, best_evidence = T, seen.evidence
    return best


def _near(a: Spectrum, b: Spectrum, prior: Prior) -> Iterator[Candidate]:
    """Yield what the prior admits: first what a coarse floor sees of it, then the likeliest turns."""
    k = a.spectral
    as_expected = (prior.T_a_b.angle_rad, prior.T_a_b.log_scale)
    if k + 1 < len(a.floors):
        yield from _shifts(a.floors[k + 1], b.floors[k + 1], [as_expected], prior, peaks=1)
    turns = []
    if prior.sigma_angle_rad > SURE_ANGLE_RAD or prior.sigma_log_scale > SURE_LOG_SCALE:
        delta = pulse_of(a.log_polar_phases, b.log_polar_phases, gaussian_low_pass((ANGLES, RADII), ROTATION_LOW_PASS))
        turns = turns_and_scales(delta, 2, prior)
    yield from _shifts(a.floors[k], b.floors[k], [*turns, as_expected], prior, peaks=PEAKS)


def _shifts(a: Floor, b: Floor, turns: list[tuple[float, float]], prior: Prior, *, peaks: int) -> Iterator[Candidate]:
    """Yield the best shifts that the prior admits at every turn (modulo pi) and scale, seen on one floor."""
    f = a.factor
    T_prior = on_floor(prior.T_a_b, f)
    window, middle_a = _window_over(a, b, T_prior)
    middle_b = T_prior.inverse().apply(middle_a)
    canvas = (fft_size(a.shape[0]), fft_size(a.shape[1]))
    low_pass = gaussian_low_pass(canvas, SHIFT_LOW_PASS)
    F_A = forward_fft(on_canvas(a.values * window, canvas))
    admitted = _around_zero(canvas, round(GATE_SIGMAS * prior.sigma_xy_px / f + 2.0))
    for angle_rad, log_scale in turns:
        if math.cos(angle_rad - prior.T_a_b.angle_rad) < 0.0:
            angle_rad += math.pi
        turn = Similarity2D(0.0, 0.0, wrap_angle(angle_rad), log_scale)
        t = middle_a - turn.apply(middle_b)
        T0 = Similarity2D(float(t[0]), float(t[1]), turn.angle_rad, log_scale)
        B = warp_similarity(b.values, T0, a.shape)
        B *= window
        delta = phase_pulse(F_A, forward_fft(on_canvas(B, canvas)), low_pass)
        for p in find_peaks(delta, peaks, allowed=admitted):
            dx = p.column if p.column <= canvas[1] / 2 else p.column - canvas[1]
            dy = p.row if p.row <= canvas[0] / 2 else p.row - canvas[0]
            yield Candidate(Similarity2D((T0.tx + dx) * f, (T0.ty + dy) * f, T0.angle_rad, log_scale), p.snr)


def _window_over(a: Floor, b: Floor, T: Similarity2D) -> tuple[Image32, FloatArray]:
    """``(h, w)`` window over a that shows the box around the predicted overlap, and the box's middle."""
    (h, w), (hb, wb) = a.shape, b.shape
    corners = T.apply(((0.0, 0.0), (wb - 1.0, 0.0), (0.0, hb - 1.0), (wb - 1.0, hb - 1.0)))
    x0, y0 = (max(0, math.floor(v)) for v in corners.min(axis=0).tolist())
    x1, y1 = (min(side, math.ceil(v) + 1) for v, side in zip(corners.max(axis=0).tolist(), (w, h), strict=True))
    if min(x1 - x0, y1 - y0) < NARROWEST_BOX_PX:
        return np.ones((h, w), np.float32), np.array([(w - 1) / 2.0, (h - 1) / 2.0])
    window = np.zeros((h, w), np.float32)
    window[y0:y1, x0:x1] = np.outer(tukey(y1 - y0, BOX_TAPER), tukey(x1 - x0, BOX_TAPER))
    return window, np.array([(x0 + x1 - 1) / 2.0, (y0 + y1 - 1) / 2.0])


@lru_cache(maxsize=64)
def _around_zero(canvas: tuple[int, int], radius_px: int) -> npt.NDArray[np.bool_]:
    y = np.fft.fftfreq(canvas[0], 1.0 / canvas[0])[:, None]
    x = np.fft.fftfreq(canvas[1], 1.0 / canvas[1])[None, :]
    near = x * x + y * y <= radius_px**2
    near.setflags(write=False)
    return near


def _centred(a: Floor, b: Floor, angle_rad: float, log_scale: float) -> Similarity2D:
    """Return the motion of one turn and scale that lays b's centre on a's."""
    turn = Similarity2D(0.0, 0.0, wrap_angle(angle_rad), log_scale)
    x, y = turn.apply(((b.shape[1] - 1) / 2.0, (b.shape[0] - 1) / 2.0))
    return Similarity2D((a.shape[1] - 1) / 2.0 - x, (a.shape[0] - 1) / 2.0 - y, turn.angle_rad, log_scale)


def _canvas(half: Spectrum64) -> tuple[int, int]:
    return half.shape[0], 2 * (half.shape[1] - 1)
