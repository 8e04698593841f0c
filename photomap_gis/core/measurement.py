"""What a registration found out about two frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D


@dataclass(frozen=True, slots=True, eq=False)
class TiePoints:
    """K places of image b found again in image a, each by itself: what tilt and relief are read from.

    ``xy_b_px`` and ``xy_a_px`` ``(K, 2)`` are pixels of the two images; ``covariance_a_px2`` ``(K, 3)`` holds the
    elements xx, xy and yy of the error in a. ``place`` ``(K,)`` names the place in b: the same number is the same spot
    of b in all of its registrations.
    """

    xy_a_px: FloatArray
    xy_b_px: FloatArray
    covariance_a_px2: FloatArray
    place: npt.NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.place)

    def carried(self, T_a_worka: Similarity2D, T_b_workb: Similarity2D) -> TiePoints:
        """Return the same ties in the pixels of other copies of the images."""
        c, s = T_a_worka.linear[:, 0]
        xx, xy, yy = self.covariance_a_px2.T
        turned = np.stack(
            [
                c * c * xx - 2.0 * c * s * xy + s * s * yy,
                c * s * (xx - yy) + (c * c - s * s) * xy,
                s * s * xx + 2.0 * c * s * xy + c * c * yy,
            ],
            axis=1,
        )
        return TiePoints(T_a_worka.apply(self.xy_a_px), T_b_workb.apply(self.xy_b_px), turned, self.place)


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """The motion between two images, how sure it is, and how it was found.

    ``T_a_b`` maps pixels (x, y) of image b into image a; (0, 0) is the centre of the top-left pixel. ``covariance`` is
    ``(4, 4)``, of ``xi`` in ``T_true = T Exp(xi)``, order ``DOF``, about the **image centre** of b in b's pixels.
    ``model_sigma_px`` is what a similarity cannot express (tilt, relief), per axis in b's pixels, apart from the
    covariance. ``H_a_b`` is the homography, ``(3, 3)`` between the same pixels, that also holds what of it is tilt or
    slope, where that was measured, and ``ties`` what was found place by place. A poor registration is still a
    registration: wide covariance, low ``probability``.
    """

    T_a_b: Similarity2D
    covariance: FloatArray
    probability: float
    size_b_px: tuple[int, int]
    model_sigma_px: float = 0.0
    accepted: bool = False
    method: str = "ifmi"
    overlap: float = 0.0
    correlation: float = 0.0
    alternatives: tuple[Similarity2D, ...] = field(default=())
    a: int = -1
    b: int = -1
    H_a_b: FloatArray | None = None
    ties: TiePoints | None = None

    def __post_init__(self) -> None:
        c = np.array(self.covariance, dtype=np.float64)
        if c.shape != (4, 4):
            raise ValueError(f"covariance must be (4, 4), got {c.shape}")
        c.setflags(write=False)
        object.__setattr__(self, "covariance", c)

    def seen_from(self, T_planea_a: Similarity2D, T_planeb_b: Similarity2D) -> tuple[Similarity2D, FloatArray]:
        """Return ``(T_planea_planeb, covariance)`` when the images' pixels lie in the planes by these similarities.

        The covariance comes back about the **origin of plane b**, in its axes and units.
        """
        w, h = self.size_b_px
        centre = Similarity2D.translation_of((w - 1) / 2.0, (h - 1) / 2.0)
        T_centreb_planeb = centre.inverse() @ T_planeb_b.inverse()
        T = T_planea_a @ self.T_a_b @ T_planeb_b.inverse()
        ad = T_centreb_planeb.inverse().adjoint()
        return T, ad @ self.covariance @ ad.T
