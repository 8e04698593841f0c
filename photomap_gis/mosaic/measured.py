"""What a run measured of its frames before the first tile: kept beside the tiles, for resumed runs and for layers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from photomap_gis.mosaic.exposure import Exposure
from photomap_gis.mosaic.tiles import TileStore, write_atomically

_FILE = "exposure.json"


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The frames' exposure, their blur in pixels (NaN where nothing tells), and which could not be read."""

    exposure: Exposure = field(default_factory=lambda: Exposure({}))
    blur_px: Mapping[int, float] = field(default_factory=dict)
    unreadable: frozenset[int] = frozenset()


def keep_measured(store: TileStore, measured: Measured) -> None:
    """Keep it with the store's tiles."""
    document = {
        "fingerprint": store.fingerprint,
        "vignette": measured.exposure.vignette,
        "gains": {str(frame): gain.tolist() for frame, gain in measured.exposure.gains.items()},
        "blur_px": {str(f): b if math.isfinite(b) else None for f, b in measured.blur_px.items()},
        "unreadable": sorted(measured.unreadable),
    }
    write_atomically(store.folder / _FILE, json.dumps(document).encode())


def load_measured(store: TileStore) -> Measured | None:
    """Return what a run of the store's own plan found; ``None`` where there was none."""
    try:
        document = json.loads((store.folder / _FILE).read_text(encoding="utf-8"))
        if document["fingerprint"] != store.fingerprint:
            return None
        gains = {int(frame): np.array(gain, dtype=np.float64) for frame, gain in document["gains"].items()}
        v0, v1 = document["vignette"]
        blur = {int(frame): math.nan if b is None else float(b) for frame, b in document["blur_px"].items()}
        return Measured(Exposure(gains, (float(v0), float(v1))), blur, frozenset(document["unreadable"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
