"""The full solution laid where the flat one has its ties to existing imagery.

The full solution knows cameras, lens and ground, but of the Earth only the GPS. The flat one knows the imagery too. So
the cameras in space, and the ground below, are moved together by the similarity that brings the ties to where the flat
solution has them: its shape is kept, its place, heading and scale are the imagery's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photomap_gis.core.placement import FramePlacement, PosedPlacement
from photomap_gis.core.posegraph import PointObservation, Trajectory
from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity
from photomap_gis.georef import predicted_ce90_m
from photomap_gis.pipeline.control import moved
from photomap_gis.pipeline.solve import Solved

FEWEST_FRAMES = 3
"""Frames with ties that a piece must have to be moved by them."""
LIMIT = 3.0
"""Ties that miss by more than so many times the median do not tell where the whole lies."""
STEP_M, STEP_RAD = 1e-3, 1e-6


def laid_on_ties(posed: Solved, flat: Solved, ties: Sequence[PointObservation]) -> Solved | None:
    """Return a solution in space moved to where a flat one has the ties; ``None`` where some piece has too few.

    What the flat solution says of the uncertainty of each frame's middle, the imagery's constant error in it, holds.
    """
    where = {p.frame: p for p in flat.trajectory.placements}
    placements: list[FramePlacement] = []
    for segment in sorted({p.segment for p in posed.trajectory.placements}):
        piece = posed.trajectory.segment(segment)
        if any(isinstance(p.camera_to_map, PosedPlacement) for p in piece.placements):
            motion = _motion(piece, where, ties)
            if motion is None:
                return None
            piece = moved(piece, motion)
        placements += [_as_sure_as(p, where[p.frame]) for p in piece.placements]
    order = {p.frame: k for k, p in enumerate(posed.trajectory.placements)}
    placements.sort(key=lambda p: order[p.frame])
    trajectory = Trajectory(tuple(placements), posed.trajectory.revision)
    return replace(posed, trajectory=trajectory, predicted_ce90_m=predicted_ce90_m(trajectory))


def _motion(
    piece: Trajectory, flat: dict[int, FramePlacement], ties: Sequence[PointObservation]
) -> Similarity2D | None:
    """Return the similarity of the map that brings a piece's ties to where the flat solution has them."""
    placed = {p.frame: p for p in piece.placements}
    pairs = [
        (placed[t.frame].camera_to_map.project(t.xy_px[None])[0], flat[t.frame].camera_to_map.project(t.xy_px[None])[0])
        for t in ties
        if t.frame in placed
    ]
    if len({t.frame for t in ties if t.frame in placed}) < FEWEST_FRAMES:
        return None
    here, there = (np.array([pair[k] for pair in pairs]) for k in range(2))
    kept = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
    for _ in range(4):
        if kept.sum() < 2 * FEWEST_FRAMES:
            return None
        T = fit_similarity(there[kept], here[kept])
        miss = np.hypot(*(T.apply(here) - there).T)
        kept = miss <= LIMIT * max(float(np.nanmedian(miss)), 1e-6)
    return T


def _as_sure_as(p: FramePlacement, flat: FramePlacement) -> FramePlacement:
    """Return a camera in space whose middle is as sure on the map as the flat solution says; turns and height stay."""
    posed = p.camera_to_map
    if not isinstance(posed, PosedPlacement):
        return replace(p, pose_covariance=flat.pose_covariance)
    # In terms of where the middle lies (instead of the camera) place and turn are told apart: there the place's part
    # is stretched to the flat solution's, which keeps the whole a covariance.
    to_middle = np.eye(6)
    to_middle[:2] = _middle_jacobian(p, posed)
    covariance = to_middle @ p.pose_covariance @ to_middle.T
    stretch = np.eye(6)
    stretch[:2, :2] = _root(flat.position_covariance_m2()[0]) @ np.linalg.inv(_root(covariance[:2, :2]))
    back = np.linalg.inv(to_middle) @ stretch
    return replace(p, pose_covariance=back @ covariance @ back.T)


def _middle_jacobian(p: FramePlacement, posed: PosedPlacement) -> FloatArray:
    """``(2, 6)`` derivative of where the raster's middle lies by the camera's place (z down) and turn."""
    columns = []
    for k in range(6):
        ends = []
        for sign in (1.0, -1.0):
            centre, turn = posed.centre_map.copy(), np.zeros(3)
            if k < 3:
                centre[k] += sign * STEP_M * (-1.0 if k == 2 else 1.0)
            else:
                turn[k - 3] = sign * STEP_RAD
            R = (np.eye(3) + np.cross(np.eye(3), turn)) @ posed.R_map_camera  # Exp of so small a turn
            ends.append(PosedPlacement(posed.camera, centre, R, posed.ground).project(p.centre_xy_px)[0])
        columns.append((ends[0] - ends[1]) / (2.0 * (STEP_M if k < 3 else STEP_RAD)))
    return np.stack(columns, axis=1)


def _root(covariance: FloatArray) -> FloatArray:
    """``(2, 2)`` symmetric root of a covariance, held above nothing at all."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2.0)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 1e-8))) @ vectors.T, np.float64)
