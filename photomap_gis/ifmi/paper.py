"""The paper's algorithms to the letter, to be read beside it and measured against: not what the product registers with.

H. Bülow, A. Birk et al., "Safety, Security, and Rescue Missions with an Unmanned Aerial Vehicle (UAV): Aerial
Mosaicking and Autonomous Flight at the 2009 European Land Robots Trials (ELROB) and the 2010 Response Robot Evaluation
Exercises (RREE)". Algorithm 1 is ``pomf``, Algorithm 2 ``register_literal`` with the three improvements of section 2.2
(restricted search, window and logarithm on the descriptor, FIR filter on the pulse), Algorithm 3 ``pulse_covariance``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.ifmi.kernels import Image32, sample, warp_similarity
from photomap_gis.ifmi.pomf import pomf

NEIGHBOURHOOD = 2
"""Algorithm 3's N, in cells."""
LARGEST_SCALE = 1.8
"""Section 2.2: scales beyond this, either way, are no candidates (and turns beyond 90 degrees cannot be told)."""


@dataclass(frozen=True, slots=True, eq=False)
class LiteralRegistration:
    """Algorithm 2's result ``T_a_b`` (pixels of b into a), Algorithm 3's covariances, and the pulses they come from.

    ``covariance_rot_scale`` is ``(2, 2)`` of (theta, log s), ``covariance_trans`` ``(2, 2)`` of (x, y) in a's pixels at
    the image's centre. Neither need be positive definite: see ``pulse_covariance``.
    """

    T_a_b: Similarity2D
    covariance_rot_scale: FloatArray
    covariance_trans: FloatArray
    delta_rot_scale: Image32
    delta_trans: Image32

    @property
    def covariance(self) -> FloatArray:
        """``(4, 4)`` block diagonal, of xi in ``T_true = T Exp(xi)`` about b's image centre (order ``DOF``)."""
        back = np.linalg.inv(self.T_a_b.linear)
        c = np.zeros((4, 4))
        c[:2, :2] = back @ self.covariance_trans @ back.T
        c[2:, 2:] = self.covariance_rot_scale
        return c


def register_literal(a: ImageArray, b: ImageArray, *, improved: bool = True) -> LiteralRegistration:
    """Return Algorithm 2's registration of two grey uint8 images of one even shape, with Algorithm 3's covariances.

    Without ``improved`` it is the bare Algorithm 2, without what section 2.2 adds.
    """
    if a.shape != b.shape or a.ndim != 2 or a.shape[0] % 2 or a.shape[1] % 2:
        raise ValueError(f"images must be grey and of one even shape, got {a.shape} and {b.shape}")
    A, B = a.astype(np.float32), b.astype(np.float32)
    h, w = A.shape
    # Calculate spectra; resample magnitudes into polar coordinates with logarithmic radius.
    P_A, P_B = log_polar(A, improved=improved), log_polar(B, improved=improved)
    # Apply POMF; find the Dirac peak within the parameter space of scaling and rotation.
    delta_rot_scale = pomf(P_A, P_B)
    if improved:
        delta_rot_scale = fir_filter(delta_rot_scale)
    angles, radii = P_A.shape
    step = math.log(min(h, w) / 2.0) / radii
    largest = math.log(LARGEST_SCALE) if improved else math.inf
    reasonable = np.abs(np.fft.fftfreq(radii) * radii * step) <= largest
    row, column = _argmax(np.where(reasonable[None, :], delta_rot_scale, -np.inf))
    theta = _signed(row, angles) * math.pi / angles
    log_gamma = -_signed(column, radii) * step  # what is larger in the image is smaller in its spectrum
    # Rotate and scale the second image into the reference frame, about the centre.
    T_turned_b = Similarity2D(0.0, 0.0, theta, log_gamma).about(-(w - 1) / 2.0, -(h - 1) / 2.0)
    B_turned = warp_similarity(B, T_turned_b, (h, w))
    # Apply POMF once more; find the Dirac peak within the parameter space of translation.
    delta_trans = pomf(A, B_turned)
    if improved:
        delta_trans = fir_filter(delta_trans)
    y, x = _argmax(delta_trans)
    # Algorithm 3, in cells; then in units.
    c_rot_scale = pulse_covariance(delta_rot_scale, row, column, NEIGHBOURHOOD)
    c_trans = pulse_covariance(delta_trans, y, x, NEIGHBOURHOOD)
    unit = np.diag([math.pi / angles, -step])
    return LiteralRegistration(
        T_a_b=Similarity2D.translation_of(_signed(x, w), _signed(y, h)) @ T_turned_b,
        covariance_rot_scale=unit @ c_rot_scale @ unit,
        covariance_trans=c_trans[::-1, ::-1].copy(),  # (row, column) to (x, y)
        delta_rot_scale=delta_rot_scale,
        delta_trans=delta_trans,
    )


def log_polar(A: Image32, *, improved: bool = True) -> Image32:
    """``LOGPOLAR(|FFT2D(A)|)``: ``(h, w)`` over angle (half a turn: the rest mirrors it) and logarithm of the radius.

    If ``improved``, with section 2.2's standard spectral window before the transform and logarithm after it.
    """
    h, w = A.shape
    if improved:
        A = A * cv2.createHanningWindow((w, h), cv2.CV_32F)
    magnitude = np.abs(np.fft.fftshift(np.fft.fft2(A))).astype(np.float32)
    if improved:
        magnitude = np.log1p(magnitude)
    angle = (np.arange(h) * (math.pi / h) - math.pi / 2.0)[:, None]
    radius = np.exp(np.arange(w) / w * math.log(min(h, w) / 2.0))[None, :] / min(h, w)  # in cycles a pixel
    x = (np.cos(angle) * radius * w + w // 2).astype(np.float32)
    y = (np.sin(angle) * radius * h + h // 2).astype(np.float32)
    return sample(magnitude, x, y)


def fir_filter(delta: Image32) -> Image32:
    """Section 2.2's filter: gathers the energy of one pulse that fell between cells (periodic, unit sum)."""
    padded = np.pad(delta, 1, mode="wrap")
    kernel = np.array([0.25, 0.5, 0.25])
    filtered: Image32 = cv2.sepFilter2D(padded, cv2.CV_32F, kernel, kernel)[1:-1, 1:-1]
    return filtered


def pulse_covariance(delta: Image32, row: float, column: float, neighbourhood: int) -> FloatArray:
    """``(2, 2)`` covariance (row, column) of a pulse read as a probability mass (Algorithm 3, to the letter).

    It is not what registrations carry. Measured on pairs of known truth (``benchmarks/registration``, 256 pixels):

    - The normaliser does nothing: the sum of a pulse is its spectrum's value at frequency 0, which is exp(i 0) = 1.
    - The mass can be negative, so the result need not be a covariance: of the right registrations 0-10 % come out not
      positive definite for N = 2, 16-55 % for N = 4, 44-81 % for N = 8, most where the pulse is sharpest.
    - It tells of the pulse's width, not of the error: at no tilt it claims half as much again as it errs (NEES per
      degree of freedom 0.2), and it claims the very same at 10 degrees of tilt, where errors are four times as large
      (3.8; N = 2). With another N the claim is another.
    """
    h, w = delta.shape
    mass = delta / delta.sum()
    i = np.arange(round(row) - neighbourhood, round(row) + neighbourhood + 1)
    j = np.arange(round(column) - neighbourhood, round(column) + neighbourhood + 1)
    patch = mass[np.ix_(i % h, j % w)].astype(np.float64)
    di, dj = i - row, j - column
    cross = float(di @ patch @ dj)
    return np.array([[float(di**2 @ patch.sum(axis=1)), cross], [cross, float(patch.sum(axis=0) @ dj**2)]])


def _argmax(delta: Image32) -> tuple[int, int]:
    row, column = divmod(int(np.argmax(delta)), delta.shape[1])
    return row, column


def _signed(cell: int, count: int) -> int:
    """Return a shift modulo ``count`` as the nearest to zero."""
    return cell - count if cell > count // 2 else cell
