"""The builder of the pose graph: registrations and observations in, frozen snapshots out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import (
    Edge,
    EdgeKind,
    HeadingObservation,
    PointObservation,
    PoseGraph,
    PositionObservation,
    ScaleObservation,
)
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.slam.slope import SlopedMotion, fit_slope
from photomap_gis.slam.tilt import NOISE_PX, Bend, Leaning

OVERLAP_SAMPLES = 9
MIN_SIGMA_PX = 0.02
MIN_SIGMA_RAD = 1e-5
"""No registration is trusted beyond this: a spectral peak's own sigma can be absurdly small."""


@dataclass(frozen=True, slots=True)
class Gate:
    """What a registration must show to become an edge; the robust solver judges what passes."""

    min_probability: float = 0.5
    max_scale_ratio: float = 4.0


class GraphBuilder:
    """Gathers frames, edges and observations; one owner; ``snapshot`` hands out a frozen ``PoseGraph``."""

    def __init__(self, gate: Gate | None = None) -> None:
        self._gate = gate or Gate()
        self._frames: dict[int, None] = {}
        self._edges: dict[tuple[int, int], Edge] = {}
        self._positions: dict[int, PositionObservation] = {}
        self._scales: dict[int, ScaleObservation] = {}
        self._headings: dict[int, HeadingObservation] = {}
        self._points: list[PointObservation] = []
        self._revision = 0

    @property
    def pairs(self) -> frozenset[tuple[int, int]]:
        """The pairs (lower index first) that have an edge."""
        return frozenset(self._edges)

    def add_frame(self, index: int) -> None:
        """Make a frame known; a frame needs no edge to be placed by its fix."""
        self._frames[index] = None

    def add_registration(
        self,
        reg: Registration,
        T_planea_worka: Similarity2D,
        T_planeb_workb: Similarity2D,
        kind: EdgeKind = EdgeKind.SEQUENTIAL,
        *,
        leaning: tuple[Leaning, Leaning] | None = None,
    ) -> bool:
        """Add what a registration measured between the planes of its frames; return whether it passed the gate.

        ``T_plane*_work*`` map the pixels of the images that were registered into their frames' planes. A pair that is
        added twice keeps the more certain measurement. ``leaning`` says of both frames how their planes must be
        levelled still: the edge then is between level planes, and the slope of the shared ground is told apart.
        """
        if reg.a < 0 or reg.b < 0 or reg.a == reg.b:
            raise ValueError(f"a registration must name two frames to become an edge, got a={reg.a}, b={reg.b}")
        edge = edge_of(reg, T_planea_worka, T_planeb_workb, kind, leaning)
        if not (reg.accepted and reg.probability >= self._gate.min_probability and self._is_sane(edge)):
            return False
        self.add_frame(reg.a)
        self.add_frame(reg.b)
        pair = (min(reg.a, reg.b), max(reg.a, reg.b))
        known = self._edges.get(pair)
        if known is None or np.trace(edge.covariance[:2, :2]) < np.trace(known.covariance[:2, :2]):
            self._edges[pair] = edge
        return True

    def add_edge(self, edge: Edge) -> None:
        """Add an edge as it is (from a stored graph)."""
        self.add_frame(edge.a)
        self.add_frame(edge.b)
        self._edges[min(edge.a, edge.b), max(edge.a, edge.b)] = edge

    def observe(
        self,
        positions: Iterable[PositionObservation] = (),
        scales: Iterable[ScaleObservation] = (),
        headings: Iterable[HeadingObservation] = (),
    ) -> None:
        """Add observations of single frames; a later one of the same frame replaces the earlier."""
        self._positions.update((p.frame, p) for p in positions)
        self._scales.update((s.frame, s) for s in scales)
        self._headings.update((h.frame, h) for h in headings)

    def observe_points(self, points: Iterable[PointObservation]) -> None:
        """Add known points of the ground; a frame may see many of them, and a point be seen by many frames."""
        self._points.extend(points)

    def snapshot(self) -> PoseGraph:
        """Return all that is known now, under a new revision number."""
        self._revision += 1
        for observed in (self._positions, self._scales, self._headings):
            for frame in observed:
                self._frames.setdefault(frame)
        return PoseGraph(
            tuple(sorted(self._frames)),
            tuple(self._edges[pair] for pair in sorted(self._edges)),
            tuple(self._positions[f] for f in sorted(self._positions)),
            tuple(self._scales[f] for f in sorted(self._scales)),
            tuple(self._headings[f] for f in sorted(self._headings)),
            self._revision,
            tuple(self._points),
        )

    def _is_sane(self, edge: Edge) -> bool:
        t = edge.T_a_b
        finite = np.isfinite([t.tx, t.ty, t.angle_rad, t.log_scale, *np.ravel(edge.covariance)]).all()
        return bool(finite) and abs(t.log_scale) <= np.log(self._gate.max_scale_ratio)


def edge_of(
    reg: Registration,
    T_planea_worka: Similarity2D,
    T_planeb_workb: Similarity2D,
    kind: EdgeKind,
    leaning: tuple[Leaning, Leaning] | None = None,
) -> Edge:
    """Return the edge between planes that a registration of images stands for, with its whole covariance."""
    if leaning is not None:
        sloped = _sloped_edge(reg, T_planea_worka, T_planeb_workb, kind, leaning)
        if sloped is not None:
            return sloped
    floor = np.diag([MIN_SIGMA_PX, MIN_SIGMA_PX, MIN_SIGMA_RAD, MIN_SIGMA_RAD]) ** 2
    whole = replace(reg, covariance=reg.covariance + model_covariance(reg) + floor)
    T, covariance = whole.seen_from(T_planea_worka, T_planeb_workb)
    return Edge(reg.a, reg.b, T, (covariance + covariance.T) / 2.0, kind, reg.probability, reg.overlap, reg.method)


def model_covariance(reg: Registration) -> FloatArray:
    """``(4, 4)`` covariance of what tilt and relief do to a registration, about the image centre of b in its pixels.

    The misfit (RMS ``model_sigma_px`` per axis) varies as slowly as the overlap is large, so it does not average out:
    the fit is off by the misfit at the overlap's centre, by the misfit over the overlap's RMS radius in angle and in
    log scale, and by what that lever arm makes of it at the image's centre.
    """
    m = reg.model_sigma_px
    if not m > 0.0:
        return np.zeros((4, 4))
    centre, radius = _overlap_of(reg)
    about_overlap = np.diag([m, m, m / radius, m / radius]) ** 2
    to_centre = Similarity2D.translation_of(*centre).adjoint()
    return to_centre @ about_overlap @ to_centre.T


def sloped_motion(
    reg: Registration, T_planea_worka: Similarity2D, T_planeb_workb: Similarity2D, leaning: tuple[Leaning, Leaning]
) -> SlopedMotion | None:
    """Return what a registration says of level planes over sloping ground; ``None`` where it cannot tell."""
    bend = bend_of(reg, T_planea_worka, T_planeb_workb, (leaning[0].focal_px, leaning[1].focal_px))
    if bend is None:
        return None
    a, b = leaning[0].level(bend.points_a), leaning[1].level(bend.points_b)
    noise_px = T_planea_worka.scale * max(reg.model_sigma_px, MIN_SIGMA_PX)
    return fit_slope(a, b, bend.focal_a_px, bend.focal_b_px, noise_px=noise_px)


def bend_of(
    reg: Registration, T_planea_worka: Similarity2D, T_planeb_workb: Similarity2D, focal_px: tuple[float, float]
) -> Bend | None:
    """Return the points that a registration's homography makes equal, in both planes; ``None`` where it has none."""
    if reg.H_a_b is None:
        return None
    b = _shared_points(reg)
    in_a = np.concatenate([b, np.ones((len(b), 1))], axis=1) @ reg.H_a_b.T
    if (in_a[:, 2] <= 0.0).any():
        return None
    scale = T_planea_worka.scale
    points_a, points_b = T_planea_worka.apply(in_a[:, :2] / in_a[:, 2:]), T_planeb_workb.apply(b)
    return Bend(reg.a, reg.b, points_a, points_b, *focal_px, NOISE_PX * scale)


def _sloped_edge(
    reg: Registration,
    T_planea_worka: Similarity2D,
    T_planeb_workb: Similarity2D,
    kind: EdgeKind,
    leaning: tuple[Leaning, Leaning],
) -> Edge | None:
    """Return the edge between planes that know the ground's slope; ``None`` where the pair does not tell it."""
    motion = sloped_motion(reg, T_planea_worka, T_planeb_workb, leaning)
    if motion is None:
        return None
    scale = T_planea_worka.scale
    # The bend that the slope explains is no misfit any more; relief's scatter and what is left of the bend still are.
    unexplained2 = reg.model_sigma_px**2 - (motion.flat_px**2 - motion.left_px**2) / scale**2
    known = replace(reg, model_sigma_px=float(np.sqrt(max(unexplained2, (motion.left_px / scale) ** 2))))
    floor = np.diag([MIN_SIGMA_PX, MIN_SIGMA_PX, MIN_SIGMA_RAD, MIN_SIGMA_RAD]) ** 2
    whole = replace(known, covariance=reg.covariance + model_covariance(known) + floor)
    to_level = Similarity2D.translation_of(*leaning[1].level(np.zeros((1, 2)))[0])
    _, covariance = whole.seen_from(T_planea_worka, to_level @ T_planeb_workb)
    covariance = covariance * np.outer(motion.inflation, motion.inflation)
    slope = (float(motion.slope[0]), float(motion.slope[1]))
    return Edge(
        reg.a,
        reg.b,
        motion.T_a_b,
        (covariance + covariance.T) / 2.0,
        kind,
        reg.probability,
        reg.overlap,
        reg.method,
        slope,
    )


def _shared_points(reg: Registration) -> FloatArray:
    """``(N, 2)`` pixels of b, evenly over what a shows of it; image a is taken as large as b."""
    w, h = reg.size_b_px
    b = _even_points(w, h)
    a = reg.T_a_b.apply(b)
    inside = b[((a >= 0) & (a <= (w - 1, h - 1))).all(axis=1)]
    return b if len(inside) < 4 else inside


@lru_cache(maxsize=16)
def _even_points(width_px: int, height_px: int) -> FloatArray:
    """``(N, 2)`` pixels, evenly over a picture."""
    x, y = np.meshgrid(*(np.linspace(0, side - 1, OVERLAP_SAMPLES) for side in (width_px, height_px)))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points.setflags(write=False)
    return points


def _overlap_of(reg: Registration) -> tuple[FloatArray, float]:
    """``(2,)`` the overlap's centre seen from b's image centre, and its RMS radius."""
    w, h = reg.size_b_px
    inside = _shared_points(reg)
    centre = inside.mean(axis=0)
    radius = float(np.sqrt(np.mean(np.sum((inside - centre) ** 2, axis=1))))
    return centre - (np.array([w, h]) - 1) / 2.0, max(radius, 0.05 * max(w, h), 1.0)
