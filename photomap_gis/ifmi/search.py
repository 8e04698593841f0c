"""The coarse search: from two frames' spectra to a few candidate motions, best first."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import Similarity2D, wrap_angle
from photomap_gis.ifmi.kernels import Image32, forward_fft, warp_similarity
from photomap_gis.ifmi.logpolar import ANGLE_STEP_RAD, ANGLES, LOG_RADIUS_STEP, RADII
from photomap_gis.ifmi.overlap import Agreement, agreement
from photomap_gis.ifmi.pomf import gaussian_low_pass, pulse_of, whiten
from photomap_gis.ifmi.prior import GATE_SIGMAS, Prior
from photomap_gis.ifmi.pulse import Peak, find_peaks
from photomap_gis.ifmi.spectrum import Spectrum, windowed

ROTATION_LOW_PASS = 0.09
TRANSLATION_LOW_PASS = 0.15
LARGEST_LOG_SCALE = math.log(2.2)
SMALLEST_OVERLAP = 0.08


@dataclass(frozen=True, slots=True)
class Candidate:
    """A motion that the matched filters propose, and how it looks."""

    T_a_b: Similarity2D
    snr: float
    agreement: Agreement


def rotation_pulse(a: Spectrum, b: Spectrum) -> Image32:
    """Return the matched filter's result over turn and scale, ``(ANGLES, RADII)``."""
    low_pass = gaussian_low_pass((ANGLES, RADII), ROTATION_LOW_PASS)
    return pulse_of(a.log_polar_phases, b.log_polar_phases, low_pass)


def turns_and_scales(delta: Image32, count: int, prior: Prior | None) -> list[tuple[float, float, float]]:
    """Return up to ``count`` (angle modulo pi, log scale, snr) read from the rotation pulse's peaks."""
    row = np.arange(ANGLES) * ANGLE_STEP_RAD
    column = -np.fft.fftfreq(RADII, 1.0 / RADII) * LOG_RADIUS_STEP
    if prior is None:
        near = np.ones((ANGLES, 1), bool) & (np.abs(column) <= LARGEST_LOG_SCALE)[None, :]
    else:
        turn = np.abs((row - prior.T_a_b.angle_rad + math.pi / 2) % math.pi - math.pi / 2)
        near = (turn <= GATE_SIGMAS * prior.sigma_angle_rad + 2 * ANGLE_STEP_RAD)[:, None] & (
            np.abs(column - prior.T_a_b.log_scale) <= GATE_SIGMAS * prior.sigma_log_scale + 2 * LOG_RADIUS_STEP
        )[None, :]
    found = []
    for p in find_peaks(delta, count, radius=5, allowed=near.astype(np.float32)):
        shift = p.column if p.column <= RADII / 2 else p.column - RADII
        found.append((p.row * ANGLE_STEP_RAD, -shift * LOG_RADIUS_STEP, p.snr))
    return found


def translations(
    a: Spectrum, b: Spectrum, angle_rad: float, log_scale: float, *, twin: bool, peaks: int
) -> list[Candidate]:
    """Return candidates at one turn and scale, and its twin half a turn further; the wraps of each peak are tested."""
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    f = floor_a.factor
    (ha, wa), (hb, wb) = floor_a.shape, floor_b.shape
    turn = Similarity2D(0.0, 0.0, wrap_angle(angle_rad), log_scale)
    centre_b = turn.apply(((wb - 1) / 2.0, (hb - 1) / 2.0))
    T0 = Similarity2D((wa - 1) / 2.0 - centre_b[0], (ha - 1) / 2.0 - centre_b[1], turn.angle_rad, log_scale)
    B = warp_similarity(windowed(floor_b.values, floor_b.mask)[:hb, :wb], T0, floor_a.shape)
    h, w = a.phases.shape[0], 2 * (a.phases.shape[1] - 1)
    if (h, w) != (ha, wa):
        B = np.pad(B, ((0, h - ha), (0, w - wa)))
    P_B = whiten(forward_fft(B))
    low_pass = gaussian_low_pass((h, w), TRANSLATION_LOW_PASS)
    found: list[Candidate] = []
    for half_turn in (False, True) if twin else (False,):
        if half_turn:
            # The half-turned picture's spectrum is the conjugate: B(-p), which is B turned about pixel (0, 0).
            delta = pulse_of(a.phases, P_B.conj(), low_pass)
            about = Similarity2D(0.0, 0.0, math.pi, 0.0)
            T = about @ T0
        else:
            delta = pulse_of(a.phases, P_B, low_pass)
            T = T0
        for p in find_peaks(delta, peaks):
            found += _wraps(a, b, T, p, (h, w), f)
    return found


def _wraps(a: Spectrum, b: Spectrum, T: Similarity2D, p: Peak, canvas: tuple[int, int], factor: int) -> list[Candidate]:
    h, w = canvas
    test_a, test_b = a.floors[-1], b.floors[-1]
    out = []
    wa, ha = a.size_px
    c = T.apply(((b.size_px[0] / factor - 1) / 2.0, (b.size_px[1] / factor - 1) / 2.0))
    for dy in (p.row - 2 * h, p.row - h, p.row, p.row + h):
        for dx in (p.column - 2 * w, p.column - w, p.column, p.column + w):
            # Centres further apart than the frames reach leave no overlap to speak of.
            if (
                abs(c[0] + dx - wa / factor / 2) > wa / factor * 0.95
                or abs(c[1] + dy - ha / factor / 2) > ha / factor * 0.95
            ):
                continue
            full = Similarity2D((T.tx + dx) * factor, (T.ty + dy) * factor, T.angle_rad, T.log_scale)
            g = agreement(test_a, test_b, full)
            if g.overlap >= SMALLEST_OVERLAP:
                out.append(Candidate(full, p.snr, g))
    return out


def search(a: Spectrum, b: Spectrum, prior: Prior | None = None) -> list[Candidate]:
    """Return candidates, best first."""
    found: list[Candidate] = []
    for angle, log_scale, _ in turns_and_scales(rotation_pulse(a, b), 4, prior):
        found += translations(a, b, angle, log_scale, twin=True, peaks=2)
    return sorted(found, key=lambda c: -c.agreement.evidence)
