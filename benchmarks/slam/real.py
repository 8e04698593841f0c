"""Real photos: how far a fix lies from where a map made without it puts the camera, and the lens against the file.

A receiver's fixes are no truth: what is left out tells whether the predicted sigmas cover them.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from photomap_gis.core.frame import FrameRef
from photomap_gis.georef import plane_view
from photomap_gis.pipeline import MapSettings
from photomap_gis.pipeline.flight import settle
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import open_mission
from photomap_gis.pipeline.prepare import SpectrumShelf, prepare_frames
from photomap_gis.pipeline.solve import solve_mission
from photomap_gis.pipeline.solved import Solved
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
    whole = settle(mission, frames, views, found, settings, solved(frames))
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
            Figure("fit to GPS, RMS", _exact(fit), n, "m"),
            Figure("predicted CE90", _exact(ce90), n, "m"),
            Figure("focal length over the file's", _exact(lens.focal_px / lens.focal_before_px), n, "x"),
            Figure("its claimed sigma", _exact(lens.focal_sigma_rel), n, "%"),
        ),
        notes=(
            f"caliterra, {len(frames)} photos in one block; a fifth of the fixes at a time is left out, in runs of "
            "neighbours. The receiver drifts: its altitude climbs by 114 m while the pictures' scale stays within 5 %.",
        ),
    )


def _quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


def _exact(value: float) -> Interval:
    return Interval(value, value, value)
