"""The measurements, one function each."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from photomap_gis.core.posegraph import Edge, EdgeKind, PoseGraph
from photomap_gis.slam import solve
from photomap_gis.slam.optimize import Backend, backend_named, optimised_poses
from photomap_gis.slam.scipy_backend import pose_covariances

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval, bootstrap, wilson
from .measure import (
    Options,
    absolute_errors_m,
    absolute_nees,
    closest_similarity,
    pooled_ratio,
    relative_nees,
    relative_rmse_m,
    rms,
)
from .posed import in_space
from .real import real_flight
from .whole import whole_case
from .world import GPS, Flown, Plan, fly, graph_of

TILT_RAD = np.radians(0.7)
PAPER_NODES, PAPER_EDGES = 630, 12364
TEN_MINUTES = Plan(300, strip_m=300.0, height_m=80.0, forward=0.78, side=0.6, tilt_sigma_rad=np.radians(0.6))
"""300 frames, 2 s apart, at 8 m/s; a gimbal that is level but for 0.6 degrees."""
LAWNMOWER = Plan(600, forward=0.78, side=0.64, tilt_sigma_rad=TILT_RAD)


def lawnmower(options: Options) -> Section:
    """Relative error of 600 frames on strips of 64 % side overlap, with loops and without."""
    flights = 3 if options.quick else 10
    looped, sequential, level = [], [], []
    for k in range(flights):
        rng = options.rng(1, k)
        flown = fly(rng, LAWNMOWER)
        graph = _chosen_loops(graph_of(rng, flown, gps=None))
        looped.append(relative_rmse_m(flown, solve(graph)) / flown.length_m)
        sequential.append(relative_rmse_m(flown, solve(_chain(graph))) / flown.length_m)
        still = fly(rng, replace(LAWNMOWER, tilt_sigma_rad=0.0))
        level.append(relative_rmse_m(still, solve(_chosen_loops(graph_of(rng, still, gps=None)))) / still.length_m)
        options.on_progress(k + 1, flights)
    draw = options.rng(1, 999)
    return Section(
        "lawnmower",
        (
            Figure("RMSE / path, tilt 0.7 deg", bootstrap(looped, np.mean, draw), flights, "%", Bar(high=0.0002)),
            Figure("the same, sequential registrations alone", bootstrap(sequential, np.mean, draw), flights, "%"),
            Figure("RMSE / path, level cameras", bootstrap(level, np.mean, draw), flights, "%"),
        ),
        notes=(
            "600 frames, no fixes: RMSE of image centres after the best similarity over the length of the path; "
            "n: flights. Tilted cameras are neither levelled nor told: their planes are the raw pictures.",
        ),
    )


def speed(options: Options) -> Section:
    """CPU time of the paper's case: 630 nodes, 12,364 edges and the GPS."""
    rng = options.rng(2)
    flown = fly(rng, Plan(PAPER_NODES, forward=0.85, side=0.72))
    graph = graph_of(rng, flown, loops=PAPER_EDGES - PAPER_NODES + 1, least=0.15)
    rounds = 3 if options.quick else 9
    backends: list[Backend] = ["gtsam", "scipy"] if importlib.util.find_spec("gtsam") else ["scipy"]
    start_at = optimised_poses(_chain(graph))
    odometry = start_at.robust.state
    plain: dict[str, list[float]] = {b: [] for b in backends}
    poses: dict[str, list[float]] = {b: [] for b in backends}
    whole: dict[str, list[float]] = {b: [] for b in backends}
    covariances: list[float] = []
    for k in range(rounds):
        for backend in backends:
            start = time.process_time()
            prepared = optimised_poses(graph, backend=backend)
            poses[backend].append(time.process_time() - start)
            start = time.process_time()
            backend_named(backend)(prepared.problem, prepared.robust.effective, odometry)
            plain[backend].append(time.process_time() - start)
            start = time.process_time()
            pose_covariances(prepared.problem, prepared.robust.state, prepared.robust.effective)
            covariances.append(time.process_time() - start)
            start = time.process_time()
            solve(graph, backend=backend)
            whole[backend].append(time.process_time() - start)
        options.on_progress(k + 1, rounds)
    limits = {"gtsam": 0.5, "scipy": 2.5}
    figures = [
        Figure(f"least squares from odometry, {b}", _median(plain[b]), rounds, "s", Bar(high=limits[b]))
        for b in backends
    ]
    figures += [Figure(f"from edges to robust poses, {b}", _median(poses[b]), rounds, "s") for b in backends]
    figures.append(Figure("covariances of all poses", _median(covariances), len(covariances), "s", Bar(high=1.5)))
    figures += [Figure(f"everything, {b}", _median(whole[b]), rounds, "s") for b in backends]
    return Section(
        "speed",
        tuple(figures),
        notes=(
            f"{len(graph.frames)} nodes, {len(graph.edges)} edges, {len(graph.positions)} fixes; CPU time in one "
            "thread, median with its range. Odometry: sequential registrations and the fixes alone. Robust poses hold "
            "the layout by linear steps and all rounds of re-weighting; everything holds the covariances too.",
            "The paper's figure is 2.12 s. SciPy's solver may take five times as long.",
        ),
    )


def false_loops(options: Options) -> Section:
    """How far planted false loops bend the map."""
    flights = 6 if options.quick else 20
    plan = replace(TEN_MINUTES, frames=200)
    growth: dict[tuple[float, bool], list[float]] = {}
    missed: dict[float, list[float]] = {0.05: [], 0.2: []}
    clean: dict[bool, list[float]] = {False: [], True: []}
    for k in range(flights):
        for with_gps in (False, True):
            by_share = {}
            for share in (0.0, *missed):
                rng = options.rng(3, k)  # the same flight and the same noise for each share
                flown = fly(rng, plan)
                graph = graph_of(rng, flown, gps=GPS if with_gps else None, false=share)
                solution = solve(graph)
                by_share[share] = relative_rmse_m(flown, solution)
                if share and with_gps:
                    left = _is_false(flown, graph)
                    missed[share].append(float(np.mean([j not in set(solution.rejected) for j in left])))
            clean[with_gps].append(by_share.pop(0.0))
            for share, value in by_share.items():
                growth.setdefault((share, with_gps), []).append(value)
        options.on_progress(k + 1, flights)
    draw = options.rng(3, 999)
    figures = []
    for (share, with_gps), values in sorted(growth.items()):
        grown = pooled_ratio(values, clean[with_gps], draw)
        name = f"{share:.0%} false loops, {'with' if with_gps else 'without'} GPS: error over clean"
        figures.append(Figure(name, grown, flights, "x", Bar(high=1.1 if share == 0.05 else 1.5)))
    for share, values in missed.items():
        figures.append(Figure(f"{share:.0%} false loops: left in the graph", _mean(values, draw), flights))
    return Section(
        "false loops",
        tuple(figures),
        notes=("Relative RMSE pooled over flights; false loops claim as small a covariance as good ones.",),
    )


def absolute(options: Options) -> Section:
    """Absolute error against a perfect relative map on the same fixes, and what the solver says of its error."""
    ours, by_solver, by_plain, sharp = [], [], [], {3.0: ([], []), 1 / 3.0: ([], [])}
    nees, nees_level, nees_tilted = [], [], []
    for k in range(options.seeds):
        rng = options.rng(4, k)
        flown = fly(rng, TEN_MINUTES)
        graph = _chosen_loops(graph_of(rng, flown))
        solution, perfect = solve(graph), _perfect(flown, graph)
        ours.append(rms(absolute_errors_m(flown, solution)))
        by_solver.append(rms(absolute_errors_m(flown, solve(perfect))))
        by_plain.append(rms(closest_similarity(flown, graph).apply(flown.centres_m) - flown.centres_m))
        nees.append(absolute_nees(flown, solution))
        for factor, (mine, theirs) in sharp.items():
            wrong = _with_drift_time(graph, factor)
            mine.append(rms(absolute_errors_m(flown, solve(wrong))))
            theirs.append(by_solver[-1])
        relative = solve(replace(graph, positions=(), scales=(), headings=()))
        nees_tilted.append(relative_nees(flown, relative))
        still = fly(rng, replace(TEN_MINUTES, tilt_sigma_rad=0.0))
        nees_level.append(relative_nees(still, solve(_chosen_loops(graph_of(rng, still, gps=None)))))
        options.on_progress(k + 1, options.seeds)
    draw = options.rng(4, 999)
    n = options.seeds
    figures = [
        Figure("absolute RMSE", bootstrap(ours, _root_mean_square, draw), n, "m"),
        Figure(
            "over a perfect map, the solver's least squares",
            pooled_ratio(ours, by_solver, draw),
            n,
            "x",
            Bar(high=1.05),
        ),
        Figure("over a perfect map, plain least squares", pooled_ratio(ours, by_plain, draw), n, "x", Bar(high=1.05)),
    ]
    for factor, (mine, theirs) in sharp.items():
        figures.append(
            Figure(
                f"over it, correlation time taken {factor:.2g} x",
                pooled_ratio(mine, theirs, draw),
                n,
                "x",
                Bar(high=1.15),
            )
        )
    figures.append(Figure("NEES / dof, absolute", _mean(nees, draw), n, "", Bar(0.7, 1.5)))
    figures.append(
        Figure("NEES / dof, relative to the first frame, level cameras", _mean(nees_level, draw), n, "", Bar(0.7, 1.5))
    )
    figures.append(Figure("the same, 0.6 deg of untold lean", _mean(nees_tilted, draw), n, ""))
    return Section(
        "absolute",
        tuple(figures),
        notes=(
            f"{n} flights of 10 minutes; GPS: {GPS.white_m:g} m white, {GPS.drift_m:g} m of drift with "
            f"{GPS.drift_time_s:g} s, {GPS.bias_m:g} m of bias, {GPS.blunders:.0%} blunders, {GPS.dropouts:.0%} "
            "dropouts (the solver takes 0.5 m, 2 m, 60 s, 1 m). Intervals by resampling whole flights.",
            "A perfect map is the true one: laid on the same fixes by the solver itself (exact registrations, the same "
            "heights and headings), and by the closest similarity (fixes alone).",
            "A lean is one frame's and bends all of its registrations alike, which similarities with independent "
            "covariances cannot say: relative sigmas of leaning cameras are too small until full poses are solved.",
        ),
    )


def time_offset(options: Options) -> Section:
    """How well the time between fixes and pictures is told by the motion."""
    error, nees = [], []
    told = 0
    for k in range(options.seeds):
        rng = options.rng(5, k)
        flown, late_s = fly(rng, TEN_MINUTES), float(rng.uniform(-3.0, 3.0))
        solution = solve(_chosen_loops(graph_of(rng, flown, late_s=late_s)))
        found = solution.fix_lags.get(0)
        told += found is not None
        error.append(abs(found.lag_s - late_s) if found is not None else np.inf)
        if found is not None:
            nees.append(((found.lag_s - late_s) / found.sigma_s) ** 2)
        options.on_progress(k + 1, options.seeds)
    draw = options.rng(5, 999)
    n = options.seeds
    return Section(
        "time offset",
        (
            Figure("largest error", Interval(max(error), max(error), max(error)), n, "s",
                   Bar(high=0.1)),
            Figure("median error", bootstrap(error, np.median, draw), n, "s"),
            Figure("told at all", wilson(told, n), n),
            Figure("squared error / claimed variance", _mean(nees, draw), len(nees), "", Bar(0.3, 3.0)),
        ),
        notes=(f"Flights of 10 minutes, fixes up to 3 s off their pictures either way, GPS as in `absolute`; n: {n}.",),
    )  # fmt: skip


SECTIONS: dict[str, Callable[[Options], Section]] = {
    "lawnmower": lawnmower,
    "speed": speed,
    "false-loops": false_loops,
    "absolute": absolute,
    "time-offset": time_offset,
    "whole-case": whole_case,
    "in-space": in_space,
    "real-flight": real_flight,
}


def _chosen_loops(graph: PoseGraph, per_frame: int = 12) -> PoseGraph:
    """Return the graph with about as many loops a frame as the product takes, spread evenly over all there are."""
    loops = [e for e in graph.edges if e.kind is EdgeKind.LOOP]
    wanted = per_frame * len(graph.frames) // 2
    step = max(1.0, len(loops) / max(wanted, 1))
    kept = {id(loops[int(k * step)]) for k in range(min(wanted, len(loops))) if int(k * step) < len(loops)}
    return replace(graph, edges=tuple(e for e in graph.edges if e.kind is EdgeKind.SEQUENTIAL or id(e) in kept))


def _chain(graph: PoseGraph) -> PoseGraph:
    """Return the graph without its loops."""
    return replace(graph, edges=tuple(e for e in graph.edges if e.kind is EdgeKind.SEQUENTIAL))


def _perfect(flown: Flown, graph: PoseGraph) -> PoseGraph:
    """Return the graph with the true motions in place of the measured ones, all but exact."""
    exact = np.diag([1e-3, 1e-3, 1e-6, 1e-6]) ** 2

    def truth(e: Edge) -> Edge:
        return replace(e, T_a_b=flown.poses[e.a].inverse() @ flown.poses[e.b], covariance=exact)

    return replace(graph, edges=tuple(truth(e) for e in graph.edges))


def _with_drift_time(graph: PoseGraph, factor: float) -> PoseGraph:
    return replace(
        graph,
        positions=tuple(replace(p, correlation_time_s=p.correlation_time_s * factor) for p in graph.positions),
    )


def _is_false(flown: Flown, graph: PoseGraph) -> list[int]:
    """The edges that lie more than 20 sigma from the truth."""
    out = []
    for k, e in enumerate(graph.edges):
        xi = (e.T_a_b.inverse() @ flown.poses[e.a].inverse() @ flown.poses[e.b]).log()
        if xi @ np.linalg.solve(e.covariance, xi) > 400.0:
            out.append(k)
    return out


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _mean(values: list[float], rng: np.random.Generator) -> Interval:
    return bootstrap(values, np.mean, rng)


def _median(values: list[float]) -> Interval:
    return Interval(float(np.median(values)), float(np.min(values)), float(np.max(values)))
