"""Existing imagery as the reference: its ties are measured, kept in the mission, and solved with."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from photomap_gis.core.errors import UsageError
from photomap_gis.core.frame import GpsFix, ImageArray
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement, PlanePlacement
from photomap_gis.core.posegraph import Trajectory
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.core.tie import ReferenceTie, ReferenceTies
from photomap_gis.georef import choose_map_frame
from photomap_gis.ifmi import Prior, Spectrum, make_spectrum, register
from photomap_gis.ifmi.working import to_grey
from photomap_gis.pipeline.prepare import read_pixels
from photomap_gis.pipeline.settings import Progress
from photomap_gis.pipeline.solved import Solved
from photomap_gis.reference import Expected, Patch, ReferenceImage, agreed, find_ties, locations, places_of
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

PLACES = 40
"""Places compared with a reference in one round."""
FEW = 3
"""Fewer ties than this tell nothing of a map without positions."""
WIDER = 3.0
MIN_FOUND = 0.3
"""A find of a map without positions is believed where this share of its places is found again."""
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
    """Find a mission's frames in existing imagery, keep the ties in the mission, and solve with them.

    A map without positions is sought in the whole of it, and gets its place on Earth from there.

    ``solved`` may be a solution without references. ``solve`` solves the mission anew with what it then holds;
    ``sigma_m`` is the imagery's own constant error per axis (by default one of its pixels). A reference whose ties the
    mission holds already is not measured again. Where nothing fits, the mission keeps a word of it, and the map is as
    it was. ``DataError`` for files without a place.
    """
    if sigma_m is not None and not sigma_m > 0.0:
        raise UsageError(f"--reference-sigma must be a positive number of metres, got {sigma_m:g}")
    for path in references:
        with ReferenceImage(path) as image:
            if mission.header.map_frame.crs_wkt is None:
                solved = _found_anywhere(mission, solved, solve, image, sigma_m, on_progress)
            else:
                solved = _found_nearby(mission, solved, solve, image, sigma_m, on_progress)
    return solve() if mission.references else solved


def _found_nearby(
    mission: Mission,
    solved: Solved,
    solve: Callable[[], Solved],
    image: ReferenceImage,
    sigma_m: float | None,
    on_progress: Progress,
) -> Solved:
    """Return the solution of a map that has a place with the ties to a reference, sought where they should lie."""
    fresh = _untried(image, solved, str(mission.header.map_frame.crs_wkt), sigma_m)
    if any(replace(fresh, tried=t.tried, ties=t.ties, word=t.word) == t for t in mission.references):
        logger.info("%s was compared by an earlier run", image.path)
        return solved
    if not solved.georeferenced:
        solved = solve()  # the references that an earlier run found are all that places this map
    for round_ in range(ROUNDS):
        widen = WIDER if round_ and not fresh.kept else 1.0
        told = partial(on_progress, "reference")
        again = _measured(mission, solved, image, fresh, widen=widen, on_done=told)
        if len(again.kept) >= len(fresh.kept):
            fresh = again
            mission.save_references(_with(mission.references, fresh))
        if fresh.kept:
            if (control := mission.load_control()).nudges:
                mission.save_control(replace(control, nudges=()))  # made by hand to the map as it lay before
            solved = solve()
    return solved


def _found_anywhere(
    mission: Mission,
    solved: Solved,
    solve: Callable[[], Solved],
    image: ReferenceImage,
    sigma_m: float | None,
    on_progress: Progress,
) -> Solved:
    """Return the solution of a map without any place, sought in the whole of a reference piece by piece.

    A piece lies there where as many of its frames as can be expected are found again, each by itself, where the find
    puts them. With the first piece the mission gets a place on Earth.
    """
    map_frame = choose_map_frame([GpsFix(*image.middle_lat_lon())], mission.header.settings.get("crs"))
    fresh = _untried(image, solved, str(map_frame.crs_wkt), sigma_m)
    read_grey = _reader(mission, solved)
    for done, segment in enumerate(solved.segment_numbers):
        piece = solved.trajectory.segment(segment).placements
        for T_map_local, where_m in locations(piece, image, map_frame, read_grey, _register_freely):
            moved = replace(solved, map_frame=map_frame, trajectory=Trajectory(_moved(piece, T_map_local, where_m)))
            found = _measured(mission, moved, image, fresh, on_done=partial(on_progress, "reference"))
            if len(found.kept) >= max(FEW, MIN_FOUND * found.tried):
                both = (*fresh.ties, *found.ties)
                tried = fresh.tried + found.tried
                fresh = replace(fresh, ties=both, tried=tried, word=_word(tried, tried, both))
                break
        on_progress("locate", done + 1, len(solved.segment_numbers))
    if not fresh.kept:
        word = "the map has no position and was not found in it (sought at every heading and at scales from a tenth of "
        mission.save_references(_with(mission.references, replace(fresh, word=word + "the imagery to all of it)")))
        return solved
    mission.save_header(replace(mission.header, map_frame=map_frame))
    mission.save_references(_with(mission.references, fresh))
    solved = solve()
    again = _measured(mission, solved, image, fresh, on_done=partial(on_progress, "reference"))
    if len(again.kept) >= len(fresh.kept):
        mission.save_references(_with(mission.references, again))
        solved = solve()
    return solved


def _untried(image: ReferenceImage, solved: Solved, crs_wkt: str, sigma_m: float | None) -> ReferenceTies:
    gsd_m = image.gsd_m_per_px(crs_wkt)
    state = f"{image.state()} {len(solved.frames)} frames"
    return ReferenceTies(str(image.path.absolute()), sigma_m or gsd_m, gsd_m, state, 0)


def _moved(
    placements: Sequence[FramePlacement], T_map_local: Similarity2D, sigma_m: float
) -> tuple[FramePlacement, ...]:
    """Return the placements of a relative map laid on the Earth, their covariance widened by what that leaves open."""
    out = []
    for p in placements:
        at = p.camera_to_map
        assert isinstance(at, PlanePlacement)
        T = T_map_local @ at.T_map_plane
        wide = np.diag([sigma_m / T.scale, sigma_m / T.scale, 0.02, 0.02]) ** 2
        out.append(replace(p, camera_to_map=PlanePlacement(at.view, T), pose_covariance=p.pose_covariance + wide))
    return tuple(out)


def _register_freely(a: Patch, b: Patch) -> Registration:
    # Features would cost four times the spectra's time, at two hundred windows.
    return register(_spectrum(a), _spectrum(b), fallback=False)


def register_patches(reference: Patch, drawn: Patch, expected: Expected) -> Registration:
    """Return ``T_reference_drawn``: iFMI near the identity, and features where it abstains."""
    prior = Prior(Similarity2D(), expected.sigma_xy_px, expected.sigma_angle_rad, expected.sigma_log_scale)
    return register(_spectrum(reference), _spectrum(drawn), prior=prior, fallback=expected.features)


def _spectrum(patch: Patch) -> Spectrum:
    return make_spectrum(patch.grey, mask=None if patch.mask.all() else patch.mask)


def _measured(
    mission: Mission,
    solved: Solved,
    image: ReferenceImage,
    fresh: ReferenceTies,
    *,
    widen: float = 1.0,
    on_done: Callable[[int, int], None],
) -> ReferenceTies:
    """Return what one round of comparing finds."""
    read_grey = _reader(mission, solved)
    placements = solved.trajectory.placements
    places = places_of(placements, solved.map_frame, gsd_m=fresh.gsd_m_per_px, budget=PLACES, widen=widen)
    inside = [p for p in places if image.shows(p.grid)]
    ties = find_ties(inside, image, solved.map_frame, read_grey, register_patches, on_done=on_done)
    told = agreed(ties, placements, fresh.gsd_m_per_px)
    return replace(fresh, tried=len(inside), ties=tuple(told), word=_word(len(places), len(inside), told))


def _reader(mission: Mission, solved: Solved) -> Callable[[int], ImageArray]:
    """Return what reads a frame's grey raster; the last few are held."""
    refs = {f.index: f for f in solved.frames}

    @lru_cache(maxsize=FRAMES_HELD)
    def read_grey(frame: int) -> ImageArray:
        return to_grey(read_pixels(mission, refs[frame]))

    return read_grey


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
