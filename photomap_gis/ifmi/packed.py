"""OpenCV's packed layout of a real picture's transform, to and from the ordinary half spectrum, compiled.

Rows of the packed ``(h, w)`` array hold real and imaginary parts in turn; the first and the last column, whose
transforms are those of real columns, are packed downwards in the same way.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from photomap_gis.compiled import compiled

Packed = npt.NDArray[np.float32]
Half = npt.NDArray[np.complex64]


@compiled("void(f4[:, ::1], c8[:, ::1])")
def unpack(packed: Packed, half: Half) -> None:
    """Write the ``(h, w // 2 + 1)`` half spectrum; h and w are even."""
    h, w = packed.shape
    for r in range(h):
        for c in range(1, w // 2):
            half[r, c] = complex(packed[r, 2 * c - 1], packed[r, 2 * c])
    for column, stored in ((0, 0), (w // 2, w - 1)):
        half[0, column] = complex(packed[0, stored], 0.0)
        half[h // 2, column] = complex(packed[h - 1, stored], 0.0)
        for r in range(1, h // 2):
            x, y = packed[2 * r - 1, stored], packed[2 * r, stored]
            half[r, column] = complex(x, y)
            half[h - r, column] = complex(x, -y)


@compiled("void(c8[:, ::1], f4[:, ::1])")
def pack(half: Half, packed: Packed) -> None:
    """Write the packed ``(h, w)`` array of a half spectrum; h and w are even."""
    h, w = packed.shape
    for r in range(h):
        for c in range(1, w // 2):
            packed[r, 2 * c - 1] = half[r, c].real
            packed[r, 2 * c] = half[r, c].imag
    for column, stored in ((0, 0), (w // 2, w - 1)):
        packed[0, stored] = half[0, column].real
        packed[h - 1, stored] = half[h // 2, column].real
        for r in range(1, h // 2):
            packed[2 * r - 1, stored] = half[r, column].real
            packed[2 * r, stored] = half[r, column].imag
