"""Seam quality: whole simulated flights through the product, their maps compared with the ground patch by patch.

The seams of the product are compared with straight ones on the same placements.
"""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
import numpy.typing as npt
import rasterio

from photomap_gis.mosaic import render
from photomap_gis.pipeline import MapSettings, map_flight
from photomap_gis.pipeline.deliver import deliver
from photomap_gis.pipeline.draw import draw_maps
from photomap_gis.pipeline.opening import kept_settings
from photomap_gis.pipeline.solved import Solved
from photomap_gis.simulate import FlightSpec, Motion, run_simulation
from photomap_gis.simulate.evaluate import Comparison, compare
from photomap_gis.simulate.matching import NCC_MIN, coarse_alignment, match_patches
from photomap_gis.simulate.truth import Truth, read_truth
from photomap_gis.store import Mission

SEAM_PX = 8
"""What is this near to a seam counts as on it."""
PATCH_PX = 64
WINDOW_PX = 32
"""Side of the windows that are looked at along seams, and how far they are looked for."""
STRIDE_PX = 12
LEAST_SHARE = 0.08  # of a patch that must lie on a seam (or off it) to be judged there


@dataclass(frozen=True, slots=True, eq=False)
class SeamQuality:
    """What a map's comparison with the ground found.

    ``energy`` are ratios of gradient energy, a patch each, over what is off seams; ``energy_on_seams`` within 8 px of
    them. ``unmatched`` is the share of patches that correlate nowhere within 10 px. ``broken`` is the share of windows
    of 32 px that correlate nowhere with the ground: across seams, and anywhere else.
    """

    energy: npt.NDArray[np.float64]
    energy_on_seams: npt.NDArray[np.float64]
    unmatched: float
    broken_on_seams: float
    broken_elsewhere: float
    seam_windows: int


def fly(folder: Path, *, relief: bool, frames: int, width_px: int, seed: int = 0) -> Truth:
    """Simulate a flight over the procedural ground, or over the same picture laid flat; reuse one that lies there."""
    spec = FlightSpec(
        frames=frames, altitude_m=100.0, width_px=width_px, height_px=width_px * 3 // 4, seed=seed,
        motion=Motion(tilt_deg=2.0),
    )  # fmt: skip
    if not (folder / "truth" / "truth.json").is_file():
        if relief:
            run_simulation("procedural", folder, spec)
        else:
            hilly = fly(
                folder.with_name(folder.name + "-hilly"), relief=True, frames=frames, width_px=width_px, seed=seed
            )
            ground = hilly.ground()
            folder.mkdir(parents=True, exist_ok=True)
            picture = folder / "ground.png"
            cv2.imwrite(str(picture), ground.colour)
            run_simulation(picture, folder, spec, pixel_size_m=ground.pixel_size_m)
    return read_truth(folder)


def map_it(folder: Path, *, straight: bool = False) -> tuple[Path, Path]:
    """Map a flight and draw the map of its solution; return ``map.tif`` and its layer of source frames.

    With ``straight`` seams are where two frames cost the same: both maps show the same placements.
    """
    mission = folder.with_name(folder.name + "-mission")
    if not (mission / "map.tif").is_file():
        map_flight([folder / "photos"], mission, MapSettings())
    out = folder.with_name(folder.name + ("-straight" if straight else "-seams"))
    out.mkdir(exist_ok=True)
    seams = mock.patch.object(render, "node_labels", _cheapest) if straight else contextlib.nullcontext()
    with Mission.open(mission) as kept, seams, tempfile.TemporaryDirectory() as scratch:
        solved = Solved.load(kept)
        with mock.patch.object(Mission, "mosaic_folder", lambda self, segment=0: Path(scratch) / f"mosaic-{segment}"):
            maps = draw_maps(kept, solved, kept_settings(kept), lambda *_: None)
            with mock.patch.object(kept, "folder", out):
                deliver(kept, solved, maps, lambda *_: None, layers=True)
    return out / "map.tif", out / "layers" / "source_frame.tif"


def _cheapest(costs: np.ndarray, *_: object, **__: object) -> np.ndarray:
    best = np.argmin(costs, axis=0).astype(np.int16)
    best[~np.isfinite(costs.min(axis=0))] = -1
    return best


def judge(map_tif: Path, source_tif: Path, truth: Truth) -> SeamQuality:
    """Compare a map with the true ground, on its seams and off them."""
    c = compare(map_tif, truth, truth.ground())
    seam, inner = seam_mask(source_tif, c)
    T = coarse_alignment(c.true, c.seen, c.mapped, c.alpha, pixel_size_m=c.grid.pixel_size)
    found = match_patches(c.true, c.seen, c.mapped, c.alpha, T)
    share = cv2.blur(c.raised.astype(np.float32), (PATCH_PX, PATCH_PX))
    on, off = [], []
    energy_true, energy_map = (_gradient_energy(a) for a in (c.true, c.mapped))
    land = np.array([share[int(y), int(x)] <= 0.05 for x, y in np.round(found.true_xy)], bool)
    for (tx, ty), (mx, my) in zip(found.true_xy[found.found & land], found.map_xy[found.found & land], strict=True):
        a, b = _patch(tx, ty), _patch(mx, my)
        near = seam[b]
        if near.shape != (PATCH_PX, PATCH_PX) or not inner[b].all():
            continue
        for where, out in ((near, on), (~near, off)):
            if where.mean() >= LEAST_SHARE:
                out.append(float(energy_map[b][where].sum() / max(energy_true[a][where].sum(), 1e-9)))
    unmatched = float((~found.found & land).sum() / max(land.sum(), 1))
    broken_on, windows = _broken(c, T, _along(seam & inner, source_tif, c))
    rest = np.argwhere(inner & ~cv2.dilate(seam.astype(np.uint8), np.ones((33, 33))).astype(bool))[:: 40 * STRIDE_PX]
    broken_off, _ = _broken(c, T, rest)
    return SeamQuality(np.array(off), np.array(on), unmatched, broken_on, broken_off, windows)


def seam_mask(source_tif: Path, c: Comparison) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return what lies within ``SEAM_PX`` of a seam, and what lies well inside the map; on the comparison's grid."""
    source = _on_grid(source_tif, c)
    line = np.zeros(source.shape, np.uint8)
    line[:, 1:] |= (source[:, 1:] != source[:, :-1]) & (source[:, 1:] >= 0) & (source[:, :-1] >= 0)
    line[1:] |= (source[1:] != source[:-1]) & (source[1:] >= 0) & (source[:-1] >= 0)
    near = cv2.dilate(line, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * SEAM_PX + 1,) * 2)) > 0
    inner = cv2.erode((source >= 0).astype(np.uint8), np.ones((PATCH_PX, PATCH_PX))) > 0
    return near, inner & c.seen


def _along(near: npt.NDArray[np.bool_], source_tif: Path, c: Comparison) -> npt.NDArray[np.intp]:
    """``(N, 2)`` row, column of places on seams, some ``STRIDE_PX`` apart."""
    source = _on_grid(source_tif, c)
    line = np.zeros(source.shape, bool)
    line[:, 1:] |= source[:, 1:] != source[:, :-1]
    line[1:] |= source[1:] != source[:-1]
    return np.argwhere(line & near)[::STRIDE_PX]


def _broken(c: Comparison, T_map_true, places: npt.NDArray[np.intp]) -> tuple[float, int]:  # type: ignore[no-untyped-def]
    """Return the share of the map's windows about ``(N, 2)`` places that are not found in the truth; and how many."""
    half, reach = WINDOW_PX // 2, 12
    lost = tried = 0
    for row, col in places:
        x, y = np.round(T_map_true.inverse().apply([[col, row]])[0]).astype(int)
        near = c.true[y - half - reach : y + half + reach, x - half - reach : x + half + reach]
        window = c.mapped[row - half : row + half, col - half : col + half]
        if near.shape != (2 * (half + reach),) * 2 or window.shape != (WINDOW_PX,) * 2 or window.std() < 4.0:
            continue
        tried += 1
        lost += float(cv2.matchTemplate(near, window, cv2.TM_CCOEFF_NORMED).max()) < NCC_MIN
    return lost / max(tried, 1), tried


def _on_grid(source_tif: Path, c: Comparison) -> npt.NDArray[np.int32]:
    with rasterio.open(source_tif) as raster:
        col = round((c.grid.west - raster.transform.c) / c.grid.pixel_size)
        row = round((raster.transform.f - c.grid.north) / c.grid.pixel_size)
        window = rasterio.windows.Window(col, row, c.grid.width, c.grid.height)
        return raster.read(1, window=window, boundless=True, fill_value=-1)


def _gradient_energy(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    grey = image.astype(np.float32)
    return np.square(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1)) + np.square(cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=1))


def _patch(x: float, y: float) -> tuple[slice, slice]:
    left, top = round(x - (PATCH_PX - 1) / 2.0), round(y - (PATCH_PX - 1) / 2.0)
    return slice(max(top, 0), top + PATCH_PX), slice(max(left, 0), left + PATCH_PX)
