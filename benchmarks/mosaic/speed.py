"""Render throughput against the floor: one bare ``cv2.warpPerspective`` of each output pixel, in turn, one thread."""

from __future__ import annotations

import time

import cv2
import numpy as np

from photomap_gis.mosaic import plan_grid, plan_tiles
from photomap_gis.mosaic.exposure import find_exposure
from photomap_gis.mosaic.lowband import LowBand, low_band_of
from photomap_gis.mosaic.pixels import SourceImage, prepare
from photomap_gis.mosaic.render import render_tile_and_sources
from photomap_gis.mosaic.tile_codec import encode_tile
from photomap_gis.mosaic.views import View, views_of

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .flight import GSD_M, MAP_FRAME, Pictures, lawnmower


class _InMemory:
    """All frames, decoded: what is timed is drawing alone."""

    def __init__(self, views: list[View], read: Pictures) -> None:
        self._images = {v.frame: prepare(read(v.frame), GSD_M / v.gsd_m_per_px) for v in views}
        self._lows = {frame: low_band_of(image) for frame, image in self._images.items()}

    def image(self, view: View) -> SourceImage:
        return self._images[view.frame]

    def low_band(self, view: View) -> LowBand:
        return self._lows[view.frame]


def measure(*, quick: bool) -> Section:
    """Time the two in turn, round by round: what else the machine does slows both."""
    frames, rounds = (12, 3) if quick else (32, 7)
    trajectory = lawnmower(frames, width_px=1600, height_px=1200, per_strip=frames // 4)
    views = views_of(trajectory)
    source = _InMemory(views, Pictures(trajectory, kept=frames))
    by_frame = {v.frame: v for v in views}
    exposure = find_exposure(views, lambda f: source.low_band(by_frame[f]))
    grid = plan_grid(trajectory, MAP_FRAME, pixel_size=GSD_M)
    jobs = plan_tiles(trajectory, grid, MAP_FRAME)
    image = source.image(views[0]).image
    H = np.array([[0.99, 0.05, 30.0], [-0.04, 1.01, 20.0], [1e-6, 2e-6, 1.0]])
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    drawn, floor, encoded = [], [], []
    try:
        for _ in range(rounds):
            drawing = bare = packing = 0.0
            for job in jobs:
                window = grid.window(job.tile)
                start = time.process_time()
                tile = render_tile_and_sources(
                    window, grid, MAP_FRAME, givers=[by_frame[f] for f in job.frames],
                    neighbours=[by_frame[f] for f in job.neighbours], source=source, exposure=exposure,
                )  # fmt: skip
                drawing += time.process_time() - start
                start = time.process_time()
                cv2.warpPerspective(
                    image, H, (window.width, window.height), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
                )
                bare += time.process_time() - start
                start = time.process_time()
                encode_tile(tile.rgba)
                packing += time.process_time() - start
            drawn.append(drawing)
            floor.append(bare)
            encoded.append(packing)
    finally:
        cv2.setNumThreads(threads)
    ratios = np.array(drawn) / np.array(floor)
    pixels = sum(grid.window(j.tile).width * grid.window(j.tile).height for j in jobs)
    note = (
        f"{len(jobs)} tiles of {frames} frames 1600 x 1200; a tile: {1e3 * min(drawn) / len(jobs):.1f} ms drawing, "
        f"{1e3 * min(encoded) / len(jobs):.1f} ms packing, {1e3 * min(floor) / len(jobs):.1f} ms floor"
    )
    return Section(
        "speed",
        (
            Figure("drawing over the floor", _interval(ratios), rounds, "x", Bar(high=2.5)),
            Figure("megapixels a second and thread", _interval(pixels / 1e6 / np.array(drawn)), rounds, "/s"),
        ),
        notes=(note,),
    )


def _interval(values: np.ndarray) -> Interval:
    return Interval(float(np.median(values)), float(values.min()), float(values.max()))
