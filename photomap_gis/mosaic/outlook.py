"""What frames show at the nodes that two of them contend for, so that seams find their way around things. Compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled
from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.lattice import FloatImage
from photomap_gis.mosaic.lowband import LowBand
from photomap_gis.mosaic.seams import Contest, Looks
from photomap_gis.mosaic.sighting import X_PX, Y_PX
from photomap_gis.mosaic.views import View


def looks_of(
    views: Sequence[View], sights: FloatImage, low_band: Callable[[View], LowBand], exposure: Exposure
) -> Looks:
    """Return what tells ``seams`` of the views' pictures; only those that contend are asked for one."""

    def look(contest: Contest) -> tuple[FloatImage, FloatImage]:
        grey, rough = np.zeros(contest.two.shape, np.float32), np.zeros(contest.two.shape, np.float32)
        contend = np.unique(contest.two[:, contest.free])
        for k in contend[contend >= 0].tolist():
            low = low_band(views[k])
            if low.outlook is None:
                continue
            gain = float(np.mean(exposure.gains.get(views[k].frame, 1.0)))
            _look(np.ascontiguousarray(low.outlook), sights[k], low.width_px, low.height_px,
                  views[k].half_diagonal_px, *exposure.vignette, gain, k, contest.two, contest.free,
                  grey, rough)  # fmt: skip
        return grey, rough

    return look


@compiled(
    "void(Array(u1, 3, 'C', True), f4[:,:,::1], i8, i8, f8, f8, f8, f8, i8, i2[:,:,::1], b1[:,::1], f4[:,:,::1], "
    "f4[:,:,::1])"
)
def _look(
    outlook: npt.NDArray[np.uint8],
    sight: FloatImage,
    width: int,
    height: int,
    half_diagonal: float,
    v0: float,
    v1: float,
    gain: float,
    label: int,
    two: npt.NDArray[np.int16],
    free: npt.NDArray[np.bool_],
    grey: FloatImage,
    rough: FloatImage,
) -> None:
    """Fill a frame's outlook, levelled, where it is one of the two."""
    rows, columns = outlook.shape[0], outlook.shape[1]
    for i in range(free.shape[0]):
        for j in range(free.shape[1]):
            if not free[i, j] or (two[0, i, j] != label and two[1, i, j] != label):
                continue
            x, y = sight[X_PX, i, j], sight[Y_PX, i, j]
            dx, dy = x - (width - 1) / 2.0, y - (height - 1) / 2.0
            r2 = (dx * dx + dy * dy) / (half_diagonal * half_diagonal)
            factor = np.exp((v0 + v1 * r2) * r2) * gain
            u = min(max((x + 0.5) * columns / width - 0.5, 0.0), columns - 1.0)
            v = min(max((y + 0.5) * rows / height - 0.5, 0.0), rows - 1.0)
            c, r = int(u), int(v)
            d, q = min(c + 1, columns - 1), min(r + 1, rows - 1)
            u, v = u - c, v - r
            which = 0 if two[0, i, j] == label else 1
            for band in range(2):
                upper = outlook[r, c, band] * (1.0 - u) + outlook[r, d, band] * u
                lower = outlook[q, c, band] * (1.0 - u) + outlook[q, d, band] * u
                value = (upper * (1.0 - v) + lower * v) * factor
                if band == 0:
                    grey[which, i, j] = value
                else:
                    rough[which, i, j] = value
