"""The paper's case from pictures on: all pairs registered from cached spectra and solved, and a first map from few.

Pictures are drawn over a procedural scene, level but for the lean of a good gimbal, of which nobody tells.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np

from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind, PoseGraph, Solution
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.georef import observe
from photomap_gis.ifmi import Prior, Spectrum, make_spectrum, register
from photomap_gis.simulate import procedural_scene
from photomap_gis.slam import GraphBuilder, solve
from photomap_gis.slam.candidates import Candidate, candidates

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .measure import Options, relative_rmse_m
from .world import CAMERA, Flown, Plan, fly, frame_refs, ground_homography, map_frame_here

FRAMES, PAIRS = 630, 12_364
PLAN = Plan(FRAMES, strip_m=150.0, height_m=50.0, forward=0.85, side=0.72, wander_m=0.3, tilt_sigma_rad=np.radians(0.7))
SIDE_PX = 256
NOISE_GREY = 3.0
FIRST_A_FRAME = 5
"""Loops a frame of the first map."""
MARGIN_M = 70.0
GSD_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Spectra of all frames, the frames' outline, and how working pixels lie in planes."""

    spectra: tuple[Spectrum, ...]
    outline: FloatArray
    T_plane_work: Similarity2D


def whole_case(options: Options) -> Section:
    """Wall time of registrations and solution; accuracy of a first map over that of the last."""
    rng = options.rng(6)
    frames = 120 if options.quick else FRAMES
    flown = fly(rng, replace(PLAN, frames=frames))
    pictures = _draw(rng, flown, options)
    refs = frame_refs(rng, flown, map_frame_here())
    pairs = PAIRS * frames // FRAMES

    start = time.perf_counter()
    chain = [register(pictures.spectra[a], pictures.spectra[b]) for a, b in pairwise(range(frames))]
    track = _solved(chain, [], pictures, refs)
    chained_s = time.perf_counter() - start
    options.on_progress(1, 3)

    start = time.perf_counter()
    first_loops = _register(_loops(track, pictures, FIRST_A_FRAME), pictures)
    first = _solved(chain, first_loops, pictures, refs)
    first_s = chained_s + time.perf_counter() - start
    options.on_progress(2, 3)

    start = time.perf_counter()
    wanted = _loops(track, pictures, frames)[: pairs - len(chain)]
    loops = _register(wanted, pictures)
    last = _solved(chain, loops, pictures, refs)
    last_s = chained_s + time.perf_counter() - start
    options.on_progress(3, 3)

    errors = [relative_rmse_m(flown, s) for s in (track, first, last)]
    accepted = [sum(r.accepted for r in found) for found in (chain, first_loops, loops)]
    n = frames
    return Section(
        "whole case",
        (
            Figure("pairs registered", _exact(len(chain) + len(loops)), n, "", Bar(low=pairs)),
            Figure("registrations and solution", _exact(last_s), n, "s", Bar(high=45.0)),
            Figure("first map from fewer pairs", _exact(first_s), n, "s", Bar(high=8.0)),
            Figure("its error over that of all pairs", _exact(errors[1] / errors[2]), n, "x", Bar(high=1.05)),
            Figure("relative RMSE, all pairs", _exact(errors[2]), n, "m"),
            Figure("relative RMSE, first map", _exact(errors[1]), n, "m"),
            Figure("relative RMSE, sequential and GPS alone", _exact(errors[0]), n, "m"),
        ),
        notes=(
            f"{frames} frames of {SIDE_PX} px, wall time, one core, spectra cached; accepted: "
            f"{accepted[0]} of {len(chain)} sequential pairs, {accepted[1]} of {len(first_loops)} loops of the first "
            f"map, {accepted[2]} of {len(loops)} of all. Sequential registration ({chained_s:.1f} s with its solution) "
            "counts in both times. Pixels on the ground are "
            f"{PLAN.height_m / _focal_px() * CAMERA.width_px / SIDE_PX:.2f} m.",
        ),
    )


def _draw(rng: np.random.Generator, flown: Flown, options: Options) -> Pictures:
    """Return the spectra of what the frames show of a procedural scene."""
    places = flown.centres_m
    low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
    ground = cv2.cvtColor(procedural_scene((high - low).tolist(), GSD_M, options.seed).colour, cv2.COLOR_BGR2GRAY)
    zoom = CAMERA.width_px / SIDE_PX
    size = (SIDE_PX, round(CAMERA.height_px / zoom))
    middle = (np.array(size) - 1) / 2.0
    T_plane_work = Similarity2D(0.0, 0.0, 0.0, np.log(zoom)) @ Similarity2D.translation_of(*-middle)
    spectra = []
    to_scene = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, GSD_M]]) / GSD_M
    for k in range(len(flown.poses)):
        H = to_scene @ ground_homography(flown, k) @ T_plane_work.matrix
        drawn = cv2.warpPerspective(ground, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        noisy = np.clip(drawn + rng.normal(0, NOISE_GREY, drawn.shape), 0, 255).astype(np.uint8)
        spectra.append(make_spectrum(noisy, index=k))
    corners = np.array([[-0.5, -0.5], [size[0] - 0.5, -0.5], [size[0] - 0.5, size[1] - 0.5], [-0.5, size[1] - 0.5]])
    return Pictures(tuple(spectra), T_plane_work.apply(corners), T_plane_work)


def _loops(solution: Solution, pictures: Pictures, per_frame: int) -> list[Candidate]:
    poses = {p.frame: (p.T_map_plane, p.covariance) for p in solution.poses}
    chained = {(a, a + 1) for a in poses}
    outlines = {f: pictures.outline for f in poses}
    return candidates(poses, outlines, exclude=chained, min_overlap=0.2, max_per_frame=per_frame)


def _register(loops: Sequence[Candidate], pictures: Pictures) -> list[Registration]:
    """Register loops from cached spectra, each with its predicted motion as a prior, as the product does: in turn."""

    def measure(c: Candidate) -> Registration:
        T = pictures.T_plane_work.inverse() @ c.T_a_b @ pictures.T_plane_work
        prior = Prior(T, 15.0, 0.05, 0.05)
        return register(pictures.spectra[c.a], pictures.spectra[c.b], prior=prior, fallback=False)

    return [measure(c) for c in loops]


def _solved(
    chain: Sequence[Registration], loops: Sequence[Registration], pictures: Pictures, refs: Sequence
) -> Solution:
    return solve(_graph(chain, loops, pictures, refs))


def _graph(
    chain: Sequence[Registration], loops: Sequence[Registration], pictures: Pictures, refs: Sequence
) -> PoseGraph:
    builder = GraphBuilder()
    for ref in refs:
        builder.add_frame(ref.index)
    for kind, found in ((EdgeKind.SEQUENTIAL, chain), (EdgeKind.LOOP, loops)):
        for r in found:
            if r.accepted:
                builder.add_registration(r, pictures.T_plane_work, pictures.T_plane_work, kind)
    seen = observe(refs, map_frame_here())
    builder.observe(seen.positions, seen.scales, seen.headings)
    return builder.snapshot()


def _focal_px() -> float:
    return CAMERA.focal_px or 1.0


def _exact(value: float) -> Interval:
    return Interval(value, value, value)
