"""Similarities of the plane: the 4-DoF motion of a down-looking camera over flat ground.

``T_a_b`` maps points of b into a: ``p_a = s R(theta) p_b + t`` (the paper's composition, section 2.1). Axes are
image-handed: x to the right (east), y **down** (south); a positive angle turns x towards y, clockwise to the eye.

A perturbation ``xi = (x, y, theta, log s)`` (order: ``DOF``) acts on the right, in the axes and units of b:
``T_true = T @ Similarity2D.exp(xi)``. This is gtsam's convention for ``Similarity2``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

DOF = ("x", "y", "theta", "log_s")
"""The one order of the four degrees of freedom, in every covariance and tangent vector."""


@dataclass(frozen=True, slots=True)
class Similarity2D:
    """A similarity of the plane; translation in units of the target frame, angle in radians, log of the scale."""

    tx: float = 0.0
    ty: float = 0.0
    angle_rad: float = 0.0
    log_scale: float = 0.0

    @classmethod
    def identity(cls) -> Similarity2D:
        """Return the similarity that moves nothing."""
        return cls()

    @classmethod
    def translation_of(cls, tx: float, ty: float) -> Similarity2D:
        """Return a pure translation."""
        return cls(float(tx), float(ty))

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Similarity2D:
        """Return the similarity of a ``(3, 3)`` or ``(2, 3)`` matrix ``[sR t]``; ``ValueError`` for any other map."""
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape not in ((3, 3), (2, 3)):
            raise ValueError(f"matrix must be (3, 3) or (2, 3), got {m.shape}")
        a, b = m[0, 0], m[1, 0]
        scale = math.hypot(a, b)
        if not scale > 0 or not np.allclose([m[0, 1], m[1, 1]], [-b, a], atol=1e-6 * scale):
            raise ValueError("matrix must be a similarity of positive scale (image-handed, no mirror, no shear)")
        return cls(float(m[0, 2]), float(m[1, 2]), math.atan2(b, a), math.log(scale))

    @property
    def scale(self) -> float:
        """The factor by which lengths grow from b to a."""
        return math.exp(self.log_scale)

    @property
    def translation(self) -> FloatArray:
        """``(2,)`` where b's origin lies in a."""
        return np.array([self.tx, self.ty])

    @property
    def linear(self) -> FloatArray:
        """``(2, 2)`` matrix ``s R``."""
        c, s = math.cos(self.angle_rad) * self.scale, math.sin(self.angle_rad) * self.scale
        return np.array([[c, -s], [s, c]])

    @property
    def matrix(self) -> FloatArray:
        """``(3, 3)`` homogeneous matrix ``[sR t; 0 1]``."""
        m = np.eye(3)
        m[:2, :2] = self.linear
        m[0, 2], m[1, 2] = self.tx, self.ty
        return m

    def apply(self, points: npt.ArrayLike) -> FloatArray:
        """Map ``(..., 2)`` points (x, y) of b into a."""
        p = np.asarray(points, dtype=np.float64)
        c, s = math.cos(self.angle_rad) * self.scale, math.sin(self.angle_rad) * self.scale
        x, y = p[..., 0], p[..., 1]
        return np.stack([c * x - s * y + self.tx, s * x + c * y + self.ty], axis=-1)

    def __matmul__(self, other: Similarity2D) -> Similarity2D:
        """``T_a_c = T_a_b @ T_b_c`` (the paper's composition)."""
        scale = self.scale
        c, s = math.cos(self.angle_rad) * scale, math.sin(self.angle_rad) * scale
        return Similarity2D(
            c * other.tx - s * other.ty + self.tx,
            s * other.tx + c * other.ty + self.ty,
            wrap_angle(self.angle_rad + other.angle_rad),
            self.log_scale + other.log_scale,
        )

    def inverse(self) -> Similarity2D:
        """Return ``T_b_a``."""
        inv_scale = math.exp(-self.log_scale)
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return Similarity2D(
            -inv_scale * (c * self.tx + s * self.ty),
            -inv_scale * (-s * self.tx + c * self.ty),
            wrap_angle(-self.angle_rad),
            -self.log_scale,
        )

    def about(self, x: float, y: float) -> Similarity2D:
        """Return the same motion with the origins of both frames moved to the point (x, y)."""
        shift = Similarity2D.translation_of(x, y)
        return shift.inverse() @ self @ shift

    def log(self) -> FloatArray:
        """``(4,)`` tangent ``xi`` with ``Similarity2D.exp(xi) == self`` (angle within ±pi)."""
        theta, lam = wrap_angle(self.angle_rad), self.log_scale
        u = np.linalg.solve(_left_jacobian(theta, lam), self.translation)
        return np.array([u[0], u[1], theta, lam])

    @classmethod
    def exp(cls, xi: npt.ArrayLike) -> Similarity2D:
        """Return the similarity of a ``(4,)`` tangent vector in the order ``DOF``."""
        x, y, theta, lam = (float(v) for v in np.asarray(xi, dtype=np.float64))
        t = _left_jacobian(theta, lam) @ np.array([x, y])
        return cls(float(t[0]), float(t[1]), wrap_angle(theta), lam)

    def adjoint(self) -> FloatArray:
        """``(4, 4)`` matrix Ad with ``T @ exp(xi) @ T^-1 == exp(Ad @ xi)``: carries a covariance from b to a."""
        ad = np.eye(4)
        ad[:2, :2] = self.linear
        # turning or growing about b's origin moves a's origin: columns of theta and log s
        ad[0, 2], ad[1, 2] = self.ty, -self.tx
        ad[0, 3], ad[1, 3] = -self.tx, -self.ty
        return ad


def wrap_angle(angle_rad: float) -> float:
    """Return the angle within [-pi, pi]."""
    return math.remainder(angle_rad, 2.0 * math.pi)


def _left_jacobian(theta: float, lam: float) -> FloatArray:
    """``V`` with ``t = V u``: the integral of ``exp(r (lam I + theta J))`` over r in [0, 1]: (e^z - 1) / z."""
    z = complex(lam, theta)
    v = 1.0 + z / 2.0 + z * z / 6.0 + z**3 / 24.0 if abs(z) < 1e-4 else (np.exp(z) - 1.0) / z
    return np.array([[v.real, -v.imag], [v.imag, v.real]])


def transform_jacobian(T_a_b: Similarity2D, points_b: npt.ArrayLike) -> FloatArray:
    """``(N, 2, 4)`` derivative of ``(T_a_b @ exp(xi)).apply(p)`` by xi at 0, for ``(N, 2)`` points of b."""
    p = np.atleast_2d(np.asarray(points_b, dtype=np.float64))
    inner = np.zeros((len(p), 2, 4))
    inner[:, 0, 0] = inner[:, 1, 1] = 1.0
    inner[:, 0, 2], inner[:, 1, 2] = -p[:, 1], p[:, 0]
    inner[:, :, 3] = p
    return np.einsum("ij,njk->nik", T_a_b.linear, inner)


def fit_similarity(
    points_a: npt.ArrayLike, points_b: npt.ArrayLike, weights: npt.ArrayLike | None = None
) -> Similarity2D:
    """Return the least-squares ``T_a_b`` of ``(N, 2)`` point pairs, N >= 2, optional ``(N,)`` weights.

    Raises ``ValueError`` where b's points coincide (angle and scale would be arbitrary).
    """
    a, b = np.asarray(points_a, dtype=np.float64), np.asarray(points_b, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 2 or len(a) < 2:
        raise ValueError(f"points must be two (N, 2) arrays with N >= 2, got {a.shape} and {b.shape}")
    w = np.full(len(a), 1.0 / len(a)) if weights is None else np.asarray(weights, dtype=np.float64)
    if weights is not None:
        w = w / w.sum()
    za, zb = (np.ascontiguousarray(p).view(np.complex128).ravel() for p in (a, b))
    mean_a, mean_b = complex(w @ za), complex(w @ zb)
    # Lengths are of the order of the points' own size: what is lost to rounding below it is no spread.
    size2 = float(np.vdot(w * zb, zb).real)
    zb = zb - mean_b
    weighted = w * zb
    spread = float(np.vdot(weighted, zb).real)
    if spread <= 1e-18 * (1.0 + size2):
        raise ValueError("points of b coincide: a similarity cannot be fitted")
    z = complex(np.vdot(weighted, za - mean_a)) / spread
    if abs(z) == 0:
        raise ValueError("points of a coincide: a similarity cannot be fitted")
    t = mean_a - z * mean_b
    return Similarity2D(t.real, t.imag, math.atan2(z.imag, z.real), math.log(abs(z)))
