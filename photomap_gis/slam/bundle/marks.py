"""Known points of the ground in the full solution: where a pixel must lie on the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.model import LEAST_DOWN, of_undistorting
from photomap_gis.slam.bundle.problem import BundleState, IntArray, Marks, cross_matrix


@dataclass(frozen=True, slots=True, eq=False)
class MarkTerms:
    """``residual`` ``(K, 2)`` map units (seen minus known), its derivatives by the view's step ``(K, 2, 6)`` and by its
    lens's ``(K, 2, 2)``, the information ``own`` ``(K, 2, 2)`` of what each has for itself, and of the places that some
    share: ``place`` ``(G, 2, 2)``."""

    residual: FloatArray
    by_view: FloatArray
    by_lens: FloatArray
    own: FloatArray
    group: IntArray
    place: FloatArray

    def weigh(self, values: FloatArray) -> FloatArray:
        """Return the information of all marks together times ``(K, 2, C)`` values."""
        out = self.own @ values
        for g, place in enumerate(self.place):
            of = self.group == g
            known = place + self.own[of].sum(axis=0)
            out[of] -= self.own[of] @ np.linalg.solve(known, out[of].sum(axis=0))
        return np.asarray(out, np.float64)

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum(self.residual * self.weigh(self.residual[:, :, None])[:, :, 0]))


def mark_terms(
    marks: Marks, state: BundleState, cameras: list[Camera], lens_of: IntArray, ground: HeightField
) -> MarkTerms:
    """Return the terms of all marks at a state; the ground says how high they lie, and how unsure that is."""
    view = marks.view
    lens = lens_of[view]
    n, by_f, k1 = np.empty((len(view), 2)), np.empty((len(view), 2)), np.empty((len(view), 2))
    for k, camera in enumerate(cameras):
        of = lens == k
        m = (marks.xy_px[of] - camera.principal_xy_px) / float(camera.focal_px or 1.0)
        n[of] = camera.undistort(m)
        by_f[of] = -m
    by_m, k1 = of_undistorting(cameras, lens, n)
    R = state.R[view]
    ray = np.einsum("kij,kj->ki", R[:, :, :2], n) + R[:, :, 2]
    down = np.maximum(ray[:, 2], LEAST_DOWN)
    z = -ground.at(marks.xy_map)
    reach = (z - state.centre[view, 2]) / down
    seen = state.centre[view] + reach[:, None] * ray
    level = np.broadcast_to(np.eye(3), (len(view), 3, 3)).copy()
    level[:, :, 2] -= ray / down[:, None]
    level = level[:, :2]
    by_ray = level * reach[:, None, None]
    by_view = np.concatenate([level, -by_ray @ cross_matrix(ray)], axis=2)
    by_n = by_ray @ R[:, :, :2] @ by_m
    by_lens = np.stack([np.einsum("kij,kj->ki", by_n, by_f), -np.einsum("kij,kj->ki", by_n, k1)], axis=2)
    lean = ray[:, :2] / down[:, None] * ground.sigma
    own = np.asarray(np.linalg.inv(marks.covariance + lean[:, :, None] * lean[:, None, :]), np.float64)
    place = np.asarray(np.linalg.inv(marks.place), np.float64)
    return MarkTerms(seen[:, :2] - marks.xy_map, by_view, by_lens, own, marks.group, place)
