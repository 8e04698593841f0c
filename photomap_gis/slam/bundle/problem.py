"""What the full solution computes on: views in space, tie points between them, and what is known beforehand.

World axes are the internal map frame's x (east) and y (south), and z **down**; the ground's middle level is z = 0, so a
camera at a height of 100 has z = -100. Everything is in map units (metres; pixels of the first frame without GPS).

A tie is a spot of frame b (its *anchor*) that was found in frame a. All ties of one spot of b share one unknown: the z
of the ground there. The ray of the anchor meets that level at the spot, which frame a must see where it did.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera
from photomap_gis.core.ground import HeightField
from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.bundle.fixes import FixNoise

IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera shared by frames, with prior sigmas of the logarithm of its focal length and of its first distortion."""

    camera: Camera
    focal_sigma_log: float = 0.03
    k1_sigma: float = 0.03

    @property
    def focal_px(self) -> float:
        """The focal length before looking."""
        if self.camera.focal_px is None:
            raise ValueError("a lens of the full solution needs a focal length")
        return self.camera.focal_px


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where a frame is taken to have been: ``centre`` ``(3,)`` and ``R_map_camera`` ``(3, 3)``, z down, and its lens.

    ``R_prior`` is what was reported or is usual of the camera's turn; ``tilt_sigma_rad`` and ``heading_sigma_rad`` say
    how sure that is (infinite: nothing is known). ``height_sigma`` is that of the centre's z, ``nan`` where no height
    was reported.
    """

    frame: int
    lens: int
    centre: FloatArray
    R_map_camera: FloatArray
    R_prior: FloatArray
    tilt_sigma_rad: float
    heading_sigma_rad: float = np.inf
    height: float = np.nan
    height_sigma: float = np.nan


@dataclass(frozen=True, eq=False)
class TieSet:
    """M ties: frames' places in the list of views ``a``, ``b`` ``(M,)``; ``xy_a_px``, ``xy_b_px`` ``(M, 2)`` raster
    pixels; ``covariance`` ``(M, 2, 2)`` of the error in a; ``spot`` ``(M,)`` the number of the anchor's spot.

    Ties of one pair lie together, and so do those of one anchor frame b.
    """

    a: IntArray
    b: IntArray
    xy_a_px: FloatArray
    xy_b_px: FloatArray
    covariance: FloatArray
    spot: IntArray

    def __len__(self) -> int:
        return len(self.a)

    @cached_property
    def information(self) -> FloatArray:
        """``(M, 2, 2)`` inverses of the covariances."""
        return np.asarray(np.linalg.inv(self.covariance), np.float64)

    @property
    def spots(self) -> int:
        """The number of spots."""
        return int(self.spot.max()) + 1 if len(self.spot) else 0


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """K known points of the ground: the ``view`` ``(K,)`` that shows each at ``xy_px`` ``(K, 2)``, where it lies on the
    map ``xy_map`` ``(K, 2)``, and the ``covariance`` ``(K, 2, 2)`` of what each has for itself.

    Some share an error of their place besides, sightings of one point: ``group`` ``(K,)`` says which of the ``place``
    ``(G, 2, 2)`` covariances, -1 none.
    """

    view: IntArray
    xy_px: FloatArray
    xy_map: FloatArray
    covariance: FloatArray
    group: IntArray
    place: FloatArray

    @classmethod
    def none(cls) -> Marks:
        """Return no marks."""
        nobody, nothing = np.zeros(0, np.intp), np.zeros((0, 2))
        return cls(nobody, nothing, nothing, np.zeros((0, 2, 2)), nobody, np.zeros((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.view)


@dataclass(frozen=True, slots=True, eq=False)
class BundleProblem:
    """Views, lenses, ties, and fixes: ``fix_of`` ``(F,)`` views that have one, ``fix_xy`` ``(F, 2)`` where they say the
    camera was, and ``fix_noise`` how wrong they are: neighbours in time share their error.

    ``terrain`` is the ground's shape where it is known beforehand; its level is not used.
    ``held`` ``(G,)`` are views that are held where they start: one for each piece that no fix ties to the Earth.
    """

    views: tuple[View, ...]
    lenses: tuple[Lens, ...]
    ties: TieSet
    fix_of: IntArray
    fix_xy: FloatArray
    fix_noise: FixNoise
    held: IntArray
    marks: Marks = field(default_factory=Marks.none)
    terrain: HeightField | None = None

    @property
    def lens_of(self) -> IntArray:
        """``(N,)`` each view's lens."""
        return np.array([v.lens for v in self.views], np.intp)


@dataclass(frozen=True, slots=True, eq=False)
class BundleState:
    """A value for every unknown: ``centre`` ``(N, 3)``, ``R`` ``(N, 3, 3)``, ``log_focal``, ``k1`` ``(L,)``, ``z`` of
    the spots ``(P,)``."""

    centre: FloatArray
    R: FloatArray
    log_focal: FloatArray
    k1: FloatArray
    z: FloatArray

    @classmethod
    def start(cls, problem: BundleProblem) -> BundleState:
        """Return the state before looking, over level ground."""
        return cls(
            np.array([v.centre for v in problem.views]).reshape(-1, 3),
            np.array([v.R_map_camera for v in problem.views]).reshape(-1, 3, 3),
            np.log([lens.focal_px for lens in problem.lenses]),
            np.array([lens.camera.k1 for lens in problem.lenses]),
            np.zeros(problem.ties.spots),
        )

    def moved(self, step: FloatArray, spots: FloatArray) -> BundleState:
        """Return the state after a step ``(6 N + 2 L, ...)`` of views and lenses and one of the spots ``(P,)``."""
        n, lenses = len(self.centre), len(self.k1)
        view, lens = step[: 6 * n].reshape(n, 6), step[6 * n : 6 * n + 2 * lenses].reshape(lenses, 2)
        return BundleState(
            self.centre + view[:, :3],
            exp_rotation(view[:, 3:]) @ self.R,
            self.log_focal + lens[:, 0],
            self.k1 + lens[:, 1],
            self.z + spots,
        )


def exp_rotation(turn: FloatArray) -> FloatArray:
    """``(N, 3, 3)`` rotations by ``(N, 3)`` turn vectors."""
    angle = np.linalg.norm(turn, axis=1)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    s, c = np.where(small, 1.0, np.sin(angle) / safe), np.where(small, 0.5, (1.0 - np.cos(angle)) / safe**2)
    k = cross_matrix(turn)
    return np.asarray(np.eye(3) + s[:, None, None] * k + c[:, None, None] * (k @ k), np.float64)


def log_rotation(R: FloatArray) -> FloatArray:
    """``(N, 3)`` turn vectors of ``(N, 3, 3)`` rotations by less than half a turn."""
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine2 = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine2, np.trace(R, axis1=1, axis2=2) - 1.0)
    factor = np.where(sine2 < 1e-9, 0.5, angle / np.where(sine2 < 1e-9, 1.0, sine2))
    return np.asarray(axis * factor[:, None], np.float64)


def cross_matrix(v: FloatArray) -> FloatArray:
    """``(N, 3, 3)`` matrices of the cross product with ``(N, 3)`` vectors."""
    k = np.zeros((len(v), 3, 3))
    k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return k - k.transpose(0, 2, 1)
