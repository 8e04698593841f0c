"""Is the full solution as good as it says? Rendered flights, solved in space, against their truth."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from photomap_gis.core.placement import PosedPlacement
from photomap_gis.core.similarity import FloatArray

from ..registration.report import Bar, Figure, Section, Table
from ..registration.score import Interval, bootstrap
from .measure import Options
from .rendered import CLASSES, Posed, fly_posed

WORKERS = 2
NEES = Bar(0.7, 1.5)
LIMIT_GSD = {"unreported": 1.0, "reported": 1.0, "leaning": 3.0, "relief-5": 2.0, "relief-10": 3.0}
FOCAL_LIMIT = 0.005


@dataclass(frozen=True, slots=True)
class Judged:
    """One flight's figures: NEES over degrees of freedom of cameras and of ground pixels, absolute and relative; the
    relative RMSE of the pixels and what it was predicted to be; focal length and k1, off by how much and how sure."""

    kind: str
    placed: int
    frames: int
    cameras: float
    cameras_relative: float
    turns: float
    pixels: float
    pixels_relative: float
    rmse_gsd: float
    predicted_gsd: float
    focal_off: float
    focal_sigma: float
    focal_observed: bool
    k1_off: float
    k1_sigma: float
    k1_observed: bool


def in_space(options: Options) -> Section:
    """Fly every class as often, pose the flights, and pool what their covariances are worth."""
    each = max(1, -(-options.seeds // len(CLASSES)))
    jobs = [(kind, 10_000 * options.seed + 1000 * (c + 1) + k) for k in range(each) for c, kind in enumerate(CLASSES)]
    judged: list[Judged] = []
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        flights = [pool.submit(fly_and_judge, kind, seed) for kind, seed in jobs]
        for done, flight in enumerate(as_completed(flights)):
            judged.append(flight.result())
            options.on_progress(done + 1, len(jobs))
    return section(judged, options)


def fly_and_judge(kind: str, seed: int) -> Judged:
    """Fly, pose and judge one flight."""
    with tempfile.TemporaryDirectory() as folder:
        return judge(kind, fly_posed(kind, seed, np.random.default_rng((0x5ACE, seed)), Path(folder)))


def judge(kind: str, flight: Posed) -> Judged:
    """Compare a posed flight with its truth."""
    b, n = flight.bundle, len(flight.problem.views)
    assert b.joint is not None and b.joint_over_ground is not None
    miss = b.centre[:, :2] - flight.centre_xy_m
    rows = (6 * np.arange(n)[:, None] + np.arange(2)).ravel()
    cameras = nees(miss, b.covariance[:, :2, :2])
    relative = nees(*after_similarity(miss, b.joint[np.ix_(rows, rows)], flight.centre_xy_m))
    turns = turn_between(flight.R, b.R_map_camera)
    found, true, J, own = _pixels(flight)
    joint = J @ b.joint_over_ground @ J.T + _block_diagonal(own)
    plain = np.array([joint[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(found))])
    off, claimed = after_similarity(found - true, joint, true)
    lens = b.lenses[0]
    gsd = flight.gsd_m_per_px
    return Judged(
        kind, n, flight.frames, cameras, relative, nees(turns, b.covariance[:, 3:, 3:]),
        nees(found - true, plain), nees(off, claimed),
        float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) / gsd,
        float(np.sqrt(np.mean(np.trace(claimed, axis1=1, axis2=2)))) / gsd,
        float(np.log((lens.camera.focal_px or 1.0) / (flight.camera.focal_px or 1.0))), lens.focal_sigma_log,
        lens.focal_observed, lens.camera.k1 - flight.camera.k1, lens.k1_sigma, lens.k1_observed,
    )  # fmt: skip


def nees(off: FloatArray, claimed: FloatArray) -> float:
    """Mean squared error ``(N, D)`` in the claimed covariances ``(N, D, D)``, per degree of freedom."""
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(claimed, off[:, :, None])[:, :, 0])
    return float(np.mean(squared)) / off.shape[1]


def after_similarity(off: FloatArray, joint: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what ``(N, 2)`` errors are when the best similarity of all is taken away, and each one's covariance then.

    ``joint`` ``(2 N, 2 N)`` is the covariance of all errors together: a similarity takes part of it along.
    """
    middle = xy - xy.mean(axis=0)
    A = np.zeros((2 * len(xy), 4))
    A[::2, 0] = A[1::2, 1] = 1.0
    A[::2, 2], A[1::2, 2] = middle.T
    A[::2, 3], A[1::2, 3] = -middle[:, 1], middle[:, 0]
    Q = np.linalg.qr(A)[0]
    # P joint P with P = I - Q Q^T, without a product of two large matrices
    half = joint - Q @ (Q.T @ joint)
    left = half - (half @ Q) @ Q.T
    blocks = np.array([left[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(xy))])
    flat = off.ravel()
    return np.asarray((flat - Q @ (Q.T @ flat)).reshape(-1, 2)), blocks


def turn_between(R: FloatArray, found: FloatArray) -> FloatArray:
    """``(N, 3)`` turns from found attitudes to true ones, small ones."""
    T = R @ found.transpose(0, 2, 1)
    return np.stack([T[:, 2, 1] - T[:, 1, 2], T[:, 0, 2] - T[:, 2, 0], T[:, 1, 0] - T[:, 0, 1]], axis=1) / 2.0


def _pixels(flight: Posed) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return where pixels lie on the map and in truth ``(P, 2)``, the derivative of that by all poses ``(2 P, 6 N)``,
    and the covariance that each has for itself, of the ground's height ``(P, 2, 2)``."""
    b, n = flight.bundle, len(flight.problem.views)
    found, true, rows, own = [], [], [], []
    for k, view in enumerate(flight.problem.views):
        shown = np.isfinite(flight.land_xy_m[k]).all(axis=1)
        place = PosedPlacement(b.lenses[view.lens].camera, b.centre[k] * (1.0, 1.0, -1.0), b.R_map_camera[k], b.ground)
        xy = flight.xy_px[k][shown]
        found.append(place.project(xy))
        true.append(flight.land_xy_m[k][shown])
        own.append(place.position_covariance(xy, np.zeros((6, 6))))
        part = np.zeros((2 * len(xy), 6 * n))
        for j in range(6):
            part[:, 6 * k + j] = _derivative(place, xy, j).ravel()
        rows.append(part)
    return np.concatenate(found), np.concatenate(true), np.concatenate(rows), np.concatenate(own)


def _derivative(place: PosedPlacement, xy: FloatArray, number: int) -> FloatArray:
    """``(P, 2)`` how pixels move on the map with one number of the pose, over ground that stays level around them."""
    h = 1e-4
    ends = []
    for sign in (1.0, -1.0):
        step = np.zeros(6)
        step[number] = sign * h
        turn = np.eye(3) + np.array([[0, -step[5], step[4]], [step[5], 0, -step[3]], [-step[4], step[3], 0]])
        centre = place.centre_map + step[:3] * (1.0, 1.0, -1.0)
        ends.append(PosedPlacement(place.camera, centre, turn @ place.R_map_camera, place.ground).project(xy))
    return np.asarray((ends[0] - ends[1]) / (2.0 * h))


def _block_diagonal(blocks: FloatArray) -> FloatArray:
    out = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for k, block in enumerate(blocks):
        out[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return out


def section(judged: Sequence[Judged], options: Options) -> Section:
    """Return the pooled figures and a table of the classes."""
    draw, n = options.rng(8, 999), len(judged)

    def pooled(values: Sequence[float]) -> Interval:
        return bootstrap(values, np.mean, draw)

    lenses = [j for j in judged if j.focal_observed]
    bent = [j for j in judged if j.k1_observed]
    figures = [
        Figure("NEES / dof, cameras, absolute", pooled([j.cameras for j in judged]), n, "", NEES),
        Figure("NEES / dof, cameras, relative", pooled([j.cameras_relative for j in judged]), n, "", NEES),
        Figure("NEES / dof, ground pixels, absolute", pooled([j.pixels for j in judged]), n, "", NEES),
        Figure("NEES / dof, ground pixels, relative", pooled([j.pixels_relative for j in judged]), n, "", NEES),
        Figure("NEES / dof, turns of cameras", pooled([j.turns for j in judged]), n, ""),
    ]
    if lenses:
        worst = max(abs(j.focal_off) for j in lenses)
        figures.append(Figure("focal length where told: largest error", _exact(worst), len(lenses), "%",
                              Bar(high=FOCAL_LIMIT)))  # fmt: skip
        told = pooled([(j.focal_off / j.focal_sigma) ** 2 for j in lenses])
        figures.append(Figure("its squared error / claimed variance", told, len(lenses), ""))
    if bent:
        figures.append(Figure("k1 where told: squared error / claimed variance",
                              pooled([(j.k1_off / j.k1_sigma) ** 2 for j in bent]), len(bent), ""))  # fmt: skip
    rows = []
    for kind in CLASSES:
        of = [j for j in judged if j.kind == kind]
        if not of:
            continue
        rmse = bootstrap([j.rmse_gsd for j in of], _root_mean_square, draw)
        figures.append(Figure(f"{kind}: relative RMSE of ground pixels over the GSD", rmse, len(of), "x",
                              Bar(high=LIMIT_GSD[kind])))  # fmt: skip
        rows.append(
            (kind, f"{sum(j.placed for j in of)}/{sum(j.frames for j in of)}", *(
                f"{np.mean([getattr(j, name) for j in of]):.2f}"
                for name in ("cameras", "cameras_relative", "pixels", "pixels_relative", "turns", "rmse_gsd",
                             "predicted_gsd")
            ), f"{100 * np.mean([j.focal_off for j in of]):+.2f}", f"{1e3 * np.mean([j.k1_off for j in of]):+.2f}")
        )  # fmt: skip
    return Section(
        "in space",
        tuple(figures),
        (
            Table(
                "Classes: means over flights",
                ("class", "posed", "NEES cameras", "relative", "NEES pixels", "relative", "turns", "RMSE GSD",
                 "predicted GSD", "focal %", "k1 / 1000"),
                tuple(rows),
            ),
        ),
        (
            f"{n} rendered flights of 36 photos, each with its own seed and GPS error; of each frame 25 pixels are "
            "looked up where they show open land. "
            "Relative: after the best similarity, against what the covariance of all together says is then left. "
            "Jitter, GPS, lens and errors of reported attitude are not the solver's.",
        ),
        {"flights": [{name: getattr(j, name) for name in Judged.__slots__} for j in judged]},
    )  # fmt: skip


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _exact(value: float) -> Interval:
    return Interval(value, value, value)
