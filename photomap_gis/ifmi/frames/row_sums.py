"""The inner loop of ``rows.py``: where a window of rows lies best in a predecessor, slope by slope."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled

FloatImage = npt.NDArray[np.float32]


@compiled("void(f4[:,:,::1], f8[::1], i8, i8, f4[:,::1], i8[:,:,::1])")
def best_lags(
    likeness: npt.NDArray[np.float32],
    slopes: npt.NDArray[np.float64],
    rows: int,
    step: int,
    best: npt.NDArray[np.float32],
    at: npt.NDArray[np.int64],
) -> None:
    """Write the best mean likeness of each window and slope into ``best`` ``(n, m)``, and where into ``at``.

    ``likeness`` ``(D, h, w)``: by row displacement and lag. ``at`` ``(n, m, 2)``: those two. A window has ``rows`` rows
    and begins ``step`` after the one before; its middle row has the lag, each further one ``slope`` more.
    """
    downs, _, w = likeness.shape
    total = np.empty(w, np.float32)
    for i in range(best.shape[0]):
        for j in range(len(slopes)):
            best[i, j] = -np.inf
            for d in range(downs):
                total[:] = 0.0
                for k in range(rows):
                    line = likeness[d, i * step + k]
                    shift = int(np.rint(slopes[j] * (k - rows // 2))) % w
                    for lag in range(w - shift):
                        total[lag] += line[lag + shift]
                    for lag in range(w - shift, w):
                        total[lag] += line[lag + shift - w]
                for lag in range(w):
                    if total[lag] > best[i, j]:
                        best[i, j] = total[lag]
                        at[i, j, 0] = d
                        at[i, j, 1] = lag
            best[i, j] /= rows
