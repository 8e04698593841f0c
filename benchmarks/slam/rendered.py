"""Rendered flights through the product as far as the full solution, and what is true of them: cameras, ground, lens.

Nothing is drawn: where the map would show a pixel is told by the posed cameras. GPS, jitter and lens are deliberately
not what the solver takes for granted.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import FloatArray
from photomap_gis.georef import plane_view
from photomap_gis.pipeline import MapSettings
from photomap_gis.pipeline.in_space import solve_in_space
from photomap_gis.pipeline.measure import Measurements
from photomap_gis.pipeline.opening import open_mission
from photomap_gis.pipeline.prepare import SpectrumShelf, prepare_frames
from photomap_gis.pipeline.solve import solve_mission
from photomap_gis.pipeline.solved import Solved
from photomap_gis.simulate import FlightSpec, GpsError, Ground, Motion, Truth, run_simulation
from photomap_gis.simulate.evaluate import raised_mask
from photomap_gis.simulate.pose import CameraPose
from photomap_gis.slam.bundle import Bundle, BundleProblem, bundle_adjust
from photomap_gis.store import Mission

from .world import GPS

CLASSES = ("unreported", "leaning", "reported", "relief-5", "relief-10")
LEAN_DEG, LEAN_K1 = 15.0, -0.04
TILT_DEG = {"leaning": 1.2, "reported": 2.5}
"""Sigma of roll and pitch; else ``UNTOLD_DEG``, which no file tells."""
UNTOLD_DEG = 1.7
TOLD_SIGMA_DEG = 0.3
"""How wrong reported attitudes are: the solver takes what a photo's gimbal tells for twice to three times as wrong."""
HEIGHT_M = {"relief-5": 240.0, "relief-10": 120.0}
"""Over houses, trees and rubble of up to 12 m these make a relief of 5 and 10 %; the other classes fly at 100 m."""
FRAMES, WIDTH_PX, HEIGHT_PX = 36, 1000, 750
PIXELS = 5
"""Pixels of a frame that are looked up on the ground, along either side."""
RAY_STEPS = 40
NED_TO_MAP = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From grid north, east, down to x east, y south, z down."""


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """The full solution of one flight beside its truth.

    ``centre_xy_m`` ``(N, 2)`` and ``R`` ``(N, 3, 3)`` are the true cameras of the problem's views, in its axes; of
    N x K pixels ``xy_px`` ``(N, K, 2)`` the land that they show truly lies at ``land_xy_m`` ``(N, K, 2)``, NaN where
    they show what stands on the land or beside it. ``camera`` is the true one.
    """

    problem: BundleProblem
    bundle: Bundle
    centre_xy_m: FloatArray
    R: FloatArray
    xy_px: FloatArray
    land_xy_m: FloatArray
    camera: Camera
    gsd_m_per_px: float
    frames: int


def spec_of(kind: str, seed: int, rng: np.random.Generator) -> FlightSpec:
    """Return a small flight of a class."""
    leans = kind == "leaning"
    bias = rng.normal(0.0, GPS.bias_m, 2)
    return FlightSpec(
        frames=FRAMES, width_px=WIDTH_PX, height_px=HEIGHT_PX, altitude_m=HEIGHT_M.get(kind, 100.0), seed=seed,
        motion=Motion(tilt_deg=TILT_DEG.get(kind, UNTOLD_DEG), lean_deg=LEAN_DEG if leans else 0.0),
        k1=LEAN_K1 if leans else 0.0, report_calibration=not leans,
        report_attitude=kind == "reported", attitude_sigma_deg=TOLD_SIGMA_DEG,
        gps=GpsError(GPS.white_m, GPS.drift_m, GPS.drift_time_s, float(bias[0]), float(bias[1])),
    )  # fmt: skip


def fly_posed(kind: str, seed: int, rng: np.random.Generator, folder: Path) -> Posed:
    """Fly one flight of a class and pose it; ``RuntimeError`` where it was not posed in space."""
    flight = run_simulation("procedural", folder / "flight", spec_of(kind, seed, rng))
    mission, settings = open_mission([flight.source], folder / "mission", MapSettings(), add=False, on_progress=_quiet)
    found: list[tuple[BundleProblem, Bundle]] = []

    def adjust(problem: BundleProblem) -> Bundle:
        found.append((problem, bundle_adjust(problem, joint=True)))
        return found[-1][1]

    with mission:
        solved = _flat(mission, settings)
        solve_in_space(solved[0].frames, solved[1], solved[2], solved[0], adjust=adjust)
    if not found:
        raise RuntimeError(f"{kind} {seed}: the flight was not posed in space")
    return posed(*found[-1], flight.truth, solved[0].map_frame)


def posed(problem: BundleProblem, bundle: Bundle, truth: Truth, map_frame: MapFrame) -> Posed:
    """Return a solution beside its truth."""
    frames = {f.index: f for f in truth.frames}
    true = [frames[v.frame] for v in problem.views]
    ground = truth.ground()
    open_land = _open_land(ground)
    x, y = ((np.arange(PIXELS) + 0.5) / PIXELS * side - 0.5 for side in (truth.camera.width_px, truth.camera.height_px))
    xy_px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    land = [land_seen(ground, open_land, f.pose, truth.camera, xy_px) for f in true]
    return Posed(
        problem,
        bundle,
        map_frame.from_crs([(f.pose.easting_m, f.pose.northing_m) for f in true]),
        np.array([NED_TO_MAP @ f.pose.R_grid_camera for f in true]),
        np.broadcast_to(xy_px, (len(true), *xy_px.shape)),
        map_frame.from_crs(np.array(land)),
        truth.camera,
        truth.gsd_m_per_px,
        len(truth.frames),
    )


def land_seen(ground: Ground, open_land: np.ndarray, pose: CameraPose, camera: Camera, xy_px: FloatArray) -> FloatArray:
    """``(K, 2)`` eastings, northings of the open land that pixels show; NaN where they show anything else."""
    height = np.full(len(xy_px), float(np.median(ground.heights_at([(pose.easting_m, pose.northing_m)]))))
    points = np.zeros((len(xy_px), 2))
    for _ in range(RAY_STEPS):
        came_from = height
        points = np.array(
            [pose.ground_points(camera, p[None], float(h))[0] for p, h in zip(xy_px, height, strict=True)]
        )
        height = ground.heights_at(np.nan_to_num(points, nan=0.0))
        if np.abs(height - came_from).max() < 1e-3:
            break
    column, row = np.round(ground.grid.to_px(points)).T
    rows, columns = open_land.shape
    inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows) & (np.abs(height - came_from) < 1e-2)
    shown = np.zeros(len(points), bool)
    shown[inside] = open_land[row[inside].astype(int), column[inside].astype(int)]
    return np.where(shown[:, None], points, np.nan)


def _open_land(ground: Ground) -> np.ndarray:
    if ground.height_m is None:
        return np.ones(ground.colour.shape[:2], bool)
    return ~raised_mask(ground.height_m, ground.pixel_size_m)


def _flat(mission: Mission, settings: MapSettings) -> tuple[Solved, dict, Measurements]:
    """Return the flat solution with its loops, the views, and what was measured."""
    frames = tuple(mission.frames)
    views = {f.index: plane_view(f) for f in frames}
    prepared = prepare_frames(mission, frames, views, settings, _quiet)
    found = Measurements(mission, SpectrumShelf(mission), prepared, settings, _quiet)
    found.take_sequential(frames)

    def solved() -> Solved:
        return solve_mission(mission, frames, views, found, settings, with_control=False)

    for more in (found.take_loops, found.take_missing):
        more(solved().clusters(views))
    return solved(), views, found


def _quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""
