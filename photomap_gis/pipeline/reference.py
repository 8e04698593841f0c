"""Existing imagery as the reference: its ties are measured, kept in the mission, and solved with."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

from photomap_gis.core.errors import UsageError
from photomap_gis.core.frame import ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.core.tie import ReferenceTie, ReferenceTies
from photomap_gis.ifmi import Prior, Spectrum, make_spectrum, register
from photomap_gis.ifmi.working import to_grey
from photomap_gis.pipeline.prepare import read_pixels
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solve import Solved
from photomap_gis.reference import Expected, Patch, ReferenceImage, agreed, find_ties, places_of
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

PLACES = 40
"""Places compared with a reference in one round."""
FEW = 3
"""With fewer ties than this a wider search is worth its time."""
WIDER = 3.0
ROUNDS = 2
"""Ties are measured again once the map lies on the first ones: what was warped askew then fits better."""
FRAMES_HELD = 6


def take_references(
    mission: Mission,
    solved: Solved,
    solve: Callable[[], Solved],
    references: Sequence[Path],
    *,
    sigma_m: float | None = None,
    on_progress: Progress = lambda stage, done, total: None,
) -> Solved:
    """Find frames of a georeferenced mission in existing imagery, keep the ties in the mission, and solve with them.

    ``solved`` may be a solution without references. ``solve`` solves the mission anew with what it then holds;
    ``sigma_m`` is the imagery's own constant error per axis (by default one of its pixels). A reference whose ties the
    mission holds already is not measured again. Where nothing fits, the mission keeps a word of it, and the map is as
    it was. ``DataError`` for files without a place.
    """
    if sigma_m is not None and not sigma_m > 0.0:
        raise UsageError(f"--reference-sigma must be a positive number of metres, got {sigma_m:g}")
    crs_wkt = mission.header.map_frame.crs_wkt
    if crs_wkt is None:
        if not references:
            return solved
        raise UsageError("--reference needs a map with a place on Earth: map with positions (--track FILE) first")
    for path in references:
        with ReferenceImage(path) as image:
            gsd_m = image.gsd_m_per_px(crs_wkt)
            fresh = ReferenceTies(
                str(path.absolute()), sigma_m or gsd_m, gsd_m, f"{image.state()} {len(solved.frames)} frames", 0
            )
            if any(replace(fresh, tried=t.tried, ties=t.ties, word=t.word) == t for t in mission.references):
                logger.info("%s was compared by an earlier run", path)
                continue
            for round_ in range(ROUNDS):
                widen = WIDER if round_ and not fresh.kept else 1.0
                told = partial(on_progress, "reference")
                again = _measured(mission, solved, image, fresh, widen=widen, on_done=told)
                if len(again.kept) >= len(fresh.kept):
                    fresh = again
                    mission.save_references(_with(mission.references, fresh))
                if fresh.kept:
                    solved = solve()
    return solve() if mission.references else solved


def register_patches(reference: Patch, drawn: Patch, expected: Expected) -> Registration:
    """Return ``T_reference_drawn``: iFMI near the identity, and features where it abstains."""
    prior = Prior(Similarity2D(), expected.sigma_xy_px, expected.sigma_angle_rad, expected.sigma_log_scale)
    return register(_spectrum(reference), _spectrum(drawn), prior=prior)


def _spectrum(patch: Patch) -> Spectrum:
    return make_spectrum(patch.grey, mask=None if patch.mask.all() else patch.mask)


def _measured(
    mission: Mission,
    solved: Solved,
    image: ReferenceImage,
    fresh: ReferenceTies,
    *,
    widen: float,
    on_done: Callable[[int, int], None],
) -> ReferenceTies:
    """Return what one round of comparing finds."""
    refs = {f.index: f for f in solved.frames}

    @lru_cache(maxsize=FRAMES_HELD)
    def read_grey(frame: int) -> ImageArray:
        return to_grey(read_pixels(mission, refs[frame]))

    placements = solved.trajectory.placements
    places = places_of(placements, solved.map_frame, gsd_m=fresh.gsd_m_per_px, budget=PLACES, widen=widen)
    inside = [p for p in places if image.shows(p.grid)]
    ties = find_ties(inside, image, solved.map_frame, read_grey, register_patches, on_done=on_done)
    told = agreed(ties, placements, fresh.gsd_m_per_px)
    return replace(fresh, tried=len(inside), ties=tuple(told), word=_word(len(places), len(inside), told))


def _word(places: int, inside: int, ties: Sequence[ReferenceTie]) -> str:
    kept = sum(t.kept for t in ties)
    if not inside:
        return f"does not show the ground of the map ({places} places looked for); the map is as without it"
    if not kept:
        return (
            f"none of {inside} places could be matched (by gradients, grey values and features; {len(ties)} guesses "
            "did not agree); the map is as without it"
        )
    return f"{kept} of {inside} places matched"


def _with(references: Sequence[ReferenceTies], fresh: ReferenceTies) -> list[ReferenceTies]:
    """Return the references with one replaced by its newest ties, or added."""
    return [*(r for r in references if r.path != fresh.path), fresh]
