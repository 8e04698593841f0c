"""A survey as a picture: area, no-fly zones, how often the ground is sure to be seen, the path, what is left out."""

from __future__ import annotations

import io
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from shapely.geometry.base import BaseGeometry

from photomap_gis.mission_planner.proof import counted_shots, footprints
from photomap_gis.mission_planner.survey import Survey

ToPixels = Callable[[npt.ArrayLike], list[tuple[float, float]]]

SIZE_PX = 1100
_MARGIN_PX, _HEAD_PX = 40, 70
_MOST_PRINTS = 30_000
_PATH, _FIRST, _GAP, _ZONE = (25, 25, 25), (20, 120, 40), (220, 0, 160), (200, 40, 40)


def survey_picture(survey: Survey) -> bytes:
    """Return a PNG, north up, with a scale bar; colours say how many pictures are sure to hold a spot."""
    frame = survey.area.frame
    paths = [frame.to_xy([(w.lat_deg, w.lon_deg) for w in sortie.waypoints]) for sortie in survey.plan.sorties]
    points = np.concatenate([shapely.get_coordinates(survey.area.area), *paths])
    low, high = points.min(axis=0), points.max(axis=0)
    span = float(max(*(high - low), 1.0))
    m_per_px = span / (SIZE_PX - 2 * _MARGIN_PX)
    width, height = (int(v) for v in np.ceil((high - low) / m_per_px) + 2 * _MARGIN_PX)
    width = max(width, 640)

    def px(xy: npt.ArrayLike) -> list[tuple[float, float]]:
        p = np.atleast_2d(np.asarray(xy, np.float64))
        column = (p[:, 0] - low[0]) / m_per_px + _MARGIN_PX
        row = (high[1] - p[:, 1]) / m_per_px + _MARGIN_PX + _HEAD_PX
        return list(zip(column.tolist(), row.tolist(), strict=True))

    picture = _overlap(survey, px, (width, height + _HEAD_PX))
    draw = ImageDraw.Draw(picture)
    _outline(draw, px, survey.area.area, (40, 70, 160), 2)
    for zone in shapely.get_parts(survey.area.avoid):
        draw.polygon(px(zone.exterior.coords), fill=(250, 215, 215), outline=_ZONE, width=2)
    for path in paths:
        draw.line(px(path), fill=_PATH, width=1)
    for gap in shapely.get_parts(survey.left):
        draw.polygon(px(gap.exterior.coords), fill=_GAP)
        x, y = px(gap.representative_point().coords)[0]
        draw.ellipse((x - 8, y - 8, x + 8, y + 8), outline=_GAP, width=2)
    for path in paths:
        x, y = px(path[0])[0]
        draw.polygon([(x, y - 9), (x - 7, y + 6), (x + 7, y + 6)], fill=_FIRST)
    _words(draw, survey, m_per_px, height + _HEAD_PX)
    out = io.BytesIO()
    picture.save(out, "PNG")
    return out.getvalue()


def _overlap(survey: Survey, px: ToPixels, size: tuple[int, int]) -> Image.Image:
    """The ground in blues by how many pictures are sure to hold it, white outside the area."""
    count = np.zeros((size[1], size[0]), np.int32)
    xy, heading = counted_shots(survey.lanes, survey.spacing)
    every = max(1, math.ceil(len(xy) / _MOST_PRINTS))
    for polygon in footprints(xy[::every], heading[::every], survey.sure):
        ring = np.array(px(polygon.exterior.coords))
        left, top = np.floor(ring.min(axis=0)).astype(int)
        right, bottom = np.ceil(ring.max(axis=0)).astype(int) + 1
        left, top, right, bottom = max(left, 0), max(top, 0), min(right, size[0]), min(bottom, size[1])
        if right <= left or bottom <= top:
            continue
        stamp = Image.new("1", (right - left, bottom - top))
        ImageDraw.Draw(stamp).polygon([(x - left, y - top) for x, y in ring], fill=1)
        count[top:bottom, left:right] += np.asarray(stamp, np.int32)
    inside = Image.new("1", size)
    draw = ImageDraw.Draw(inside)
    for part in shapely.get_parts(survey.area.target):
        draw.polygon(px(part.exterior.coords), fill=1)
        for hole in part.interiors:
            draw.polygon(px(hole.coords), fill=0)
    share = np.clip(count / max(np.percentile(count[count > 0], 90) if (count > 0).any() else 1, 1), 0.0, 1.0)
    colour = np.stack([225 - 125 * share, 238 - 68 * share, 250 - 30 * share], axis=-1)
    grey = np.where((count > 0)[..., None], 240.0, 255.0) * np.ones(3)
    return Image.fromarray(np.where(np.asarray(inside)[..., None], colour, grey).astype(np.uint8))


def _outline(
    draw: ImageDraw.ImageDraw, px: ToPixels, geometry: BaseGeometry, colour: tuple[int, int, int], width: int
) -> None:
    for part in shapely.get_parts(geometry):
        for ring in (part.exterior, *part.interiors):
            draw.line(px(ring.coords), fill=colour, width=width)


def _words(draw: ImageDraw.ImageDraw, survey: Survey, m_per_px: float, bottom: int) -> None:
    plan = survey.plan
    seconds = sum(s.duration_s for s in plan.sorties)
    draw.text(
        (_MARGIN_PX, 14),
        f"{plan.pattern}: {100 * plan.covered_share:.2f} % sure to be seen, {100 * plan.gsd_m_per_px:.2f} cm/px, "
        f"{sum(s.photos for s in plan.sorties)} pictures, {seconds / 60:.0f} min in {len(plan.sorties)} sorties",
        fill=_PATH, font_size=17,
    )  # fmt: skip
    draw.text(
        (_MARGIN_PX, 40), "darker blue: seen in more pictures; green: take-off; red: no-fly; magenta: not seen",
        fill=(90, 90, 90), font_size=14,
    )  # fmt: skip
    bar = 10.0 ** math.floor(math.log10(m_per_px * 220))
    bar = max(b for b in (bar, 2 * bar, 5 * bar) if b <= m_per_px * 260)
    y = bottom - 16
    draw.line([(_MARGIN_PX, y), (_MARGIN_PX + bar / m_per_px, y)], fill=_PATH, width=3)
    draw.text((_MARGIN_PX + bar / m_per_px + 8, y - 9), f"{bar:g} m, north is up", fill=_PATH, font_size=14)
