"""Frames looked for in a reference: places chosen, drawn at its pixels, registered, and their ties compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.grid import MapFrame, MapGrid
from photomap_gis.core.measurement import Registration
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray, transform_jacobian
from photomap_gis.core.tie import ReferenceTie
from photomap_gis.reference.agree import agreeing
from photomap_gis.reference.draw import ReadGrey, draw_patch
from photomap_gis.reference.imagery import Patch, ReferenceImage
from photomap_gis.reference.pictures import Look, seen_as

SMALL_PX = 200
"""A frame whose shorter side is less than this on the reference is drawn together with its neighbours."""
TOGETHER_PX = 288
LARGEST_PX = 480
"""Longer sides of a place are compared at coarser pixels than the reference's."""
NEIGHBOURS = 12
MIN_SEEN = 0.25
"""Share of a place that both must show."""
CONFIDENT, WEAK = 0.9, 0.3
"""Probability from which a tie speaks for itself, and from which it may join others."""
FLOOR_PX = 0.3
"""No tie is believed beyond this: other seasons' edges lie beside each other, other sensors' too."""
MISFIT_PX = 2.0
"""How far a place may be off beyond its sigma before ties disagree: what relief and tilt leave in a frame."""
SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Expected:
    """How far the reference may lie off the drawing: one-sigmas, per axis in pixels; ``features`` as a last resort."""

    sigma_xy_px: float
    sigma_angle_rad: float
    sigma_log_scale: float
    features: bool = True


class Register(Protocol):
    """What the corridor lends: the motion of a drawing's pixels into the reference's, near the identity."""

    def __call__(self, reference: Patch, drawn: Patch, expected: Expected) -> Registration:
        """Return ``T_reference_drawn`` with covariance and probability."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A frame to be looked for, the grid on which it is compared, and the frames that are drawn with it."""

    frame: FramePlacement
    grid: MapGrid
    together: tuple[FramePlacement, ...]
    expected: Expected


def places_of(
    placements: Sequence[FramePlacement], map_frame: MapFrame, *, gsd_m: float, budget: int, widen: float = 1.0
) -> list[Place]:
    """Return places to compare, spread over the map: each next one as far as can be from those before it.

    ``gsd_m`` is the reference's pixel; ``widen`` stretches the predicted sigmas.
    """
    usable = [p for p in placements if p.status in (FrameStatus.REGISTERED, FrameStatus.GPS_ONLY)]
    # A frame that registrations hold tells of the map; one that only its fix holds tells of itself alone.
    usable = [p for p in usable if p.status is FrameStatus.REGISTERED] or usable
    if not usable or map_frame.crs_wkt is None:
        return []
    centres = np.array([p.centre_xy_map_m for p in usable])
    order = spread_out(centres, budget)
    return [_place(usable[k], usable, centres, map_frame, gsd_m, widen) for k in order]


def spread_out(points: FloatArray, count: int) -> list[int]:
    """Return up to ``count`` indices of ``(N, 2)`` points, each next one farthest from those taken already.

    >>> spread_out(np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 0.0]]), 2)
    [1, 2]
    """
    first = int(np.argmin(np.hypot(*(points - np.median(points, axis=0)).T)))
    taken = [first]
    distance = np.hypot(*(points - points[first]).T)
    while len(taken) < min(count, len(points)):
        k = int(np.argmax(distance))
        if distance[k] <= 0.0:
            break
        taken.append(k)
        distance = np.minimum(distance, np.hypot(*(points - points[k]).T))
    return taken


def find_ties(
    places: Sequence[Place],
    reference: ReferenceImage,
    map_frame: MapFrame,
    read_grey: ReadGrey,
    register: Register,
    *,
    on_done: Callable[[int, int], None] = lambda done, total: None,
) -> list[ReferenceTie]:
    """Return a tie for every place that could be compared with some success; whether they agree is not asked yet."""
    found = []
    for k, place in enumerate(places):
        try:
            tie = tie_of(place, reference, map_frame, read_grey, register)
        except FrameReadError:  # costs this place only
            tie = None
        if tie is not None:
            found.append(tie)
        on_done(k + 1, len(places))
    return found


def tie_of(
    place: Place, reference: ReferenceImage, map_frame: MapFrame, read_grey: ReadGrey, register: Register
) -> ReferenceTie | None:
    """Return what the reference says of a place; ``None`` where it shows too little or nothing fits."""
    old = reference.read(place.grid)
    if old.share_seen < MIN_SEEN:
        return None
    alone = draw_patch([place.frame], map_frame, place.grid, read_grey)
    drawn = alone if len(place.together) < 2 else draw_patch(place.together, map_frame, place.grid, read_grey)
    if float((drawn.mask & old.mask).mean()) < MIN_SEEN:
        return None
    best, how = None, Look.GRADIENT
    for look in Look:
        expected = replace(place.expected, features=look is Look.GRADIENT)
        r = register(seen_as(old, look), seen_as(drawn, look), expected)
        if best is None or r.probability > best.probability:
            best, how = r, look
        if best.accepted:
            break
    if best is None or best.probability < WEAK:
        return None
    return _tie(place, map_frame, best, how, alone.mask & old.mask)


def agreed(ties: Sequence[ReferenceTie], placements: Sequence[FramePlacement], gsd_m: float) -> list[ReferenceTie]:
    """Return the ties, each told whether it agrees with the others."""
    where = {p.frame: p for p in placements}
    predicted = [where[t.frame].camera_to_map.project(np.array(t.xy_px)).mean(axis=0) for t in ties]
    measured = [np.mean(t.xy_map_m, axis=0) for t in ties]
    tolerance = [MISFIT_PX * gsd_m + SIGMAS * t.sigma_m / math.sqrt(len(t.xy_px)) for t in ties]
    weight = [1.0 if t.probability >= CONFIDENT else 0.3 * t.probability for t in ties]
    kept = agreeing(predicted, measured, tolerance, weight)
    return [replace(t, kept=bool(k)) for t, k in zip(ties, kept, strict=True)]


def _place(
    p: FramePlacement,
    usable: Sequence[FramePlacement],
    centres: FloatArray,
    map_frame: MapFrame,
    gsd_m: float,
    widen: float,
) -> Place:
    outline = p.outline_xy_map_m()
    low, high = outline.min(axis=0), outline.max(axis=0)
    middle, size_m = (low + high) / 2.0, high - low
    pixel = max(gsd_m, p.gsd_m_per_px)
    together: tuple[FramePlacement, ...] = (p,)
    if float(size_m.min()) / pixel < SMALL_PX:
        size_m = np.maximum(size_m, TOGETHER_PX * pixel)
        distance = np.hypot(*(centres - p.centre_xy_map_m).T)
        near = [usable[k] for k in np.argsort(distance, kind="stable") if usable[k].frame != p.frame]
        together = (p, *near[:NEIGHBOURS])
    sigma_m = math.sqrt(float(np.linalg.eigvalsh(p.position_covariance_m2()[0]).max())) * widen
    # The reference must show what lies beside the frame's predicted place too.
    size_m = size_m + 2.0 * min(2.0 * sigma_m, 0.25 * float(size_m.max()))
    pixel = max(pixel, float(size_m.max()) / LARGEST_PX)
    width, height = (max(32, math.ceil(v / pixel)) for v in size_m)
    west, north = map_frame.to_crs((middle - size_m / 2.0)[None])[0]
    # Whole pixels of the reference's size keep a north-up reference of the same CRS from being resampled twice.
    west, north = math.floor(west / pixel) * pixel, math.ceil(north / pixel) * pixel
    grid = MapGrid(map_frame.crs_wkt, west, north, pixel, width, height)
    turn, growth = (math.sqrt(max(float(p.pose_covariance[k, k]), 0.0)) * widen for k in (2, 3))
    return Place(
        p, grid, together, Expected(max(sigma_m / pixel, 3.0), min(max(turn, 0.015), 0.3), min(max(growth, 0.015), 0.2))
    )


def _tie(
    place: Place, map_frame: MapFrame, r: Registration, look: Look, seen: npt.NDArray[np.bool_]
) -> ReferenceTie | None:
    """Return four points of the frame, about the middle of what both show of it, with the registration's word."""
    points = _four_points(seen)
    if points is None:
        return None
    drawn = map_frame.from_crs(place.grid.to_crs(points))
    measured = map_frame.from_crs(place.grid.to_crs(r.T_a_b.apply(points)))
    xy_px = place.frame.camera_to_map.unproject(drawn)
    if not np.isfinite(xy_px).all():
        return None
    centre = points.mean(axis=0) - (np.array(r.size_b_px) - 1.0) / 2.0
    jacobian = transform_jacobian(replace(r.T_a_b, tx=0.0, ty=0.0), centre)[0]
    shift_px2 = float(np.trace(jacobian @ r.covariance @ jacobian.T)) / 2.0 + r.model_sigma_px**2 + FLOOR_PX**2
    # Four points that are each twice as uncertain as their mean hold the shift as well as it was measured, and turn
    # and scale as well as a shift over half the frame does.
    sigma_m = 2.0 * math.sqrt(shift_px2) * place.grid.pixel_size
    return ReferenceTie(
        place.frame.frame, _pairs(xy_px), _pairs(measured), sigma_m, float(r.probability), f"{r.method} on {look}"
    )


def _four_points(seen: npt.NDArray[np.bool_]) -> FloatArray | None:
    """``(4, 2)`` pixels half way from the middle of what is seen to its ends; ``None`` where hardly anything is."""
    rows, cols = np.nonzero(seen)
    if len(rows) < 400:
        return None
    # One sigma of an evenly seen box is 0.58 of half its side.
    x, y, dx, dy = cols.mean(), rows.mean(), cols.std(), rows.std()
    return np.array([[x - dx, y - dy], [x + dx, y - dy], [x + dx, y + dy], [x - dx, y + dy]], np.float64)


def _pairs(points: FloatArray) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in points)
