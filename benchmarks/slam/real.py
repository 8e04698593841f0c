"""Real photos: how far each fix lies from where all that is known without it expects it, and the lens against the file.

A receiver's fixes are no truth: what is left out tells whether the predicted sigmas cover them.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from photomap_gis.core.frame import FrameRef
from photomap_gis.georef import WHITE_SIGMA_M, plane_view
from photomap_gis.pipeline import MapSettings
from photomap_gis.pipeline.in_space import solve_in_space
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import open_mission
from photomap_gis.pipeline.prepare import SpectrumShelf, prepare_frames
from photomap_gis.pipeline.solve import solve_mission
from photomap_gis.pipeline.solved import Solved
from photomap_gis.slam.bundle import Bundle, BundleProblem, bundle_adjust
from photomap_gis.store import Mission

from ..registration.report import Figure, Section
from ..registration.score import Interval, bootstrap
from .measure import Options

PHOTOS = Path(__file__).resolve().parents[3] / "shared" / "data" / "caliterra" / "images"
FOLDS = 5


def real_flight(options: Options) -> Section:
    """Leave a fifth of the fixes of caliterra out at a time, in runs of neighbours, and see where they are expected."""
    if not PHOTOS.is_dir():
        return Section("real flight", (), notes=("the photos are not there",))
    with tempfile.TemporaryDirectory() as folder:
        mission, settings = open_mission([PHOTOS], Path(folder) / "m", MapSettings(), add=False, on_progress=_quiet)
        with mission:
            return _measured(mission, settings, options)


def _measured(mission: Mission, settings: MapSettings, options: Options) -> Section:
    frames = tuple(mission.frames)
    views = {f.index: plane_view(f) for f in frames}
    prepared = prepare_frames(mission, frames, views, settings, _quiet)
    found = Measurements(mission, SpectrumShelf(mission), prepared, settings, _quiet)
    found.take_sequential(frames)

    def solved(given: tuple[FrameRef, ...]) -> Solved:
        return solve_mission(mission, given, views, found, settings, with_control=False)

    def flat(given: tuple[FrameRef, ...]) -> dict[int, np.ndarray]:
        return {p.frame: np.asarray(p.centre_xy_map_m) for p in solved(given).trajectory.placements}

    found.take_loops(solved(frames).clusters(views))
    posed: list[tuple[BundleProblem, Bundle]] = []

    def adjust(problem: BundleProblem) -> Bundle:
        posed.append((problem, bundle_adjust(problem, joint=True)))
        return posed[-1][1]

    whole = solve_in_space(frames, views, found, solved(frames), adjust=adjust)
    problem, bundle = posed[-1]
    off, claimed = fixes_left_out(problem, bundle)
    everything = flat(frames)
    drawn = [f.index for f in frames if f.fix is not None and f.index in everything]
    moved = []
    for k, fold in enumerate(np.array_split(np.array(drawn), FOLDS)):
        left_out = set(fold.tolist())
        without = flat(tuple(replace(f, fix=None) if f.index in left_out else f for f in frames))
        moved += [float(np.hypot(*(without[i] - everything[i]))) for i in left_out if i in without]
        options.on_progress(k + 1, FOLDS)
    lens = whole.lenses[0]
    draw = options.rng(7)
    n = len(moved)
    fit, ce90 = whole.fit_to_gps_rms_m or float("nan"), whole.predicted_ce90_m or float("nan")
    return Section(
        "real flight",
        (
            Figure("frames placed", _exact(len(whole.trajectory.placements)), len(frames), ""),
            Figure("cameras moved by their neighbourhood's fixes, median", bootstrap(moved, np.median, draw), n, "m"),
            Figure("fix against what all but it expect, RMSE", bootstrap(np.hypot(*off.T), _rms, draw), len(off), "m"),
            Figure("the same, median", bootstrap(np.hypot(*off.T), np.median, draw), len(off), "m"),
            Figure(
                "its squared error / claimed variance",
                bootstrap(np.sum(off**2, axis=1) / claimed / 2.0, np.mean, draw),
                len(off),
                "",
            ),
            Figure("fit to GPS, RMS", _exact(fit), n, "m"),
            Figure("predicted CE90", _exact(ce90), n, "m"),
            Figure("focal length over the file's", _exact(lens.focal_px / lens.focal_before_px), n, "x"),
            Figure("its claimed sigma", _exact(lens.focal_sigma_rel), n, "%"),
        ),
        notes=(
            f"caliterra, {len(frames)} photos in one block; a fifth of the fixes at a time is left out, in runs of "
            "neighbours. The receiver drifts: its altitude climbs by 114 m while the pictures' scale stays within 5 %.",
            "A fix against what all but it expect: from the other fixes, which share its drift, and the full solution. "
            f"Fixes are taken for {np.sqrt(float(np.median(problem.fix_noise.white_variance))) / WHITE_SIGMA_M:.1f} "
            "times as wrong as usual, for so they miss the flat solution.",
        ),
    )


def fixes_left_out(problem: BundleProblem, bundle: Bundle) -> tuple[np.ndarray, np.ndarray]:
    """Return how far each fix lies from where it is expected when it alone is left out ``(F, 2)``, and that distance's
    variance along either axis ``(F,)``.

    Of observations with information W and a solution x with covariance P the information of their errors and x's
    together is W - W P W, and by it each is told by all others (as in ``fix_noise``): no solution is made again.
    """
    W = problem.fix_noise.information
    miss = problem.fix_xy - bundle.centre[problem.fix_of, :2]
    off, claimed = np.empty_like(miss), np.empty(miss.shape)
    assert bundle.joint is not None
    for axis in (0, 1):
        rows = 6 * problem.fix_of + axis
        P = bundle.joint[np.ix_(rows, rows)]
        own = np.diag(W - W @ P @ W)
        off[:, axis], claimed[:, axis] = (W @ miss[:, axis]) / own, 1.0 / own
    return off, claimed.mean(axis=1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


def _exact(value: float) -> Interval:
    return Interval(value, value, value)
