"""Worlds of known truth for the full solution: cameras over hills, spots seen from several of them."""

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.slam.bundle import BundleProblem, Lens, TieSet, View
from photomap_gis.slam.bundle.fixes import FixNoise
from photomap_gis.slam.bundle.problem import exp_rotation


@dataclass
class World:
    """A problem and its truth: ``centre`` (z down), ``R`` and the camera."""

    problem: BundleProblem
    centre: np.ndarray
    R: np.ndarray
    camera: Camera
    ground: HeightField


def make_world(
    rng,
    *,
    strips=3,
    a_strip=6,
    height=100.0,
    relief=0.0,
    tilt=0.04,
    lean=(0.0, 0.0),
    noise_px=0.3,
    told=None,
    camera=None,
    spots=5,
    lens=None,
    gps_m=2.0,
    false_share=0.0,
    reach_m=np.inf,
) -> World:
    """Fly strips to and fro; ``told`` is the camera that the problem believes in, ``lean`` a common lean (radians).

    Frames further apart than ``reach_m`` share no ties.
    """
    camera = camera or Camera(1600, 1200, 1200.0)
    told = told or camera
    y, x = np.mgrid[0:12, 0:12]
    ground = HeightField((-150.0, -150.0), 40.0, relief * np.sin(x * 0.9 + 0.3) * np.cos(y * 0.7))
    centre, R, heading = [], [], []
    for s in range(strips):
        for k in range(a_strip):
            along = k if s % 2 == 0 else a_strip - 1 - k
            centre.append((40.0 * s, -22.0 * along, -height + rng.normal(0, 1.0)))
            heading.append(0.0 if s % 2 == 0 else np.pi)
    centre = np.array(centre) + np.c_[rng.normal(0, 1.0, (len(centre), 2)), np.zeros(len(centre))]
    n = len(centre)
    turn = exp_rotation(np.c_[np.zeros((n, 2)), heading])
    R = turn @ exp_rotation(np.c_[rng.normal(0, tilt, (n, 2)) + lean, rng.normal(0, 0.03, n)])

    def rays(f, xy):
        m = camera.undistort((xy - camera.principal_xy_px) / camera.focal_px)
        return np.c_[m, np.ones(len(m))] @ R[f].T

    def seen(f, points):
        p = (points - centre[f]) @ R[f]
        return camera.distort(p[:, :2] / p[:, 2:]) * camera.focal_px + camera.principal_xy_px, p[:, 2] > 0

    a, b, xa, xb, spot = [], [], [], [], []
    number = 0
    for f in range(n):
        gx, gy = np.meshgrid(np.linspace(120, 1480, spots), np.linspace(100, 1100, spots))
        xy = np.c_[gx.ravel(), gy.ravel()]
        d = rays(f, xy)
        z = np.zeros(len(xy))
        for _ in range(30):
            p = centre[f] + d * ((z - centre[f, 2]) / d[:, 2])[:, None]
            z = -ground.at(p[:, :2])
        for other in range(f):
            if np.hypot(*(centre[other] - centre[f])[:2]) > reach_m:
                continue
            q, front = seen(other, p)
            inside = front & (q > 20).all(1) & (q < (1580, 1180)).all(1)
            if inside.sum() < 4:
                continue
            a += [np.full(inside.sum(), other)]
            b += [np.full(inside.sum(), f)]
            xa += [q[inside] + rng.normal(0, noise_px, (inside.sum(), 2))]
            xb += [xy[inside]]
            spot += [number + np.flatnonzero(inside)]
        number += len(xy)
    a, b, xa, xb, spot = (np.concatenate(v) for v in (a, b, xa, xb, spot))
    false = rng.uniform(size=len(a)) < false_share
    xa[false] += rng.uniform(-60, 60, (int(false.sum()), 2))
    spot = np.unique(spot, return_inverse=True)[1]
    ties = TieSet(a, b, xa, xb, np.tile(np.eye(2) * noise_px**2, (len(a), 1, 1)), spot)
    start = centre + rng.normal(0, 1.5, (n, 3))
    views = tuple(
        View(k, 0, start[k], turn[k] @ exp_rotation(rng.normal(0, 0.02, (1, 3)))[0], turn[k], 0.07) for k in range(n)
    )
    fixes = centre[:, :2] + rng.normal(0, gps_m, (n, 2))
    noise = FixNoise.white(np.full(n, gps_m**2))
    lens = lens or Lens(told, 0.03, 0.03)
    problem = BundleProblem(views, (lens,), ties, np.arange(n), fixes, noise, np.zeros(0, np.intp))
    return World(problem, centre, R, camera, ground)


def dense_of(problem, reduced) -> tuple[np.ndarray, np.ndarray]:
    """The reduced equations in full: of views, lenses and bends, what only fixes and marks share taken out."""
    e, n = reduced.normal, len(problem.views)
    seen, size = e.layout.border.seen, e.layout.border.size
    whole = np.zeros((6 * n + size + 2 * len(e.fix_of),) * 2)
    g = np.concatenate([e.g.ravel(), e.g_border, e.g_drift.ravel()])
    for (i, j), block in zip(e.layout.slots.tolist(), e.blocks, strict=True):
        whole[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] = block
        whole[6 * j : 6 * j + 6, 6 * i : 6 * i + 6] = block.T
    border = slice(6 * n, 6 * n + size)
    whole[: 6 * n, border] = e.cross.reshape(6 * n, size)
    whole[border, : 6 * n] = e.cross.reshape(6 * n, size).T
    whole[border, border] = e.border

    def put(i, j, value):
        whole[i, j] = whole[j, i] = value

    drift = 6 * n + size + 2 * np.arange(len(e.fix_of))
    early, late, _ = e.layout.steps
    for axis in (0, 1):
        for f, view in enumerate(e.fix_of.tolist()):
            put(drift[f] + axis, drift[f] + axis, e.drift_own[f] or 1.0)
            put(drift[f] + axis, 6 * view + axis, e.drift_view[f])
            if e.drift_bias[f]:
                put(drift[f] + axis, 6 * n + e.bias_of[f] + axis, e.drift_bias[f])
        for k in range(len(early)):
            put(drift[early[k]] + axis, drift[late[k]] + axis, e.drift_next[k])
    kept = 6 * n + seen
    if len(whole) == kept:
        return whole, g
    carried = np.linalg.solve(whole[kept:, kept:], np.c_[whole[kept:, :kept], g[kept:]])
    return whole[:kept, :kept] - whole[:kept, kept:] @ carried[:, :-1], g[:kept] - whole[:kept, kept:] @ carried[:, -1]
