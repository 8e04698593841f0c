"""Run methods over pairs, in one or several processes; the outcomes are the same in any number of them."""

from __future__ import annotations

import math
import multiprocessing
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.core.similarity import FloatArray

from .methods import LOOP, TRACKING, Estimate, Method, method_named, prior_of
from .pairs import Pair, PairClass, pairs
from .pictures import Part, Sources, find_sources
from .score import error_of, is_right, model_rms_px, xi_of

CHUNK = 25


@dataclass(frozen=True, slots=True)
class Options:
    """What a run is to do. ``count`` is the number of pairs of a class; sections take their shares of it."""

    count: int = 1000
    seed: int = 0
    part: Part = "reporting"
    processes: int = 1
    on_progress: Callable[[int, int], None] = lambda done, total: None


@dataclass(frozen=True, slots=True)
class Job:
    """Some methods on some pairs of a class."""

    cls: str
    methods: tuple[str, ...]
    count: int
    first: int = 0
    size: tuple[int, int] = (256, 256)
    hfov_deg: float = 60.0
    change: PairClass | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What a method said of a pair, judged. Of pairs without a truth nothing is right and errors are infinite.

    ``overlap``, ``residual_px`` and ``model_px`` (what the model sigma should be) are truths; ``ms_frame`` and
    ``ms_pair`` CPU times of one frame's preparation and of the match of two.
    """

    cls: str
    index: int
    method: str
    picture: str
    right: bool
    accepted: bool
    probability: float
    by: str
    rms_px: float
    centre_px: float
    angle_deg: float
    scale: float
    xi: FloatArray
    covariance: FloatArray | None
    model_sigma_px: float
    model_px: float
    residual_px: float
    overlap: float
    ms_frame: float
    ms_pair: float


def run(jobs: Iterable[Job], options: Options) -> list[Outcome]:
    """Return the outcomes of all jobs, in their order."""
    pieces = [
        replace(job, first=k, count=min(CHUNK, job.first + job.count - k))
        for job in jobs
        for k in range(job.first, job.first + job.count, CHUNK)
    ]
    total = sum(p.count for p in pieces)
    done, outcomes = 0, []
    options.on_progress(0, total)
    if options.processes == 1:
        results: Iterable[list[Outcome]] = (_piece(p, options.seed, options.part) for p in pieces)
        for piece, found in zip(pieces, results, strict=True):
            outcomes += found
            options.on_progress(done := done + piece.count, total)
        return outcomes
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, mp_context=context) as pool:
        ahead = [pool.submit(_piece, p, options.seed, options.part) for p in pieces]
        for piece, future in zip(pieces, ahead, strict=True):
            outcomes += future.result()
            options.on_progress(done := done + piece.count, total)
    return outcomes


@lru_cache(maxsize=4)
def _sources(part: Part) -> Sources:
    return find_sources(part)


def _piece(job: Job, seed: int, part: Part) -> list[Outcome]:
    cv2.setNumThreads(1)
    methods = [method_named(name) for name in job.methods]
    outcomes = []
    made = pairs(
        job.cls, job.count, seed, part, first=job.first, size=job.size, hfov_deg=job.hfov_deg,
        sources=_sources(part), change=job.change,
    )  # fmt: skip
    for k, pair in enumerate(made, start=job.first):
        outcomes += [judge(method, pair, k, seed) for method in methods]
    return outcomes


def judge(method: Method, pair: Pair, index: int, seed: int = 0) -> Outcome:
    """Run a method on a pair and judge what it says."""
    prior = None
    if method.wants_prior and pair.T_a_b is not None:
        spread = LOOP if method.name.endswith("loop") else TRACKING
        prior = prior_of(pair, spread, np.random.default_rng([seed, index, 0x9]))
    t0 = time.process_time()
    a = method.prepare(pair.a)
    t1 = time.process_time()
    b = method.prepare(pair.b)
    t2 = time.process_time()
    estimate = method.match(a, b, prior)
    t3 = time.process_time()
    return judged(estimate, pair, index, method.name, (1e3 * min(t1 - t0, t2 - t1), 1e3 * (t3 - t2)))


def judged(e: Estimate, pair: Pair, index: int, method: str, ms: tuple[float, float]) -> Outcome:
    """Return the outcome of an estimate; ``ms`` are the CPU times of a frame and of the match."""
    if pair.T_a_b is None:
        rms = centre = angle = scale = math.inf
        xi, model, right = np.full(4, np.nan), 0.0, False
    else:
        error = error_of(e.T_a_b, pair)
        rms, centre, angle, scale = error.rms_px, error.centre_px, error.angle_deg, error.scale
        xi, model, right = xi_of(e.T_a_b, pair), model_rms_px(pair), is_right(rms, pair.size_px[0])
    return Outcome(
        cls=pair.cls,
        index=index,
        method=method,
        picture=pair.picture,
        right=right,
        accepted=e.accepted,
        probability=e.probability,
        by=e.method,
        rms_px=rms,
        centre_px=centre,
        angle_deg=angle,
        scale=scale,
        xi=xi,
        covariance=e.covariance,
        model_sigma_px=e.model_sigma_px,
        model_px=model,
        residual_px=pair.residual_px,
        overlap=pair.overlap,
        ms_frame=ms[0],
        ms_pair=ms[1],
    )


def together(cls: str, counts: dict[str, int]) -> list[Job]:
    """Return jobs in which each method sees its first so many pairs of a class, each pair being made once."""
    stops = sorted(set(counts.values()))
    return [
        Job(cls, tuple(m for m, n in counts.items() if n >= stop), stop - start, first=start)
        for start, stop in zip((0, *stops), stops, strict=False)
    ]


def only(outcomes: Iterable[Outcome], *, method: str | None = None, cls: str | None = None) -> list[Outcome]:
    """Return the outcomes of a method, of a class, or of both."""
    return [o for o in outcomes if (method is None or o.method == method) and (cls is None or o.cls == cls)]
