"""After landing: the finished live map against ``photomap map`` of the recording, the live map against its export."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import rasterio

from photomap_gis.cli import main as photomap
from photomap_gis.core.grid import Window
from photomap_gis.live.landing import land
from photomap_gis.mosaic import TileStore
from photomap_gis.simulate.evaluate import evaluate_map

from ..registration.report import Bar, Figure, Section
from ..registration.score import Interval
from .breaks import HEIGHT_PX, RATE_HZ, WIDTH_PX
from .flights import video_of


def measure(folder: Path, *, seconds: int = 60) -> Section:
    """Fly a recording, export, finish; map it the ordinary way; compare both with the truth."""
    video = video_of(folder, seconds, width_px=WIDTH_PX, height_px=HEIGHT_PX, rate_hz=RATE_HZ)
    live, mapped, exported = folder / "mission-finished", folder / "mission-mapped", folder / "mid-flight.tif"
    for one in (live, mapped):
        shutil.rmtree(one, ignore_errors=True)
    exported.unlink(missing_ok=True)
    _run("live", video, "-o", live, "--as-fast-as-possible", "--no-finalise", "-q")
    _run("export", live, "--geotiff", "--crs", "EPSG:3857", "-o", exported, "-q")
    apart_px, differing = _against_export(live, exported)
    land(live, lambda stage, done, total: None)
    _run("map", video, "-o", mapped, "-q")
    truth = video.parents[1] / "truth"
    ours, theirs = evaluate_map(live / "map.tif", truth), evaluate_map(mapped / "map.tif", truth)
    return Section(
        "finished",
        (
            _one("live map off its export, px", apart_px, Bar(high=0.1)),
            _one("pixels of both that differ, share", differing, Bar(high=0.0)),
            _one("relative error of the finished live map, in GSD", ours.relative_rmse_gsd),
            _one("relative error of photomap map, in GSD", theirs.relative_rmse_gsd),
            _one("the one over the other", ours.relative_rmse_gsd / theirs.relative_rmse_gsd, Bar(high=1.2)),
            _one("covered by the finished live map", ours.coverage),
            _one("covered by photomap map", theirs.coverage),
        ),
        notes=(f"{seconds} s of {WIDTH_PX}x{HEIGHT_PX} at {RATE_HZ:g} fps",),
    )


def _against_export(live: Path, exported: Path) -> tuple[float, float]:
    """Return by how much of a pixel two grids are apart, and the share of pixels that differ where both show ground."""
    store = TileStore(live / "mosaic")
    g = store.grid
    with rasterio.open(exported) as file:
        x = (file.transform.c - g.west) / g.pixel_size
        y = (g.north - file.transform.f) / g.pixel_size
        grows = abs(file.transform.a / g.pixel_size - 1.0) * max(file.width, file.height)
        pixels = np.moveaxis(file.read(), 0, -1)
    shown = store.read(Window(round(x), round(y), pixels.shape[1], pixels.shape[0]))
    both = (shown[..., 3] > 0) & (pixels[..., -1] > 0)
    differing = float((shown[both][:, :3] != pixels[both][:, :3]).any(axis=1).mean()) if both.any() else 1.0
    return max(abs(x - round(x)), abs(y - round(y)), grows), differing


def _run(*words: object) -> None:
    if photomap([str(w) for w in words]) != 0:
        raise RuntimeError(f"photomap {' '.join(map(str, words))} failed")


def _one(name: str, value: float, bar: Bar | None = None) -> Figure:
    return Figure(name, Interval(value, value, value), 1, "", bar)
