"""What the page of a package says of a mission: gathered from its solution, its map, its logs and its finds."""

from __future__ import annotations

import io
import logging
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from photomap_gis import __version__
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import Window
from photomap_gis.export.crs import WGS84, point_map
from photomap_gis.export.finds import Find as FindPlace
from photomap_gis.export.finds import read_finds
from photomap_gis.export.poses import utc_text
from photomap_gis.export.warp import ground_pixel_m, overview
from photomap_gis.find_store import FINDS_FILE, SNAPSHOTS
from photomap_gis.ingest.telemetry import read_track
from photomap_gis.ingest.telemetry.modes import flies_by_itself
from photomap_gis.mosaic import TileStore
from photomap_gis.pipeline.solved import PASTED, Solved
from photomap_gis.pipeline.summary import control_lines
from photomap_gis.report import FlightTimes, MapPicture, Moment, PackedFile, Page, flight_times
from photomap_gis.report.page import Find
from photomap_gis.store import Mission

logger = logging.getLogger(__name__)

SNAPSHOT_M, SNAPSHOT_PX = 30.0, 400
MOST_FINDS_SHOWN = 24


def times_of(mission: Mission) -> tuple[tuple[FlightTimes, ...], str]:
    """Return the times of the flights whose log tells modes, and why there are none where there are none."""
    found, gone, logs = [], [], 0
    for flight in mission.flights:
        if flight.track_source is None:
            continue
        path = Path(flight.track_source)
        if not path.is_file():
            gone.append(path.name)
            continue
        logs += 1
        try:
            track = read_track(path)
        except DataError as error:
            logger.warning("%s", error)
            continue
        if not track.modes:
            continue
        span = [t for t in (track.start_s, track.end_s) if t is not None]
        moments = [Moment(p.time_s, p.height_m) for p in track.points]
        changes = [(m.time_s, flies_by_itself(m.name)) for m in track.modes]
        told = flight_times(flight.name, moments, changes, overall_s=max(span) - min(span) if span else 0.0)
        if told is not None:
            found.append(told)
    if gone:
        return tuple(found), f"Not known: the log {', '.join(sorted(set(gone)))} is no longer where it was."
    if logs:
        return tuple(found), "Not known: the log tells no flight modes."
    return tuple(found), "Not known: the pictures came without an autopilot's log."


def frame_numbers(solved: Solved) -> dict[str, Any]:
    """Return table 2: frames there are, used, error frames, and the connected pieces with their sizes."""
    counts = solved.count_by_status()
    sizes = [
        sum(p.segment == s and p.status is FrameStatus.REGISTERED for p in solved.trajectory.placements)
        for s in sorted({p.segment for p in solved.trajectory.placements if p.status is not FrameStatus.GPS_ONLY})
    ]
    return {
        "total": len(solved.frames),
        "used": sum(counts[s.value] for s in PASTED),
        "error_frames": counts[FrameStatus.ERROR_FRAME.value],
        "by_status": counts,
        "segments": solved.segments,
        "segment_frames": sorted(sizes, reverse=True),
    }


def page_of(
    folder: Path,
    solved: Solved,
    picture: MapPicture | None,
    times: tuple[FlightTimes, ...],
    why_not: str,
    snapshots: Sequence[Find],
    files: Sequence[PackedFile],
    lost: tuple[str, ...],
    gsd: float | None,
    shrink: float,
    sums_name: str,
) -> Page:
    """Return the page of a package; ``shrink`` is how many times coarser its map is than ``gsd`` (metres a pixel)."""
    stamps = [f.time_s for f in solved.frames if f.time_s is not None]
    facts = {"Mission": folder.absolute().name}
    if stamps:
        first, last = (str(utc_text(t))[:16].replace("T", " ") for t in (min(stamps), max(stamps)))
        facts["flown"] = f"{first} to {last[11:] if last[:10] == first[:10] else last} UTC"
    if gsd is not None:
        facts["pixel"] = f"{100 * gsd * shrink:.1f} cm"
        facts["CRS"] = str(solved.crs_name())
    n = frame_numbers(solved)
    largest = ", ".join(str(s) for s in n["segment_frames"][:6]) + (", ..." if len(n["segment_frames"]) > 6 else "")
    frames = {
        "frames of the flight": str(n["total"]),
        "used in the map": str(n["used"]),
        "error frames": str(n["error_frames"]),
        "placed by GPS alone": str(n["by_status"][FrameStatus.GPS_ONLY.value]),
        "not used (oblique or without a place)": str(
            n["by_status"][FrameStatus.OBLIQUE.value] + n["by_status"][FrameStatus.UNPLACED.value]
        ),
        "connected segments (frames in each)": f"{n['segments']} ({largest})" if largest else str(n["segments"]),
    }
    date = f" of {str(utc_text(max(stamps)))[:10]}" if stamps else ""
    return Page(
        f"Photo map{date}: {folder.absolute().name}", facts, picture, _accuracy_words(solved), times, why_not, frames,
        snapshots,
        [*files, PackedFile(sums_name, 80 * (len(files) + 1), f"SHA-256 of every file: sha256sum -c {sums_name}")],
        lost, solved.warnings, f"Made by photomap {__version__}. This page needs no network.",
    )  # fmt: skip


def _accuracy_words(solved: Solved) -> list[str]:
    """Return what is known of the accuracy, each number with what it means."""
    if not solved.georeferenced:
        return ["The map is NOT GEOREFERENCED: it has no place on Earth, its units are not metres, north is arbitrary."]
    lines = [" ".join(line.split()) for line in control_lines(solved.control)]
    checked = any(r.check for r in solved.control)
    if solved.predicted_ce90_m is not None:
        lines.append(
            f"Predicted CE90 {solved.predicted_ce90_m:.1f} m: nine of ten places on the map should lie nearer to where "
            "they are than this. " + ("" if checked else "It is a prediction; no check points have tested it.")
        )
    if solved.fit_to_gps_rms_m is not None:
        lines.append(f"Fit to GPS {solved.fit_to_gps_rms_m:.2f} m RMS: how well map and track agree, not the accuracy.")
    return lines or ["Nothing is known of the map's accuracy."]


def map_picture(store: TileStore, longest_px: int, *, georeferenced: bool) -> MapPicture:
    """Return the map as a picture whose longer side has about so many pixels, cut to what it shows."""
    g = store.grid
    factor = max(1, -(-max(g.width, g.height) // longest_px))
    small = overview(store, factor)
    rgba = small.read(Window(0, 0, small.grid.width, small.grid.height))
    seen = rgba[..., 3] >= 128
    rows, cols = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if len(rows):  # the grid may be wider than what it shows
        rgba = rgba[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    width_m = rgba.shape[1] * ground_pixel_m(small.grid) if georeferenced else None
    return MapPicture(_jpeg(rgba), width_m)


def _jpeg(rgba: np.ndarray) -> bytes:
    alpha = rgba[..., 3:].astype(np.float32) / 255.0
    white = rgba[..., :3] * alpha + 255.0 * (1.0 - alpha)
    out = io.BytesIO()
    Image.fromarray(np.rint(white).astype(np.uint8)).save(out, "JPEG", quality=82, optimize=True)
    return out.getvalue()


def finds_of(mission: Mission, solved: Solved) -> tuple[FindPlace, ...]:
    """Return what a mission with a place on Earth has of finds."""
    own = mission.folder / FINDS_FILE
    return read_finds(own, may_be_none=True) if own.is_file() and solved.georeferenced else ()


def write_finds(folder: Path, finds: Sequence[FindPlace], store: TileStore, base: Path) -> list[Find]:
    """Write the finds and a piece of the map around each; return them as the page shows them."""
    if not finds:
        return []
    (base / "finds").mkdir()
    shutil.copyfile(folder / FINDS_FILE, base / FINDS_FILE)
    for find in finds:  # what was seen when it was marked; the names are ours, the numbers in the file are not
        seen = folder / SNAPSHOTS / f"{find.id}.jpg"
        if find.id.replace("-", "").isalnum() and seen.is_file():
            shutil.copyfile(seen, base / "finds" / seen.name)
    g = store.grid
    lon_lat = np.array([(f.lon_deg, f.lat_deg) for f in finds])
    at = g.to_px(point_map(WGS84, str(g.crs_wkt), around_xy=lon_lat)(lon_lat))
    side = max(32, round(SNAPSHOT_M / ground_pixel_m(g)))
    shown = []
    for n, (find, (x, y)) in enumerate(zip(finds, at.tolist(), strict=True), start=1):
        picture = None
        if -side < x < g.width + side and -side < y < g.height + side:
            rgba = store.read(Window(round(x - side / 2), round(y - side / 2), side, side))
            if rgba[..., 3].any():
                small = np.asarray(Image.fromarray(rgba).resize((SNAPSHOT_PX, SNAPSHOT_PX), Image.Resampling.LANCZOS))
                picture = MapPicture(_jpeg(small), None)
                (base / "finds" / f"find-{n:03d}.jpg").write_bytes(picture.jpeg)
        sure = "" if find.ce90_m is None else f", CE90 {find.ce90_m:.1f} m"
        shown.append(Find(find.name, f"{find.lat_deg:.6f}, {find.lon_deg:.6f}{sure}", picture))
    return shown[:MOST_FINDS_SHOWN]
