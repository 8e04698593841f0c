"""``photomap simulate GROUND``: from a word or a path to a flight in a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from photomap_gis.simulate.flight import required_size_m
from photomap_gis.simulate.geodesy import DEFAULT_ORIGIN_LAT_LON
from photomap_gis.simulate.ground import Ground, load_ground
from photomap_gis.simulate.scene import procedural_scene
from photomap_gis.simulate.spec import FlightSpec
from photomap_gis.simulate.truth import Truth
from photomap_gis.simulate.write import PHOTO_FOLDER, VIDEO_FOLDER, Progress, simulate_photos, simulate_video

PROCEDURAL = "procedural"


@dataclass(frozen=True, slots=True, eq=False)
class SimulationResult:
    """Where a simulation lies: ``source`` is what ``photomap map`` takes, ``truth`` what the evaluation takes."""

    source: Path
    truth: Truth


def run_simulation(
    ground: str | Path,
    out_dir: Path | str,
    spec: FlightSpec | None = None,
    *,
    video: bool = False,
    pixel_size_m: float | None = None,
    origin_lat_lon: tuple[float, float] = DEFAULT_ORIGIN_LAT_LON,
    height_path: Path | str | None = None,
    on_progress: Progress | None = None,
) -> SimulationResult:
    """Simulate a flight over a picture, a GeoTIFF, or the word ``procedural``, into a folder.

    A procedural scene is made as large as the flight needs (at 100 m where the spec gives no altitude), its pixels a
    little finer than the frames'.
    """
    spec = spec or FlightSpec()
    where = resolve_ground(
        ground, spec, video=video, pixel_size_m=pixel_size_m, origin_lat_lon=origin_lat_lon, height_path=height_path
    )
    simulate = simulate_video if video else simulate_photos
    truth = simulate(where, spec, out_dir, on_progress=on_progress)
    return SimulationResult(Path(out_dir) / (VIDEO_FOLDER if video else PHOTO_FOLDER), truth)


def resolve_ground(
    ground: str | Path,
    spec: FlightSpec,
    *,
    video: bool,
    pixel_size_m: float | None = None,
    origin_lat_lon: tuple[float, float] = DEFAULT_ORIGIN_LAT_LON,
    height_path: Path | str | None = None,
) -> Ground:
    """Return the ground that a word or a path means."""
    if str(ground) != PROCEDURAL:
        return load_ground(ground, pixel_size_m=pixel_size_m, origin_lat_lon=origin_lat_lon, height_path=height_path)
    size = required_size_m(spec, video=video)
    altitude = spec.altitude_m or 100.0
    gsd = altitude / (spec.camera.focal_px or 1.0)
    # finer than the frames, yet never more than some 60 megapixels
    pixel = max(pixel_size_m or 0.9 * gsd, (size[0] * size[1] / 60e6) ** 0.5)
    side = (size[0] + 4.0, size[1] + 4.0)
    return procedural_scene(side, pixel, spec.seed, origin_lat_lon=origin_lat_lon)
