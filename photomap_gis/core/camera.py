"""The pinhole camera with radial distortion, and the virtual camera that looks straight down.

*Pixel* coordinates are those of the stored raster, (0, 0) the centre of the top-left pixel. *Plane* coordinates are
those of a virtual camera at the same place that looks straight down without distortion: pixels of the same focal
length, origin at the plumb point below the camera, x to the image's right, y down. Over flat ground a plane is a
scaled and turned picture of the ground, so registrations, poses and GPS live in planes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray


@lru_cache(maxsize=1024)
def _fold_radius(k1: float, k2: float, k3: float) -> float:
    slope = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # in the squared radius
    real = slope[(np.abs(slope.imag) < 1e-9) & (slope.real > 0.0)].real
    return math.sqrt(float(real.min())) if len(real) else math.inf


@dataclass(frozen=True, slots=True)
class Camera:
    """A lens and sensor: focal length and principal point in pixels of the stored raster, Brown's radial k1, k2, k3.

    ``focal_px`` is ``None`` where nothing is known of the lens. ``origin`` says where the focal length comes from
    ("exif", "profile", "option", ...); ``focal_sigma_rel`` is its relative one-sigma.
    """

    width_px: int
    height_px: int
    focal_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    name: str = ""
    origin: str = "unknown"
    focal_sigma_rel: float = 0.03
    k3: float = 0.0

    @classmethod
    def of_hfov(
        cls, width_px: int, height_px: int, hfov_rad: float, *, name: str = "", origin: str = "option"
    ) -> Camera:
        """Return an ideal camera of the given horizontal field of view."""
        if not 0.0 < hfov_rad < math.pi:
            raise ValueError(f"hfov_rad must lie in (0, pi), got {hfov_rad}")
        return cls(width_px, height_px, width_px / 2.0 / math.tan(hfov_rad / 2.0), name=name, origin=origin)

    @property
    def principal_xy_px(self) -> FloatArray:
        """``(2,)`` principal point; the raster's centre where none is known."""
        cx = (self.width_px - 1) / 2.0 if self.cx_px is None else self.cx_px
        cy = (self.height_px - 1) / 2.0 if self.cy_px is None else self.cy_px
        return np.array([cx, cy])

    @property
    def hfov_rad(self) -> float | None:
        """Horizontal field of view, ``None`` where the focal length is unknown."""
        return None if self.focal_px is None else 2.0 * math.atan(self.width_px / 2.0 / self.focal_px)

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines bend."""
        return self.k1 != 0.0 or self.k2 != 0.0 or self.k3 != 0.0

    @property
    def fold_radius(self) -> float:
        """The ideal radius (focal length 1) at which the polynomial turns back on itself, infinite where it never does.

        Nothing beyond it is seen by the camera, whatever ``distort`` says.
        """
        return _fold_radius(self.k1, self.k2, self.k3)

    def distort(self, normalised: npt.ArrayLike) -> FloatArray:
        """Apply radial distortion to ``(N, 2)`` ideal image coordinates (focal length 1)."""
        n = np.asarray(normalised, dtype=np.float64)
        r2 = np.sum(n * n, axis=-1, keepdims=True)
        return n * (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3)))

    def picture_of(self, n_x: FloatArray, n_y: FloatArray) -> FloatArray:
        """``(..., 2)`` pixels of ideal image coordinates (focal length 1, which must be known); NaN beyond the fold."""
        if self.focal_px is None:
            raise ValueError("a camera without a focal length has no place in space")
        c_x, c_y = self.principal_xy_px
        out = np.empty((*n_x.shape, 2))
        if not self.is_distorted:
            out[..., 0], out[..., 1] = self.focal_px * n_x + c_x, self.focal_px * n_y + c_y
            return out
        r2 = n_x * n_x + n_y * n_y
        factor = self.focal_px * (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3)))
        fold = self.fold_radius
        if not (fold == math.inf or r2.max(initial=0.0) < fold**2):  # also where some are NaN
            with np.errstate(invalid="ignore"):
                factor = np.where(r2 < fold**2, factor, np.nan)
        out[..., 0], out[..., 1] = factor * n_x + c_x, factor * n_y + c_y
        return out

    def undistort(self, distorted: npt.ArrayLike) -> FloatArray:
        """Invert ``distort`` by Newton's method on the radius."""
        d = np.asarray(distorted, dtype=np.float64)
        if not self.is_distorted:
            return d
        rd = np.linalg.norm(d, axis=-1, keepdims=True)
        r = rd.copy()
        for _ in range(12):
            r2 = r * r
            slope = np.maximum(1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + 7.0 * r2 * self.k3)), 0.2)
            r = r - (r * (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))) - rd) / slope
        return d * np.divide(r, rd, out=np.ones_like(r), where=rd > 0)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneView:
    """The two-way road between a frame's pixels and its plane (see the module's words).

    ``R_level_camera`` is ``(3, 3)``; the identity where the attitude is unknown: then the plane's origin is the
    principal point. Where the focal length is unknown the plane is the raster itself, its origin moved to the centre.
    ``ground_slope`` is the rise of the ground per unit along the plane's x and y: on an even slope the plane is still
    a scaled and turned picture of the ground, seen from above.
    """

    camera: Camera
    R_level_camera: FloatArray
    ground_slope: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        r = np.array(self.R_level_camera, dtype=np.float64)
        if r.shape != (3, 3):
            raise ValueError(f"R_level_camera must be (3, 3), got {r.shape}")
        if self.camera.focal_px is None and not (np.array_equal(r, np.eye(3)) and self.ground_slope == (0.0, 0.0)):
            raise ValueError("a camera without a focal length cannot be levelled")
        r.setflags(write=False)
        object.__setattr__(self, "R_level_camera", r)

    @classmethod
    def flat(cls, camera: Camera) -> PlaneView:
        """Return the view of a camera that is taken to look straight down."""
        return cls(camera, np.eye(3))

    @property
    def is_rigid(self) -> bool:
        """Whether pixels and plane differ by a shift only (no tilt, no slope, no distortion)."""
        return (
            self.ground_slope == (0.0, 0.0)
            and bool(np.array_equal(self.R_level_camera, np.eye(3)))
            and (self.camera.focal_px is None or not self.camera.is_distorted)
        )

    @property
    def _plane_from_camera(self) -> FloatArray:
        """``(3, 3)`` takes rays of the camera to homogeneous points of the plane: levels, then divides by the depth.

        Ground that rises by the slope is nearer: a levelled ray (x, y, 1) meets it at 1 / (1 + slope . (x, y)) of the
        height.
        """
        m = self.R_level_camera.copy()
        m[2] += self.ground_slope[0] * m[0] + self.ground_slope[1] * m[1]
        return m

    def to_plane(self, xy_px: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` pixels to the plane; NaN for rays at or above the horizon."""
        p = np.asarray(xy_px, dtype=np.float64) - self.camera.principal_xy_px
        f = self.camera.focal_px
        if f is None or self.is_rigid:
            return p
        n = self.camera.undistort(p / f)
        rays = np.concatenate([n, np.ones((*n.shape[:-1], 1))], axis=-1) @ self._plane_from_camera.T
        depth = np.where(rays[..., 2:] > 1e-6, rays[..., 2:], np.nan)
        return f * rays[..., :2] / depth

    def to_pixel(self, xy_plane: npt.ArrayLike) -> FloatArray:
        """Map ``(N, 2)`` points of the plane to pixels; NaN for points behind the camera or beyond the lens's fold."""
        q = np.asarray(xy_plane, dtype=np.float64)
        f = self.camera.focal_px
        if f is None or self.is_rigid:
            return q + self.camera.principal_xy_px
        (a, b, c), (d, e, g), (h, i, j) = _inverse(self._plane_from_camera)
        x, y = q[..., 0] / f, q[..., 1] / f  # an array each: numpy is several times as fast with them
        depth = h * x + i * y + j
        behind = depth <= 1e-6
        if behind.any():
            depth = np.where(behind, np.nan, depth)
        return self.camera.picture_of((a * x + b * y + c) / depth, (d * x + e * y + g) / depth)


def _inverse(matrix: FloatArray) -> tuple[tuple[float, float, float], ...]:
    """Return the inverse of a ``(3, 3)`` matrix by its adjugate: ten times as fast as LAPACK is called."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    k = 1.0 / (a * A + b * B + c * C)
    return (
        (A * k, (c * h - b * i) * k, (b * f - c * e) * k),
        (B * k, (a * i - c * g) * k, (c * d - a * f) * k),
        (C * k, (b * g - a * h) * k, (a * e - b * d) * k),
    )
