"""Ground control in the corridor: from points and pictures to observations, and what the solved map makes of them."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from photomap_gis.core.accuracy import CheckedAccuracy, PointMiss, checked_accuracy
from photomap_gis.core.camera import PlaneView
from photomap_gis.core.control import ControlPoint, Nudge, Sighting, check_names
from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.core.frame import FrameRef, GpsFix
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.placement import PlanePlacement, PosedPlacement
from photomap_gis.core.posegraph import PointObservation, Trajectory
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.georef import UNKNOWN_TILT_RAD, choose_map_frame, crs_to_lonlat, fix_to_map
from photomap_gis.ingest.control import read_control
from photomap_gis.store import ControlRecord, Mission

FAR_M = 20_000.0
"""Control points that lie further from the flight are of another place, or their axes are swapped."""
MISSED = 2.0
"""By what factor a solution may miss its control points beyond what it says."""
DISAGREE_SIGMA = 4.0
"""Sigmas that two pictures of a check point may lie apart on the map."""
SEEN_LEVEL_RAD = math.radians(0.5)
"""How far a camera may lean without its pictures' pairs telling it."""


@dataclass(frozen=True, slots=True)
class ControlRequest:
    """What a user says of ground control: the file, the CRS of a table without one, and which points are for the check.

    ``check`` of ``None`` leaves it as it is in the mission.
    """

    file: Path | None = None
    crs: str | None = None
    check: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class ControlResult:
    """What became of one point: ``check`` points had no part in the fit, others not ``used`` were put aside."""

    miss: PointMiss
    check: bool
    used: bool


def checked(results: Iterable[ControlResult]) -> CheckedAccuracy | None:
    """Return the accuracy by the check points among the results."""
    return checked_accuracy([r.miss for r in results if r.check])


def residual_rms_m(results: Iterable[ControlResult]) -> float | None:
    """Return the RMS distance of the points that were used, to the map: a residual of the fit, never an accuracy."""
    squares = [r.miss.miss_m**2 for r in results if r.used and not r.check]
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def read_request(request: ControlRequest | None) -> tuple[str, tuple[ControlPoint, ...]] | None:
    """Return text and points of the file that is asked for; asked first, so that nobody waits for an error."""
    if request is None or request.file is None:
        return None
    text, points = read_control(request.file, crs=request.crs)
    check_names([p.name for p in points], request.check or ())
    _lonlat(points, request.file.name)
    return text, points


def keep_request(mission: Mission, request: ControlRequest | None, frames: Sequence[FrameRef], crs: str | None) -> None:
    """Keep the ground control that is asked for in the mission and place its map by all that it then has.

    What is not asked for stays. Where it cannot be used, the mission stays as it is.
    """
    kept, text = mission.load_control(), None
    read = read_request(request)
    if read is not None and request is not None and request.file is not None:
        text, points = read
        kept = replace(kept, points=points, source=request.file.name, check=request.check or ())
        _check_pictures(kept, frames)
    elif request is not None and request.check is not None:
        if not kept.points:
            raise UsageError("--check needs control points: give them by --gcp FILE")
        kept = replace(kept, check=request.check)
    keep_control(mission, kept, frames, crs, text=text)


def keep_control(
    mission: Mission, control: ControlRecord, frames: Sequence[FrameRef], crs: str | None, *, text: str | None = None
) -> None:
    """Place a mission's map by this ground control, and keep it; ``text`` is the file that it was read from."""
    place_map(mission, control, frames, crs)
    if control != mission.load_control() or text is not None:
        mission.save_control(control, text)


def checks_of(control: ControlRecord) -> frozenset[str]:
    """Return the names of the points and picks that test the map and have no part in its fit."""
    return check_names([p.name for p in control.points], control.check) | frozenset(control.check_picks)


def place_map(mission: Mission, control: ControlRecord, frames: Sequence[FrameRef], crs: str | None) -> None:
    """Give a mission without positions the place on Earth that two or more control points or picks tell.

    ``DataError`` where the points lie far from where the flight was.
    """
    checks = checks_of(control)
    pictures = _Pictures(frames)
    used = [p for p in (*control.points, *control.picks) if p.name not in checks and pictures.of(p)]
    places = [GpsFix(float(lat), float(lon)) for lon, lat in _lonlat(used, control.source)] if used else []
    fixes = [f.fix for f in frames if f.fix is not None]
    header = mission.header
    if fixes:
        if used and header.map_frame.crs_wkt is not None:
            points, seen = (
                np.median(fix_to_map(header.map_frame, [f.lat_deg for f in at], [f.lon_deg for f in at]), axis=0)
                for at in (places, fixes)
            )
            far = float(np.hypot(*(points - seen)))
            if not far < FAR_M:
                raise DataError(
                    f"the control points lie {far / 1000:.0f} km from the flight: is the CRS right, "
                    "and is x east and y north?"
                )
        return
    if header.map_frame.crs_wkt is not None and any(r.kept for r in mission.references):
        return  # existing imagery has placed it, and its ties are told in that frame
    map_frame = choose_map_frame(places, crs) if len(places) >= 2 else MapFrame(None)
    if map_frame != header.map_frame:
        mission.save_header(replace(header, map_frame=map_frame))


def control_observations(
    control: ControlRecord,
    frames: Sequence[FrameRef],
    views: Mapping[int, PlaneView],
    map_frame: MapFrame,
    seen_level: Iterable[int] = (),
) -> tuple[list[PointObservation], list[str]]:
    """Return the points as seen in the frames, and what is to be said about those that cannot be used.

    ``views`` are those whose planes the graph's edges are between. Frames ``seen_level`` had their lean told by their
    registrations; of others a point off the middle is as uncertain as the lean that they may have makes it.
    """
    checks = checks_of(control)
    level = set(seen_level)
    found: list[PointObservation] = []
    words: list[str] = []
    points = (*control.points, *control.picks)
    if not points:
        return found, words
    pictures, lonlat = _Pictures(frames), _lonlat(points, control.source)
    places = fix_to_map(map_frame, lonlat[:, 1], lonlat[:, 0])
    for point, place in zip(points, places, strict=True):
        before = len(found)
        for ref, sighting in pictures.of(point):
            xy_px = sighting.xy_px
            if not (-0.5 <= xy_px[0] <= ref.width_px - 0.5 and -0.5 <= xy_px[1] <= ref.height_px - 0.5):
                words.append(
                    f"control point {point.name} is marked outside {ref.name} ({xy_px[0]:g}, {xy_px[1]:g} in "
                    f"{ref.width_px} x {ref.height_px} pixels): were its pixels measured in a picture of another size?"
                )
                continue
            view = views[ref.index]
            xy_plane = view.to_plane(np.array([xy_px]))[0]
            focal = view.camera.focal_px or float(max(ref.width_px, ref.height_px))
            reported = ref.attitude is not None and view.camera.focal_px is not None
            lean = ref.attitude.sigma_tilt_rad if ref.attitude is not None and reported else UNKNOWN_TILT_RAD
            lean = min(lean, SEEN_LEVEL_RAD) if ref.index in level else lean
            # At the middle a lean moves the whole picture; off the middle it also bends it, by r^2 / f.
            bend = math.tan(lean) * float(xy_plane @ xy_plane) / focal
            found.append(
                PointObservation(
                    ref.index, np.array(xy_px), xy_plane, place, np.eye(2) * point.sigma_m**2,
                    math.hypot(sighting.sigma_px, bend), point.name, point.name in checks, bend_px=bend,
                )
            )  # fmt: skip
        if len(found) == before:
            words.append(f"control point {point.name} is in no picture of the map that could be used")
    return found, words


def judge_points(
    points: Sequence[PointObservation], rejected: Iterable[int], trajectory: Trajectory
) -> tuple[ControlResult, ...]:
    """Return what the placed frames make of each point, in the points' order."""
    aside = set(rejected)
    placed = {p.frame: p for p in trajectory.placements}
    by_name: defaultdict[str, list[int]] = defaultdict(list)
    for k, o in enumerate(points):
        if o.frame in placed:
            by_name[o.name].append(k)
    results = []
    for name, rows in by_name.items():
        used = [k for k in rows if k not in aside]

        def off_middle(k: int) -> float:
            p = placed[points[k].frame]
            return float(np.abs((points[k].xy_px - p.centre_xy_px[0]) / (p.width_px, p.height_px)).max())

        o = points[min(used or rows, key=off_middle)]
        p = placed[o.frame]
        d = p.camera_to_map.project(o.xy_px[None])[0] - o.xy_map_m
        if not np.isfinite(d).all():
            continue
        picture = (o.sigma_px * p.gsd_m_per_px) ** 2
        covariance = p.position_covariance_m2(o.xy_px[None])[0] + o.covariance_m2 + picture * np.eye(2)
        sigma, d2 = math.sqrt(float(np.trace(covariance)) / 2.0), float(d @ np.linalg.solve(covariance, d))
        miss = PointMiss(name, float(d[0]), -float(d[1]), sigma, d2, len(rows))
        results.append(ControlResult(miss, o.check, bool(used) and not o.check))
    return tuple(results)


def misses_its_points(results: Sequence[ControlResult], others: Sequence[ControlResult]) -> bool:
    """Whether a solution misses the points of its fit by more than it says, and by more than another one does."""
    own, other = residual_rms_m(results), residual_rms_m(others)
    if own is None or other is None:
        return False
    told = [r.miss.sigma_m for r in results if r.used and not r.check]
    return own > MISSED * max(other, math.sqrt(2.0 * float(np.mean(np.square(told)))))


def words_on(
    results: Iterable[ControlResult],
    points: Sequence[PointObservation],
    rejected: Iterable[int],
    names: Mapping[int, str],
) -> list[str]:
    """Return what is to be said about points that were put aside; ``names`` are the frames' names."""
    found = []
    whole = {r.miss.name for r in results if not r.check and not r.used}
    for r in results:
        if r.miss.name in whole:
            found.append(
                f"control point {r.miss.name} misses the map by {r.miss.miss_m:.2f} m ({r.miss.east_m:+.2f} east, "
                f"{r.miss.north_m:+.2f} north) and was left out of the fit: check its coordinates and its pixels"
            )
    for k in rejected:
        o = points[k]
        if o.name not in whole:
            found.append(f"control point {o.name} as marked in {names[o.frame]} was left out: the others disagree")
    return found


def words_on_checks(points: Sequence[PointObservation], trajectory: Trajectory, names: Mapping[int, str]) -> list[str]:
    """Return what is to be said about check points that different pictures show at different places of the map."""
    placed = {p.frame: p for p in trajectory.placements}
    by_name: defaultdict[str, list[tuple[str, FloatArray, float]]] = defaultdict(list)
    for o in points:
        if o.check and (p := placed.get(o.frame)) is not None:
            at = p.camera_to_map.project(o.xy_px[None])[0]
            variance = np.trace(p.position_covariance_m2(o.xy_px[None])[0]) + 2.0 * (o.sigma_px * p.gsd_m_per_px) ** 2
            by_name[o.name].append((names[o.frame], at, float(variance)))
    found = []
    for name, seen in by_name.items():
        for (image, at, variance), (other, there, variance2) in combinations(seen, 2):
            apart = float(np.hypot(*(at - there)))
            if apart > DISAGREE_SIGMA * math.sqrt(variance + variance2):
                found.append(
                    f"check point {name} as marked in {image} and in {other} lies {apart:.2f} m apart on the map: "
                    "one of them is marked wrongly, and its miss tells nothing"
                )
    return found


def nudge_motion(nudges: Sequence[Nudge], map_frame: MapFrame) -> Similarity2D:
    """Return what the corrections by hand do to the internal map frame, the first one first."""
    whole = Similarity2D.identity()
    for n in nudges:
        pivot = fix_to_map(map_frame, [n.pivot_lat_deg], [n.pivot_lon_deg])[0]
        back, there = Similarity2D.translation_of(*-pivot), Similarity2D.translation_of(*pivot)
        turn = Similarity2D(n.east_m, -n.north_m, math.radians(n.clockwise_deg))
        whole = there @ turn @ back @ whole
    return whole


def moved(trajectory: Trajectory, motion: Similarity2D) -> Trajectory:
    """Return the trajectory with every frame, and the ground below, moved by a motion of the map."""
    grounds: dict[int, HeightField] = {}  # the frames share one
    out = []
    for p in trajectory.placements:
        where = p.camera_to_map
        if isinstance(where, PlanePlacement):  # its covariance is in the axes of the plane, and stays
            out.append(replace(p, camera_to_map=PlanePlacement(where.view, motion @ where.T_map_plane)))
            continue
        assert isinstance(where, PosedPlacement)
        if id(where.ground) not in grounds:
            grounds[id(where.ground)] = _moved_ground(where.ground, motion)
        ground = grounds[id(where.ground)]
        turn = np.eye(3)
        turn[:2, :2] = motion.linear / motion.scale
        x, y = motion.apply(where.centre_map[:2])
        centre = np.array([x, y, where.centre_map[2] * motion.scale])
        axes = np.zeros((6, 6))
        axes[:3, :3], axes[3:, 3:] = turn * motion.scale, turn
        posed = PosedPlacement(where.camera, centre, turn @ where.R_map_camera, ground)
        out.append(replace(p, camera_to_map=posed, pose_covariance=axes @ p.pose_covariance @ axes.T))
    return Trajectory(tuple(out), trajectory.revision)


def _moved_ground(ground: HeightField, motion: Similarity2D) -> HeightField:
    """Return the ground moved with the map: the lattice shifted, or a new one where the map turns."""
    sigma = ground.sigma * motion.scale
    if motion.angle_rad == 0.0 or ground.is_level:
        x, y = motion.apply(np.array(ground.origin_xy))
        return HeightField((float(x), float(y)), ground.cell * motion.scale, ground.up * motion.scale, sigma)
    rows, columns = ground.up.shape
    corners = np.array([[0, 0], [columns - 1, 0], [0, rows - 1], [columns - 1, rows - 1]]) * ground.cell
    reached = motion.apply(corners + ground.origin_xy)
    cell, low = ground.cell * motion.scale, reached.min(axis=0)
    columns, rows = (np.ceil((reached.max(axis=0) - low) / cell).astype(int) + 1).tolist()
    x, y = np.meshgrid(low[0] + cell * np.arange(columns), low[1] + cell * np.arange(rows))
    up = ground.at(motion.inverse().apply(np.stack([x, y], axis=-1))) * motion.scale
    return HeightField((float(low[0]), float(low[1])), cell, up, sigma)


def _lonlat(points: Sequence[ControlPoint], source: str) -> FloatArray:
    """``(N, 2)`` longitudes, latitudes of points, each in its own CRS; ``DataError`` where one has no place."""
    out = np.empty((len(points), 2))
    try:
        for crs in {p.crs for p in points}:
            rows = [k for k, p in enumerate(points) if p.crs == crs]
            out[rows] = crs_to_lonlat(crs, np.array([(points[k].x, points[k].y) for k in rows]))
    except UsageError as error:
        raise DataError(f"{source}: {error}") from error
    return out


class _Pictures:
    """A plan: the frames by what they may be called (own name, photo's file name, index), in any case of letters."""

    def __init__(self, frames: Sequence[FrameRef]) -> None:
        self._own = {f.name.lower(): f for f in frames} | {f"#{f.index}": f for f in frames}
        self._by_file: defaultdict[str, list[FrameRef]] = defaultdict(list)
        for f in frames:
            if f.frame_number is None:
                self._by_file[Path(f.source).name.lower()].append(f)

    def __getitem__(self, image: str) -> FrameRef | None:
        """Return the frame that a control file means; ``None`` where it is none, or one of several."""
        image = image.lower().lstrip("./")
        if image in self._own:
            return self._own[image]
        named = self._by_file.get(image.rsplit("/", 1)[-1], [])
        if len(named) > 1:  # two cards with a DJI_0001.JPG each: the folder tells
            named = [f for f in named if Path(f.source).as_posix().lower().endswith(f"/{image}")]
        return named[0] if len(named) == 1 else None

    def of(self, point: ControlPoint) -> list[tuple[FrameRef, Sighting]]:
        """Return where a point is seen."""
        return [(ref, s) for s in point.sightings if (ref := self[s.image]) is not None]


def _check_pictures(control: ControlRecord, frames: Sequence[FrameRef]) -> None:
    """Raise ``DataError`` where none of the pictures that a control file names is in the mission."""
    named = sorted({s.image for p in control.points for s in p.sightings})
    if not named:
        raise DataError(
            f"{control.source} does not say where its points are seen: it needs image, px and py; "
            "or pick them on the map by 'photomap georeference --pick'"
        )
    pictures = _Pictures(frames)
    if not any(pictures.of(p) for p in control.points):
        raise DataError(
            f"none of the pictures that {control.source} names ({', '.join(named[:3])}, ...) is in the mission "
            f"({', '.join(f.name for f in frames[:3])}, ...)"
        )
