"""Refinement: from a coarse motion to a photometric fit of a fraction of a pixel, by robust Gauss-Newton steps.

Inverse compositional Lucas-Kanade with a gain on the evenly spread points of b's ``Template``, from the coarsest floor
to the finest: first a similarity, then the homography of its *field* (see ``field``). Floors are normalised for local
brightness and contrast already, so no bias is needed.

A motion here is ``G``, ``(3, 3)``: field coordinates of b (see ``template``) to frame pixels of a.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.descent import descend, share_outlying
from photomap_gis.ifmi.kernels import Image32
from photomap_gis.ifmi.spectrum import Floor


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A refined motion ``G``, and what the last step saw.

    ``correlation`` is that of the compared points, ``support`` the share of b's points that lie in a: 0 where the fit
    has failed. ``attenuation`` ``(2, 2)`` is how much of b's slopes is found in a: noise and blur are not.
    ``seen`` ``(N,)`` are a's values at the points of b's template before the last step, ``valid`` where there are any.
    """

    G: FloatArray
    correlation: float
    support: float
    attenuation: FloatArray
    seen: Image32
    valid: npt.NDArray[np.bool_]


def align(
    a: Floor,
    b: Floor,
    G: FloatArray,
    *,
    freedom: int,
    steps: int,
    enough_px: float = 0.02,
    stiffness: float = 0.0,
    near: bool = False,
) -> Alignment:
    """Refine ``G`` on a floor by its first ``freedom`` (4: similarity, 8: homography) parameters.

    It ends where less than ``enough_px`` of the floor at ``reach_px`` are left to go. ``stiffness`` holds parameters
    from the fifth on at first: the share of the similarity's mean information that is added to theirs. ``near`` says
    that ``G`` is right to about a pixel already: then, and only then, the slopes of both frames tell how far a step has
    to go.
    """
    t = b.template
    A, Q = t.A.reshape(9, -1), t.Q.reshape(3, -1)
    n = A.shape[1]
    refined, attenuation = np.array(G, np.float64, order="C"), np.eye(2)
    seen, valid = np.empty(n, np.float32), np.empty(n, np.bool_)
    correlation, support = descend(
        a.seen,
        a.values,
        a.factor,
        Q,
        A,
        t.usable.ravel(),
        freedom,
        steps,
        max(b.shape) / 2.0,
        enough_px,
        stiffness,
        near,
        refined,
        attenuation,
        seen,
        valid,
    )
    return Alignment(refined, correlation, support, attenuation, seen, valid)


def outlying(b: Floor, fit: Alignment) -> float:
    """Return the share of b's points that the fit does not explain, were it a little off and noise as it is.

    Only points in company count: raised and moved things are patches, heavy tails of noise are not.
    """
    t = b.template
    return share_outlying(t.A.reshape(9, -1), t.usable.shape[1], fit.seen, fit.valid, 2.0 / max(b.shape))
