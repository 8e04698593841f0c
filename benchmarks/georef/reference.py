"""A map laid on existing imagery of another season: how far it is off, in pixels of that imagery, and by GPS alone.

Each flight is mapped by its GPS, judged, laid on the reference and judged again. The reference shows the same ground at
another hour of another season: what grows has its contrast turned over, light and colours differ, a part of the
ground is built upon or grown over. Its pixels are 3 to 5 times the flight's. The GPS is biased by metres besides its
drift.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photomap_gis.pipeline import MapSummary, map_flight, reference_mission
from photomap_gis.simulate import FlightSpec, GpsError, Ground, Motion, load_ground, procedural_scene, simulate_photos
from photomap_gis.simulate.evaluate import MapErrors, evaluate_map
from photomap_gis.simulate.flight import required_size_m
from photomap_gis.simulate.season import Season, another_season, write_reference

from ..registration.report import Bar, Figure, Section, Table
from ..registration.score import Interval
from .options import Options

YELLOWSTONE = (
    Path(__file__).resolve().parents[3] / "shared/data/ortho_yellowstone/2019_YELL_2_528000_4978000_image_crop2.png"
)
RATIOS = (3.0, 4.0, 5.0)
MAX_RMSE_GSD = 2.0
CHANCE_2D = 1.1774
"""Median length of a two-dimensional normal error of sigma 1."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A flight's map by GPS alone and by the reference, with what the product said of it."""

    ground: str
    seed: int
    reference_gsd_m: float
    by_gps: MapErrors
    by_reference: MapErrors
    summary: MapSummary

    @property
    def rmse_gsd(self) -> float:
        """Absolute RMSE in pixels of the reference."""
        return self.by_reference.absolute_rmse_m / self.reference_gsd_m

    @property
    def gps_rmse_gsd(self) -> float:
        """The same by GPS alone."""
        return self.by_gps.absolute_rmse_m / self.reference_gsd_m


def measure(options: Options) -> Section:
    """Return the errors of all flights, and the worst of them against the bar."""
    names = ["procedural", *(["yellowstone"] if YELLOWSTONE.is_file() else [])]
    notes = [] if YELLOWSTONE.is_file() else ["left out: yellowstone (../shared/data is absent)"]
    rows = []
    for name in names:
        for seed in options.seeds:
            rows.append(judge(name, seed, options.folder / f"{name}-{seed}"))
            options.tell(f"{name} {seed}: {rows[-1].rmse_gsd:.2f} GSD of the reference, "
                         f"{rows[-1].gps_rmse_gsd:.2f} by GPS")  # fmt: skip
    figures = []
    for name in names:
        mine = [r for r in rows if r.ground == name]
        for word, values, bar in (
            ("worst by the reference", [r.rmse_gsd for r in mine], Bar(high=MAX_RMSE_GSD)),
            ("worst by GPS alone", [r.gps_rmse_gsd for r in mine], None),
        ):
            worst = max(values)
            figures.append(Figure(f"{name}: absolute RMSE, {word} (GSD of the reference)",
                                  Interval(worst, min(values), worst), len(values), "", bar))  # fmt: skip
    table = Table(
        "flights",
        ("ground", "seed", "reference pixel m", "by GPS m", "by reference m", "GSD", "relative m", "CE90 predicted m",
         "CE90 found m", "ties"),
        tuple(_cells(r) for r in rows),
    )  # fmt: skip
    notes.append("the interval is the range over the seeds")
    data = {"flights": [{"ground": r.ground, "seed": r.seed, "rmse_gsd": r.rmse_gsd} for r in rows]}
    return Section("reference", tuple(figures), (table,), tuple(notes), data)


def judge(ground: str, seed: int, folder: Path) -> Judged:
    """Fly, map by GPS, lay on the reference, and judge both maps."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    now, old, spec = grounds(ground, seed)
    truth = simulate_photos(now, spec, folder)
    gsd_m = truth.gsd_m_per_px * RATIOS[seed % len(RATIOS)]
    write_reference(old, folder / "reference.tif", gsd_m=gsd_m)
    mission = folder / "mission"
    by_gps = evaluate_map(map_flight([folder / "photos"], mission).map, folder)
    shutil.copyfile(mission / "map.tif", folder / "by-gps.tif")
    summary = reference_mission(mission, [folder / "reference.tif"])
    return Judged(ground, seed, gsd_m, by_gps, evaluate_map(summary.map, folder), summary)


def grounds(ground: str, seed: int) -> tuple[Ground, Ground, FlightSpec]:
    """Return the ground that is flown over, the ground of the reference, and the flight."""
    rng = np.random.default_rng([seed, 0x6E0])
    bias = rng.uniform(1.5, 3.5) * np.exp(1j * rng.uniform(0, 2 * np.pi))
    spec = FlightSpec(
        frames=30, altitude_m=80.0, width_px=1000, height_px=750, motion=Motion(tilt_deg=1.0), seed=seed,
        gps=GpsError(bias_east_m=float(bias.real), bias_north_m=float(bias.imag)),
    )  # fmt: skip
    season = Season(seed=seed)
    if ground == "yellowstone":
        now = load_ground(YELLOWSTONE)
        # The picture is 230 m wide: the flight takes what height its frames need to fill it.
        return now, another_season(now, season), replace(spec, altitude_m=None)
    size = required_size_m(spec, video=False)
    side = (size[0] + 4.0, size[1] + 4.0)
    hour = float(rng.choice([90.0, 270.0]))
    now, then = (procedural_scene(side, 0.12, seed, sun_azimuth_deg=sun) for sun in (None, hour))
    return now, another_season(then, season), spec


def _cells(r: Judged) -> tuple[str, ...]:
    s = r.summary.references[0]
    found_ce90 = r.by_reference.absolute_median_m / CHANCE_2D * 2.146
    return (
        r.ground, str(r.seed), f"{r.reference_gsd_m:.3f}", f"{r.by_gps.absolute_rmse_m:.2f}",
        f"{r.by_reference.absolute_rmse_m:.3f}", f"{r.rmse_gsd:.2f}", f"{r.by_reference.relative_rmse_m:.3f}",
        f"{r.summary.predicted_ce90_m:.2f}", f"{found_ce90:.2f}", f"{s.ties}/{s.places}",
    )  # fmt: skip
