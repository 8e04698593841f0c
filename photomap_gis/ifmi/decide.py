"""Between candidates: follow up the best, choose the one that the witnesses speak for, gather what they say of it."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from dataclasses import dataclass

from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi.align import align
from photomap_gis.ifmi.examine import Lead, Measured, follow, follow_motion, homography_of, measure, similarity_of
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.repeats import likeness, repeated
from photomap_gis.ifmi.search import Candidate
from photomap_gis.ifmi.spectrum import Spectrum
from photomap_gis.ifmi.validity import Evidence

CONTENDERS = 5
ALTERNATIVE = 0.7
"""Leads at least so strong, as a share of the winner, are handed out as alternatives."""
CLEAR = 25.0
"""A lead whose tiles speak this clearly (signal over scatter) needs no further search."""
APART = 0.04
"""Motions are different ones where the corners of b lie so far apart, as a share of its longer side."""


REPETITIVE = 0.33
"""Frames so much like themselves elsewhere are searched to the end: the first clear lead may be a twin of another."""
EXPANDED = 2
REPEATS_FOLLOWED = 4
"""So many motions, whole periods beside each of the best leads, are followed up."""
ALWAYS_UNLIKE = 0.005
"""So much of two frames' detail may be left unlike by interpolation alone: less than that decides nothing."""
POLISH_STEPS = 10
"""Thin lines are unlike as soon as they miss each other: before they are judged, motions are refined to the end."""
SERIOUS = 0.5
"""On ground that repeats, leads at least so strong as a share of the strongest are judged by what does not repeat."""

Placed = tuple[Lead, Similarity2D]


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """The motion found, what speaks for it, and the motions that nearly as much speaks for."""

    measured: Measured
    evidence: Evidence
    alternatives: tuple[Similarity2D, ...]


def decide(a: Spectrum, b: Spectrum, candidates: Iterable[Candidate], prior: Prior | None) -> Finding | None:
    """Return the best of the candidates, measured; ``None`` where none can be followed up."""
    leads = _leads(a, b, candidates, prior)
    if not leads:
        return None
    leads.sort(key=lambda found: -found[0].strength)
    if _is_repetitive(a):
        leads = _beside_periods(a, b, leads, prior)
    best, T_best = leads[0]
    apart_px = APART * max(b.shape)
    rivals = [(lead, T) for lead, T in leads[1:] if distance_px(T, T_best, b) >= apart_px]
    measured = measure(a, b, best)
    tiles = best.tiles
    evidence = Evidence(
        correlation=measured.correlation,
        overlap=measured.overlap,
        snr=best.snr,
        summed_snr=0.0 if tiles is None else tiles.summed_snr,
        rival=1.0 if tiles is None else tiles.rival,
        near=0 if tiles is None else int(tiles.near.sum()),
        tiles=0 if tiles is None else len(tiles.near),
        agreeing=measured.agreeing,
        solved=measured.solved,
        blocks=measured.blocks,
        contender=max((lead.strength for lead, _ in rivals), default=0.0) / max(best.strength, 1e-6),
        repeats=_repeats(a, b, best, [lead for lead, _ in rivals]),
        bend=measured.model_sigma_px / (max(b.shape) / 2.0),
    )
    alternatives = tuple(T for lead, T in rivals if lead.strength > ALTERNATIVE * best.strength)
    return Finding(measured, evidence, alternatives)


def _leads(a: Spectrum, b: Spectrum, candidates: Iterable[Candidate], prior: Prior | None) -> list[Placed]:
    """Follow candidates up, until one is clear or enough have been tried."""
    leads: list[Placed] = []
    tried: list[Similarity2D] = []
    repetitive = _is_repetitive(a)
    for candidate in candidates:
        if len(tried) == CONTENDERS:
            break
        if any(distance_px(candidate.T_a_b, T, b) < APART * max(b.shape) for T in tried):
            continue
        tried.append(candidate.T_a_b)
        lead = follow(a, b, candidate.T_a_b, candidate.snr)
        if lead.support == 0.0:
            continue
        T = similarity_of(lead.G, b)
        if prior is not None and not prior.admits(T, b.size_px):
            continue
        leads.append((lead, T))
        if lead.strength >= CLEAR and not repetitive:
            break
    return leads


def _is_repetitive(a: Spectrum) -> bool:
    return max((p.likeness for p in a.periods), default=0.0) >= REPETITIVE


def _beside_periods(a: Spectrum, b: Spectrum, leads: list[Placed], prior: Prior | None) -> list[Placed]:
    """Put the motions whole periods beside the best leads up against them; the one that leaves least unlike leads."""
    found = list(leads)
    within = None if prior is None else prior.centre_within(b.size_px)
    for lead, _ in leads[:EXPANDED]:
        for H in repeated(a, b, homography_of(lead.G, b), REPEATS_FOLLOWED, centre_within=within):
            moved = follow_motion(a, b, H, lead.snr)
            T = similarity_of(moved.G, b)
            if moved.support == 0.0 or (prior is not None and not prior.admits(T, b.size_px)):
                continue
            if all(distance_px(T, other, b) >= APART * max(b.shape) for _, other in found):
                found.append((moved, T))
    strongest = max(lead.strength for lead, _ in found)
    serious = [(lead, T) for lead, T in found if lead.strength >= SERIOUS * strongest]
    serious.sort(key=lambda placed: _unlike(a, b, placed[0]))
    return serious + [placed for placed in found if placed[0].strength < SERIOUS * strongest]


def _unlike(a: Spectrum, b: Spectrum, lead: Lead) -> float:
    """Return how much of both frames' detail is left unlike, 0..1, by the motion or by what it is refined to."""
    k = a.spectral
    refined = align(a.floors[k], b.floors[k], lead.G, freedom=4, steps=POLISH_STEPS)
    seen = max(likeness(a, b, homography_of(G, b)).correlation for G in (lead.G, refined.G))
    return 1.0 - max(seen, 0.0) ** 2


def _repeats(a: Spectrum, b: Spectrum, best: Lead, rivals: list[Lead]) -> float:
    """Return how unlike the motion leaves the frames as a share of the best rival on ground that repeats, else 0."""
    if not _is_repetitive(a):
        return 0.0
    serious = [r for r in rivals if r.strength >= SERIOUS * best.strength]
    if not serious:
        return 0.0
    there = min(_unlike(a, b, r) for r in serious)
    return (_unlike(a, b, best) + ALWAYS_UNLIKE) / (there + ALWAYS_UNLIKE)


def distance_px(T: Similarity2D, U: Similarity2D, b: Spectrum) -> float:
    """Root mean square distance over b's corners between two motions."""
    w, h = b.size_px
    x, y = (w - 1.0) / 2.0, (h - 1.0) / 2.0
    z = cmath.rect(T.scale, T.angle_rad) - cmath.rect(U.scale, U.angle_rad)
    middle = z * complex(x, y) + complex(T.tx - U.tx, T.ty - U.ty)
    # corners lie evenly around the middle: their squares add
    return math.sqrt(abs(middle) ** 2 + abs(z) ** 2 * (x * x + y * y))
