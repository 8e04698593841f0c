"""From a candidate motion to a measured one: refined, bent where the ground or the camera bends it, cross-examined."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.blocks import BlockMotion, block_motion
from photomap_gis.ifmi.field import Field, Frame, fit_field
from photomap_gis.ifmi.overlap import Agreement, agreement
from photomap_gis.ifmi.refine import Fit, refine
from photomap_gis.ifmi.repeats import Repeat, closest_repeat
from photomap_gis.ifmi.spectrum import Spectrum
from photomap_gis.ifmi.tiles import TilePulses, tile_pulses

CORRELATED_RESIDUALS = 3.0
NOISY_SLOPES = 50.0
LARGEST_INFLATION = 30.0
"""Variances that take residuals for independent and slopes for exact grow by CORRELATED_RESIDUALS + NOISY_SLOPES times
what the correlation lacks to 1 (calibrated on known truth: 3 at 0.98, 11 at 0.85, 30 below 0.5)."""
SCATTER_SHARE = 0.5
"""How much of relief's scatter enters the motion's covariance as if every block drew it anew (calibrated)."""
BEND_SHARE = 0.08
"""How much of the bend enters the motion's covariance: the field's form is not exactly the ground's (calibrated)."""
LEAST_SIGMA_PX = 0.01
OBVIOUS = 40.0
"""Where tiles speak this clearly for the similarity, the bend need not be looked for before the blocks do."""
FEWEST_BLOCKS = 6
TILE_SIGMA_PX = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """A refined candidate, cross-examined: worth measuring or not."""

    T_a_b: Similarity2D
    field: Field | None
    tiles: TilePulses | None
    fit: Fit
    snr: float

    @property
    def strength(self) -> float:
        """How clearly the tiles speak for it."""
        return 0.0 if self.tiles is None else self.tiles.summed_snr


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The final motion with its uncertainty, and the witnesses' words."""

    T_a_b: Similarity2D
    covariance: FloatArray
    model_sigma_px: float
    agreeing: int
    blocks: int
    tiles: TilePulses | None
    agreement: Agreement
    repeat: Repeat | None = None
    H_a_b: FloatArray | None = None


def follow(a: Spectrum, b: Spectrum, T_a_b: Similarity2D, snr: float) -> Lead:
    """Refine a candidate on the coarse floors and ask the tiles, twice: first where they point, then whether there."""
    k = min(a.spectral, b.spectral)
    fit = refine(a.floors[: k - 1 if k else None : -1], b.floors[: k - 1 if k else None : -1], T_a_b, steps=8)
    if fit.support == 0.0:
        return Lead(T_a_b, None, None, fit, snr)
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    tiles = tile_pulses(floor_a, floor_b, fit.T_a_b.matrix)
    if tiles is None or len(tiles.near) < 2:
        return Lead(fit.T_a_b, None, tiles, fit, snr)
    if tiles.summed_snr >= OBVIOUS and float(tiles.near.mean()) >= 0.9:
        return Lead(fit.T_a_b, None, tiles, fit, snr)
    frame = Frame(*b.size_px)
    f = floor_b.factor
    back = np.linalg.inv(fit.T_a_b.linear)
    noise2 = (TILE_SIGMA_PX * f) ** 2 * (6.0 / np.maximum(tiles.snr, 3.0)) ** 2
    field = fit_field(frame, tiles.centre, tiles.shift @ back.T, noise2, scatter_share=1.0, start_px=8.0 * f)
    bent = tile_pulses(floor_a, floor_b, field.matrix(fit.T_a_b))
    if bent is None or bent.summed_snr <= tiles.summed_snr:
        return Lead(fit.T_a_b, None, tiles, fit, snr)
    return Lead(fit.T_a_b, field, bent, fit, snr)


def measure(a: Spectrum, b: Spectrum, lead: Lead) -> Measured:
    """Return the motion closest to the whole overlap, its covariance and model sigma."""
    frame = Frame(*b.size_px)
    last = a.spectral + 1
    floors_a, floors_b = a.floors[:last][::-1], b.floors[:last][::-1]
    bend = (lambda p: np.zeros_like(p)) if lead.field is None else lead.field.displacement
    motion = block_motion(floors_a, floors_b, lead.T_a_b, bend, steps=3)
    field = _field_of(frame, motion)
    if field is not None:
        # Once more along the field found: blocks then differ from it by relief and noise only.
        motion = block_motion(floors_a[-1:], floors_b[-1:], lead.T_a_b, field.displacement, steps=2)
        field = _field_of(frame, motion)
    blocks = int(motion.visible.sum())
    if field is None:
        return _unsettled(a, b, lead, blocks)
    p = _seen(a, frame, lead.T_a_b, field)
    correction, covariance, bend2 = field.closest_similarity(p)
    unit = np.array([1.0, 1.0, 1.0 / frame.reach_px, 1.0 / frame.reach_px])
    covariance = covariance + np.diag((LEAST_SIGMA_PX**2 + BEND_SHARE**2 * bend2) * unit**2)
    shift = Similarity2D.translation_of(*frame.centre)
    limit = 3.0 * math.sqrt(field.scatter2) + 0.01 * frame.reach_px
    T = lead.T_a_b @ shift @ correction @ shift.inverse()
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    H_a_b = field.matrix(lead.T_a_b)
    return Measured(
        T_a_b=T,
        covariance=0.5 * (covariance + covariance.T),
        model_sigma_px=math.sqrt(bend2 + field.scatter2),
        agreeing=int(np.count_nonzero(np.sqrt(2.0 * field.residual2) < limit)),
        blocks=blocks,
        tiles=tile_pulses(floor_a, floor_b, H_a_b),
        agreement=agreement(floor_a, floor_b, T),
        repeat=closest_repeat(floor_a, floor_b, H_a_b),
        H_a_b=H_a_b,
    )


def _field_of(frame: Frame, motion: BlockMotion) -> Field | None:
    use = motion.solved
    if int(use.sum()) < FEWEST_BLOCKS:
        return None
    noise2 = 0.5 * np.trace(motion.covariance[use], axis1=1, axis2=2) * _inflation(motion.correlation[use])
    return fit_field(frame, motion.centre[use], motion.displacement[use], noise2, scatter_share=SCATTER_SHARE)


def _inflation(correlation: FloatArray) -> FloatArray:
    """Return by how much variances grow at ``(K,)`` correlations."""
    return np.minimum(CORRELATED_RESIDUALS + NOISY_SLOPES * (1.0 - correlation), LARGEST_INFLATION)


def _seen(a: Spectrum, frame: Frame, T_a_b: Similarity2D, field: Field) -> FloatArray:
    """``(N, 2)`` points evenly over what b shows of a's frame."""
    p = frame.grid()
    q = T_a_b.apply(p + field.displacement(p))
    inside = (q >= -0.5).all(axis=1) & (q <= np.array(a.size_px) - 0.5).all(axis=1)
    return p[inside] if int(inside.sum()) >= 4 else p


def _unsettled(a: Spectrum, b: Spectrum, lead: Lead, blocks: int) -> Measured:
    """Return the photometric fit, widened: too few blocks could confirm it."""
    fit, reach = lead.fit, max(b.shape) / 2.0
    ridge = np.diag([1e-4, 1e-4, 1e-4 * reach**2, 1e-4 * reach**2])
    base = np.linalg.inv(fit.information / LARGEST_INFLATION + ridge)
    least = 0.005 * reach
    covariance = np.asarray(base + np.diag([least**2, least**2, 0.005**2, 0.005**2]), np.float64)
    floor_a, floor_b = a.floors[a.spectral], b.floors[b.spectral]
    return Measured(fit.T_a_b, covariance, least, 0, blocks, lead.tiles, agreement(floor_a, floor_b, fit.T_a_b))
