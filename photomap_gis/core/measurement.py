"""What a registration found out about two frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from photomap_gis.core.similarity import FloatArray, Similarity2D


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """The motion between two images, how sure it is, and how it was found.

    ``T_a_b`` maps pixels (x, y) of image b into image a; (0, 0) is the centre of the top-left pixel. ``covariance`` is
    ``(4, 4)``, of ``xi`` in ``T_true = T Exp(xi)``, order ``DOF``, about the **image centre** of b in b's pixels.
    ``model_sigma_px`` is what a similarity cannot express (tilt, relief), per axis in b's pixels, apart from the
    covariance. ``H_a_b`` is the homography, ``(3, 3)`` between the same pixels, that also holds what of it is tilt or
    slope, where that was measured. A poor registration is still a registration: wide covariance, low ``probability``.
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
