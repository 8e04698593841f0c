"""A map with known landmarks, as a TileSource in memory, for the tests of every format."""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from pyproj import CRS, Transformer

from photomap_gis.core.grid import MapGrid, Window

BACKGROUND = np.array((96, 110, 84))
LANDMARKS = {  # colour (RGB) -> pixel (x, y) of a disc's centre; no turn or mirror maps them into each other
    (230, 30, 30): (90.0, 70.0),
    (30, 220, 40): (330.0, 60.0),
    (40, 60, 235): (120.0, 300.0),
    (235, 220, 30): (300.0, 250.0),
}
RADIUS_PX = 14
HIDDEN = (255, 0, 255)  # colour under alpha 0: it must never be seen


@dataclass(frozen=True)
class ArraySource:
    """A TileSource over an array that notes the largest window asked for."""

    rgba: np.ndarray
    grid: MapGrid
    revision: int = 1
    windows: list[Window] = field(default_factory=list)

    def read(self, window: Window) -> np.ndarray:
        self.windows.append(window)
        c, r, w, h = window
        out = np.zeros((h, w, 4), np.uint8)
        x0, y0, x1, y1 = max(0, c), max(0, r), min(self.grid.width, c + w), min(self.grid.height, r + h)
        if x1 > x0 and y1 > y0:
            out[y0 - r : y1 - r, x0 - c : x1 - c] = self.rgba[y0:y1, x0:x1]
        return out


def scene_rgba(width: int = 420, height: int = 380) -> np.ndarray:
    """``(H, W, 4)``: four discs, a black letter F, and nothing seen in the lower left corner."""
    y, x = np.mgrid[:height, :width].astype(float)
    rgb = np.broadcast_to(BACKGROUND, (height, width, 3)).astype(float)
    for colour, (cx, cy) in LANDMARKS.items():
        share = np.clip(RADIUS_PX + 0.5 - np.hypot(x - cx, y - cy), 0, 1)[..., None]
        rgb = rgb * (1 - share) + np.array(colour) * share
    rgb[150:230, 190:202] = 0
    rgb[150:162, 190:240] = 0
    rgb[184:196, 190:225] = 0
    rgba = np.dstack([np.rint(rgb), np.full((height, width), 255)]).astype(np.uint8)
    rgba[(height - 1 - y) + x < 90] = (*HIDDEN, 0)
    return rgba


def find_landmarks(rgba: np.ndarray) -> dict[tuple[int, int, int], np.ndarray]:
    """``(2,)`` pixel-centre position of each disc: the centroid, weighted by how much of its colour a pixel has."""
    found = {}
    rgb = rgba[..., :3].astype(np.int16)
    for colour in LANDMARKS:
        # its core is found by colour alone, the largest patch only: the rims of other discs can look alike
        core = (np.abs(rgb - np.array(colour, np.int16)).max(axis=-1) < 40) & (rgba[..., 3] > 128)
        count, _, stats, _ = cv2.connectedComponentsWithStats(core.astype(np.uint8))
        assert count > 1, f"landmark {colour} is missing"
        left, top, width, height, _ = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))]
        margin = 3 + width // 4
        y0, x0 = max(0, top - margin), max(0, left - margin)
        near = (slice(y0, top + height + margin), slice(x0, left + width + margin))
        away = np.array(colour) - BACKGROUND
        share = (rgb[near] - BACKGROUND) @ away / (away @ away)
        rest = np.linalg.norm(rgb[near] - BACKGROUND - share[..., None] * away, axis=-1)
        weight = np.where((rgba[near][..., 3] > 128) & (rest < 45), share.clip(0, 1), 0.0)
        weight[weight < 0.04] = 0.0  # noise of compression
        y, x = np.mgrid[: weight.shape[0], : weight.shape[1]]
        found[colour] = np.array([(weight * x).sum() / weight.sum() + x0, (weight * y).sum() / weight.sum() + y0])
    return found


def landmark_errors_px(source: ArraySource, rgba: np.ndarray, crs, to_crs: Callable) -> float:
    """The worst distance, in the source's pixels, between where a landmark was found and where it is.

    ``to_crs`` takes ``(N, 2)`` pixel-centre coordinates of the output into its ``crs``.
    """
    back = Transformer.from_crs(CRS.from_user_input(crs), CRS(source.grid.crs_wkt), always_xy=True)
    errors = []
    for colour, xy in find_landmarks(rgba).items():
        place = np.asarray(to_crs(xy[None])).reshape(2)
        found = source.grid.to_px([back.transform(*place)])[0]
        errors.append(np.hypot(*(found - LANDMARKS[colour])))
    return max(errors)


def make_source(
    crs: str | None = "EPSG:32633", west: float = 391_000.0, north: float = 5_820_000.0, pixel_size: float = 0.25
) -> ArraySource:
    rgba = scene_rgba()
    wkt = None if crs is None else CRS.from_user_input(crs).to_wkt()
    return ArraySource(rgba, MapGrid(wkt, west, north, pixel_size, rgba.shape[1], rgba.shape[0]))


def make_small() -> ArraySource:
    """A few pixels, for tests that are about files and not about what they show."""
    rgba = np.full((40, 50, 4), (96, 110, 84, 255), np.uint8)
    return ArraySource(rgba, MapGrid(CRS.from_epsg(32633).to_wkt(), 391_000.0, 5_820_000.0, 0.25, 50, 40))


@pytest.fixture
def scene() -> SimpleNamespace:
    """The scene's makers and measures."""
    return SimpleNamespace(
        source=make_source,
        small=make_small,
        of_array=ArraySource,
        find=find_landmarks,
        errors_px=landmark_errors_px,
        landmarks=LANDMARKS,
        background=BACKGROUND,
        hidden=HIDDEN,
    )


PLACES = {
    "utm-33n": ("EPSG:32633", 391_000.0, 5_820_000.0),
    "utm-19s": ("EPSG:32719", 346_000.0, 6_298_000.0),
    "utm-60n-antimeridian": ("EPSG:32660", 832_660.0, 553_470.0),
    "utm-35n-arctic": ("EPSG:32635", 480_000.0, 8_690_000.0),
    "poland-north-first": ("EPSG:2180", 637_000.0, 486_500.0),
    "switzerland": ("EPSG:2056", 2_600_000.0, 1_200_000.0),
}


@pytest.fixture(params=PLACES.values(), ids=PLACES.keys())
def placed(request: pytest.FixtureRequest) -> ArraySource:
    """The scene at places all over the Earth, in UTM and national CRS."""
    return make_source(*request.param)
