"""From a candidate motion to a measured one: refined, bent where the ground or the camera bends it, cross-examined."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.measurement import TiePoints
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.align import align, outlying
from photomap_gis.ifmi.blocks import BlockMotion, block_motion
from photomap_gis.ifmi.field import Field, Frame, closest_similarity, field_matrix, fit_field, project, visible
from photomap_gis.ifmi.spectrum import Spectrum
from photomap_gis.ifmi.tiles import TilePulses, tile_pulses
from photomap_gis.ifmi.uncertainty import Spread

SPECTRAL_STEPS, FINE_STEPS = 12, 10
"""Steeply tilted frames need them; others end long before."""
NARROW = 0.1
"""Where so small a share of b lies in a, a bend of the motion cannot be seen: it is a similarity."""
STIFFNESS = 0.02
"""How much a bend is resisted while the motion is still coarse."""
OBVIOUS = 30.0
"""Where tiles speak this clearly for a motion, they need not be asked for a bend of it."""
LEAST_VARIANCE = 1e-10
"""A hundred-thousandth of the frame: no block is surer, not even of two copies of one picture."""
NEARLY_ALL = 0.8
BENDS = 2
CLEARLY = 1.2
FEWEST_BLOCKS = 12
TILE_SIGMA_PX = 1.0
SEARCHED_OUTLIERS = 0.006
"""From this share of outlying points on, odd blocks are looked for where they may have gone."""
BLOCK_NOISE, BLOCK_NOISE_DECORRELATED = 3.0, 2.0
"""Variances of blocks, which take residuals for independent and slopes for exact, grow so many times, and by the second
number times what the block's correlation lacks to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """A refined candidate, cross-examined: worth measuring or not. ``G`` is its motion (see ``align``)."""

    G: FloatArray
    correlation: float
    support: float
    tiles: TilePulses | None
    snr: float

    @property
    def strength(self) -> float:
        """How clearly the tiles speak for it."""
        return 0.0 if self.tiles is None else self.tiles.summed_snr


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The final motion with its uncertainty: the similarity closest to what was measured, and ``H_a_b``, measured."""

    T_a_b: Similarity2D
    covariance: FloatArray
    model_sigma_px: float
    agreeing: int
    solved: int
    blocks: int
    overlap: float
    correlation: float
    H_a_b: FloatArray
    spread: Spread | None = None
    ties: TiePoints | None = None


def follow(a: Spectrum, b: Spectrum, T_a_b: Similarity2D, snr: float) -> Lead:
    """Refine a candidate on the coarse floors and ask the tiles: first where they point, then whether there."""
    return follow_motion(a, b, T_a_b.matrix, snr)


def follow_motion(a: Spectrum, b: Spectrum, H_a_b: FloatArray, snr: float) -> Lead:
    """Refine a homography (frame pixels) as ``follow`` does a similarity."""
    frame = Frame(*b.size_px)
    G, support = H_a_b @ frame.T_b_q.matrix, 1.0
    k = a.spectral
    if k + 1 < len(a.floors):
        coarse = align(a.floors[k + 1], b.floors[k + 1], G, freedom=4, steps=3, enough_px=0.1)
        G, support = coarse.G if coarse.support > 0.0 else G, coarse.support
    lead = _asked(a, b, G, support, snr, frame)
    for _ in range(BENDS):
        if lead.tiles is None or len(lead.tiles.near) < 4 or _is_obvious(lead.tiles):
            break
        bent = _bent(a, b, lead, frame)
        before = lead.strength
        lead = max(lead, bent, key=lambda found: found.strength)
        if bent.strength < CLEARLY * before:
            break
    return lead


def _is_obvious(tiles: TilePulses) -> bool:
    return tiles.summed_snr >= OBVIOUS and float(tiles.near.mean()) >= NEARLY_ALL


def _bent(a: Spectrum, b: Spectrum, lead: Lead, frame: Frame) -> Lead:
    """Bend a lead's motion to where its tiles point."""
    tiles = lead.tiles
    if tiles is None:
        return lead
    f = a.floors[a.spectral].factor
    # The tiles' shifts are in a's pixels: back through the motion's linear part, they are displacements of q.
    back = np.linalg.inv(lead.G[:2, :2])
    unit = f / frame.reach_px
    noise2 = (TILE_SIGMA_PX * unit) ** 2 * np.square(6.0 / np.maximum(tiles.snr, 3.0))
    q = frame.T_q_b.apply(tiles.centre)
    noise = np.stack([noise2, np.zeros(len(q)), noise2])
    field = fit_field(q, tiles.shift @ back.T, noise, start=8.0 * unit)
    return _asked(a, b, lead.G @ field_matrix(field.theta), lead.support, lead.snr, frame)


def _asked(a: Spectrum, b: Spectrum, G: FloatArray, support: float, snr: float, frame: Frame) -> Lead:
    """Refine a motion, known to lay the share ``support`` of b into a, on the spectral floor and ask the tiles."""
    k = a.spectral
    freedom = 8 if support >= NARROW else 4
    fit = align(a.floors[k], b.floors[k], G, freedom=freedom, steps=SPECTRAL_STEPS, enough_px=0.05, stiffness=STIFFNESS)
    if fit.support == 0.0:
        return Lead(G, fit.correlation, 0.0, None, snr)
    H = fit.G @ frame.T_q_b.matrix
    tiles = tile_pulses(a.floors[k], b.floors[k], H)
    if tiles is None and k > 0:  # a narrow overlap: as small tiles as there are, on the finer floor
        tiles = tile_pulses(a.floors[k - 1], b.floors[k - 1], H, narrow=True)
    return Lead(fit.G, fit.correlation, fit.support, tiles, snr)


def measure(a: Spectrum, b: Spectrum, lead: Lead) -> Measured:
    """Return the motion closest to the whole overlap, its covariance and model sigma."""
    frame = Frame(*b.size_px)
    G = lead.G
    correlation, attenuation = lead.correlation, np.eye(2)
    for k in range(max(a.spectral - 1, 0), -1, -1):
        freedom = 8 if lead.support >= NARROW else 4
        fit = align(a.floors[k], b.floors[k], G, freedom=freedom, steps=FINE_STEPS, enough_px=0.02, near=True)
        if fit.support == 0.0:
            break
        G, attenuation = fit.G, fit.attenuation
    outliers = outlying(b.floors[0], fit) if k == 0 else 1.0
    coarsest = a.spectral if outliers > SEARCHED_OUTLIERS else None
    motion = block_motion(a.floors, b.floors, G, coarsest=coarsest, attenuation=attenuation)
    field = _field_of(motion)
    ties = _ties_of(motion, G, b)
    blocks = int(motion.visible.sum())
    if field is not None:
        G = G @ field_matrix(field.theta)
    weight = visible(frame, G, a.size_px)
    overlap = _overlap(a, b, G, float(weight.mean()), frame)
    if field is None or np.count_nonzero(weight) < 4:
        return _unsettled(b, G, blocks, overlap, correlation)
    closest = closest_similarity(frame, G, field.covariance, weight)
    r = frame.reach_px
    centre_b, centre_a = frame.T_b_q.translation, (np.array(a.size_px) - 1.0) / 2.0
    spread = Spread(
        noise=closest.M @ field.covariance @ closest.M.T,
        shape=closest.M @ field.shape @ closest.M.T / r**2,
        scatter2_px2=field.scatter2 * r**2,
        pull=closest.M @ field.pull,
        outliers=outliers,
        baseline_px=float(np.hypot(*(closest.T_a_b.apply(centre_b) - centre_a))) / closest.T_a_b.scale,
        bend2_px2=closest.bend2_px2,
        blocks=len(field.residual2),
        overlap=overlap,
    )
    limit2 = (3.0 * math.sqrt(field.scatter2) + 0.01) ** 2
    return Measured(
        T_a_b=closest.T_a_b,
        covariance=spread.covariance(),
        model_sigma_px=math.sqrt(spread.bend2_px2 + spread.scatter2_px2),
        spread=spread,
        agreeing=int(np.count_nonzero(2.0 * field.residual2 < limit2)),
        solved=len(field.residual2),
        blocks=blocks,
        overlap=overlap,
        correlation=correlation,
        H_a_b=homography_of(G, b),
        ties=ties,
    )


def _ties_of(motion: BlockMotion, G: FloatArray, b: Spectrum) -> TiePoints:
    """Return b's blocks that were solved, where they were found in a."""
    use = np.flatnonzero(motion.solved)
    q = motion.centre[use]
    xx, xy, yy = _trusted_noise(motion, use)
    # carried to a by the motion's linear part at the frame's centre: covariances need no better
    p, r, s, t = G[:2, :2].ravel() / G[2, 2]
    covariance = np.stack(
        [
            p * p * xx + 2.0 * p * r * xy + r * r * yy,
            p * s * xx + (p * t + r * s) * xy + r * t * yy,
            s * s * xx + 2.0 * s * t * xy + t * t * yy,
        ],
        axis=1,
    )
    xy_a = project(G, q + motion.displacement[use])
    return TiePoints(xy_a, Frame(*b.size_px).T_b_q.apply(q), covariance, use)


def _trusted_noise(motion: BlockMotion, use: np.ndarray) -> FloatArray:
    """``(3, K)`` elements xx, xy and yy of the covariances of some blocks as they are to be believed."""
    noise = motion.noise[:, use] * (BLOCK_NOISE + BLOCK_NOISE_DECORRELATED * (1.0 - motion.correlation[use]))
    noise[::2] += LEAST_VARIANCE
    return noise


def _field_of(motion: BlockMotion) -> Field | None:
    use = motion.solved
    if int(use.sum()) < FEWEST_BLOCKS:
        return None
    return fit_field(motion.centre[use], motion.displacement[use], _trusted_noise(motion, use))


def _overlap(a: Spectrum, b: Spectrum, G: FloatArray, share: float, frame: Frame) -> float:
    """Return the overlap as a share of the smaller frame, both seen from a."""
    area_b = abs(float(np.linalg.det(G[:2, :2]))) / frame.reach_px**2 * b.shape[0] * b.shape[1]
    return min(1.0, share * area_b / min(float(a.shape[0] * a.shape[1]), area_b))


def similarity_of(G: FloatArray, b: Spectrum) -> Similarity2D:
    """Return the similarity closest to a motion over the whole of b."""
    frame = Frame(*b.size_px)
    return frame.similarity_of(G) @ frame.T_q_b


def homography_of(G: FloatArray, b: Spectrum) -> FloatArray:
    """``(3, 3)`` homography from b's pixels to a's of a motion."""
    H = G @ Frame(*b.size_px).T_q_b.matrix
    return np.asarray(H / H[2, 2], np.float64)


def _unsettled(b: Spectrum, G: FloatArray, blocks: int, overlap: float, correlation: float) -> Measured:
    """Return the photometric fit, widened: too few blocks could confirm it."""
    r = max(b.shape) / 2.0
    least = 0.01 * r
    wide = np.diag([least**2, least**2, 0.01**2, 0.01**2])
    T = similarity_of(G, b)
    return Measured(T, wide, least, 0, 0, blocks, overlap, correlation, homography_of(G, b))
