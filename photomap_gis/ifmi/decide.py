"""Between candidates: follow up the best, choose the one that the witnesses speak for, gather what they say of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.examine import Lead, Measured, follow, measure, similarity_of
from photomap_gis.ifmi.prior import Prior
from photomap_gis.ifmi.repeats import closest_repeat
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
    best, T_best = leads[0]
    apart_px = APART * max(b.shape)
    rivals = [(lead, T) for lead, T in leads[1:] if distance_px(T, T_best, b) >= apart_px]
    measured = measure(a, b, best)
    tiles = best.tiles
    repeat = None if tiles is None else closest_repeat(a, b, measured.H_a_b, tiles)
    moved = None
    if repeat is not None and repeat.ambiguous:
        moved = Similarity2D.translation_of(repeat.dx_px, repeat.dy_px) @ measured.T_a_b
        if prior is not None and not prior.admits(moved, b.size_px):
            moved = None  # the prior knows which of the periods it is
    evidence = Evidence(
        correlation=measured.correlation,
        overlap=measured.overlap,
        snr=best.snr,
        summed_snr=0.0 if tiles is None else tiles.summed_snr,
        rival=1.0 if tiles is None else tiles.rival,
        near=0 if tiles is None else int(tiles.near.sum()),
        tiles=0 if tiles is None else len(tiles.near),
        agreeing=measured.agreeing,
        blocks=measured.blocks,
        contender=rivals[0][0].strength / max(best.strength, 1e-6) if rivals else 0.0,
        repeats=moved is not None,
    )
    alternatives = [T for lead, T in rivals if lead.strength > ALTERNATIVE * best.strength]
    return Finding(measured, evidence, (*alternatives, *(() if moved is None else (moved,))))


def _leads(
    a: Spectrum, b: Spectrum, candidates: Iterable[Candidate], prior: Prior | None
) -> list[tuple[Lead, Similarity2D]]:
    """Follow candidates up, until one is clear or enough have been tried."""
    leads: list[tuple[Lead, Similarity2D]] = []
    tried: list[Similarity2D] = []
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
        if lead.strength >= CLEAR:
            break
    return leads


def distance_px(T: Similarity2D, U: Similarity2D, b: Spectrum) -> float:
    """Root mean square distance over b's corners between two motions."""
    w, h = b.size_px
    corners: FloatArray = np.array([[0.0, 0.0], [w - 1.0, 0.0], [0.0, h - 1.0], [w - 1.0, h - 1.0]])
    d = T.apply(corners) - U.apply(corners)
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
