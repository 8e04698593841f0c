"""The pose graph as a picture: the path of the sequential registrations alone beside the one with its loops.

Loops are coloured by how far they lie from the solution, in their own sigmas (the paper's Fig. 14 shows its rubble pile
so), the worst on top: a map that hangs together is all blue, a loop that pulls is red, one that the solver put aside is
a thin grey line.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import OutputError
from photomap_gis.core.posegraph import EdgeKind, Solution
from photomap_gis.core.similarity import FloatArray, fit_similarity
from photomap_gis.export.graph import SolvedGraph
from photomap_gis.export.publish import file_in_place_of

Canvas = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

PANEL_PX = 900
MARGIN_PX = 60
HEAD_PX, FOOT_PX = 70, 80
SUPERSAMPLE = 2
FULL_COLOUR_SIGMAS = 4.0
"""Residual from which a loop is drawn in the last colour."""
PULLS_SIGMAS = 2.0
"""Residual from which a loop is drawn over the path."""
PATH_COLOUR: Colour = (40, 40, 40)
ASIDE_COLOUR: Colour = (190, 190, 190)
TEXT_COLOUR: Colour = (30, 30, 30)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT = 4  # fractional bits of drawn coordinates


def write_graph_picture(solved: SolvedGraph, path: Path) -> None:
    """Write a PNG of two panels at one scale: sequential registrations alone, and with loops."""
    ok, data = cv2.imencode(".png", graph_picture(solved))
    if not ok:
        raise OutputError(f"{path} cannot be written: the picture could not be encoded")
    with file_in_place_of(path.absolute()) as temporary:
        temporary.write_bytes(data.tobytes())


def graph_picture(solved: SolvedGraph) -> Canvas:
    """``(H, W, 3)`` BGR picture of a solved graph."""
    after = _places(solved.solution)
    before = _laid_on(_places(solved.sequential), after)
    view = _View.of(np.array([*before.values(), *after.values()]).reshape(-1, 2))
    metres = solved.map_frame.crs_wkt is not None
    loops = [k for k, e in enumerate(solved.graph.edges) if e.kind is EdgeKind.LOOP]
    aside = len(set(solved.solution.rejected) & set(loops))
    left = _panel(view, solved, before, with_loops=False)
    right = _panel(view, solved, after, with_loops=True)
    _title(left, "before loops", f"{len(before)} frames, sequential registrations alone")
    _title(right, "after loops", f"{len(loops) - aside} loops, {aside} put aside")
    _scale_bar(left, view, "m" if metres else "px")
    _legend(right)
    gap = np.full((left.shape[0], 4 * SUPERSAMPLE, 3), 225, np.uint8)
    whole = np.concatenate([left, gap, right], axis=1)
    h, w = whole.shape[:2]
    return np.asarray(cv2.resize(whole, (w // SUPERSAMPLE, h // SUPERSAMPLE), interpolation=cv2.INTER_AREA))


class _View:
    """A plan: map units to canvas pixels, the same for both panels."""

    def __init__(self, low: FloatArray, px_per_unit: float, size: FloatArray) -> None:
        self.low, self.px_per_unit = low, px_per_unit
        self.size_px = (int(size[0]), int(size[1]))

    @classmethod
    def of(cls, points: FloatArray) -> _View:
        """Return the view that shows all ``(N, 2)`` points (x right, y down)."""
        if not len(points):
            points = np.zeros((1, 2))
        low, high = points.min(axis=0), points.max(axis=0)
        extent = np.maximum(high - low, 1e-6)
        room = (PANEL_PX - 2 * MARGIN_PX) * SUPERSAMPLE
        scale = room / float(max(extent))
        # a long flight needs no square: the panel is as high as it must be
        size = np.maximum(extent * scale, 0.3 * room) + 2 * MARGIN_PX * SUPERSAMPLE
        middle = (low + high) / 2.0
        return cls(middle - (size / 2.0) / scale, scale, np.ceil(size))

    def __call__(self, points: FloatArray) -> npt.NDArray[np.int32]:
        """``(N, 2)`` fixed-point canvas pixels."""
        p = (np.atleast_2d(points) - self.low) * self.px_per_unit + (0.0, HEAD_PX * SUPERSAMPLE)
        return np.round(p * (1 << _SHIFT)).astype(np.int32)


def _panel(view: _View, solved: SolvedGraph, at: dict[int, FloatArray], *, with_loops: bool) -> Canvas:
    w, h = view.size_px
    canvas = np.full((h + (HEAD_PX + FOOT_PX) * SUPERSAMPLE, w, 3), 255, np.uint8)
    rejected = set(solved.solution.rejected)
    drawn = [(k, e) for k, e in enumerate(solved.graph.edges) if e.a in at and e.b in at]
    misfit = np.nan_to_num(solved.misfit_sigmas)
    loops = [(k, e) for k, e in drawn if e.kind is EdgeKind.LOOP] if with_loops else []
    for k, e in loops:
        if k in rejected:
            _line(canvas, view, at[e.a], at[e.b], ASIDE_COLOUR, 1)
    kept = sorted(((k, e) for k, e in loops if k not in rejected), key=lambda item: float(misfit[item[0]]))
    for k, e in kept:
        _line(canvas, view, at[e.a], at[e.b], colour_of(float(misfit[k])), SUPERSAMPLE)
    for k, e in drawn:
        if e.kind is EdgeKind.SEQUENTIAL and not (with_loops and k in rejected):
            _line(canvas, view, at[e.a], at[e.b], PATH_COLOUR, SUPERSAMPLE)
    for k, e in kept:  # what pulls must not hide below the path
        if misfit[k] > PULLS_SIGMAS:
            _line(canvas, view, at[e.a], at[e.b], colour_of(float(misfit[k])), SUPERSAMPLE)
    for p in at.values():
        cv2.circle(canvas, view(p)[0].tolist(), 2 * SUPERSAMPLE << _SHIFT, PATH_COLOUR, -1, cv2.LINE_AA, _SHIFT)
    return canvas


def colour_of(sigmas: float) -> Colour:
    """Return the BGR colour of a residual: blue at 0, over yellow, to red at ``FULL_COLOUR_SIGMAS`` and beyond."""
    share = min(max(sigmas / FULL_COLOUR_SIGMAS, 0.0), 1.0) if math.isfinite(sigmas) else 0.0
    stops = np.array([[200, 120, 40], [170, 190, 120], [60, 190, 240], [40, 40, 215]], np.float64)
    place = share * (len(stops) - 1)
    k = min(int(place), len(stops) - 2)
    b, g, r = (stops[k] + (place - k) * (stops[k + 1] - stops[k])).round().astype(int).tolist()
    return b, g, r


def _places(solution: Solution) -> dict[int, FloatArray]:
    """Frames of the largest segment, or of all segments where they share a map, to their ``(2,)`` places."""
    return {p.frame: p.T_map_plane.translation for p in solution.poses}


def _laid_on(before: dict[int, FloatArray], after: dict[int, FloatArray]) -> dict[int, FloatArray]:
    """Lay one solution on the other by the closest similarity, so that what differs is shape."""
    shared = [f for f in before if f in after]
    if len(shared) < 2:
        return before
    try:
        T = fit_similarity([after[f] for f in shared], [before[f] for f in shared])
    except ValueError:
        return before
    return {f: T.apply(p) for f, p in before.items()}


def _line(canvas: Canvas, view: _View, a: FloatArray, b: FloatArray, colour: Colour, thickness: int) -> None:
    (p,), (q,) = view(a).tolist(), view(b).tolist()
    cv2.line(canvas, p, q, colour, thickness, cv2.LINE_AA, _SHIFT)


def _title(canvas: Canvas, title: str, words: str) -> None:
    _text(canvas, title, (20, 32), 0.8, 2)
    _text(canvas, words, (20, 58), 0.5, 1)


def _text(canvas: Canvas, words: str, at_px: tuple[int, int], size: float, weight: int) -> None:
    x, y = at_px[0] * SUPERSAMPLE, at_px[1] * SUPERSAMPLE
    cv2.putText(canvas, words, (x, y), _FONT, size * SUPERSAMPLE, TEXT_COLOUR, weight * SUPERSAMPLE, cv2.LINE_AA)


def _scale_bar(canvas: Canvas, view: _View, unit: str) -> None:
    per_px = SUPERSAMPLE / view.px_per_unit
    wanted = 160.0 * per_px
    step = 10.0 ** math.floor(math.log10(wanted))
    length = max(m * step for m in (1.0, 2.0, 5.0) if m * step <= wanted)
    y = canvas.shape[0] - 40 * SUPERSAMPLE
    x = 20 * SUPERSAMPLE
    end = x + round(length * view.px_per_unit)
    cv2.rectangle(canvas, (x, y), (end, y + 4 * SUPERSAMPLE), TEXT_COLOUR, -1)
    _text(canvas, f"{length:g} {unit}", (20, canvas.shape[0] // SUPERSAMPLE - 14), 0.5, 1)


def _legend(canvas: Canvas) -> None:
    y = canvas.shape[0] - 40 * SUPERSAMPLE
    x, width = 20 * SUPERSAMPLE, 160 * SUPERSAMPLE
    for k in range(width):
        colour = colour_of(FULL_COLOUR_SIGMAS * k / (width - 1))
        cv2.line(canvas, (x + k, y), (x + k, y + 8 * SUPERSAMPLE), colour, 1)
    bottom = canvas.shape[0] // SUPERSAMPLE - 14
    _text(canvas, f"residual of a loop: 0 to {FULL_COLOUR_SIGMAS:g} sigma", (20, bottom), 0.5, 1)
