"""Find patches of one picture in another by normalised cross-correlation, coarse to fine, to a fraction of a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.similarity import FloatArray, Similarity2D, fit_similarity

GreyImage = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]

PATCH_PX = 64
SEARCH_PX = 10
NCC_MIN = 0.6
GROWTH_ROUNDS = 12
COARSE_PX_M = 0.4
"""Nothing smaller is looked at while the whole map's offset of metres is found."""


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Patches of the true picture and where they lie in the map, in pixels of their common grid.

    ``true_xy`` and ``map_xy`` are ``(N, 2)``, ``score`` ``(N,)`` the correlation; ``map_xy`` is NaN where nothing
    correlates. ``T_map_true`` is the similarity of the coarse alignment.
    """

    true_xy: FloatArray
    map_xy: FloatArray
    score: FloatArray
    T_map_true: Similarity2D

    @property
    def found(self) -> BoolArray:
        """``(N,)`` whether a patch was found."""
        return np.isfinite(self.map_xy[:, 0])


def coarse_alignment(
    true: GreyImage, seen: BoolArray, mapped: GreyImage, alpha: BoolArray, *, pixel_size_m: float, reach_m: float = 12.0
) -> Similarity2D:
    """Return ``T_map_true`` between two pictures of one grid that are up to ``reach_m`` metres apart.

    Large patches are looked for in reduced pictures; a robust similarity is drawn through what was found, a mere shift
    where little was found, the identity where nothing was.
    """
    factor = max(1.0, COARSE_PX_M / pixel_size_m)
    reach = max(4, math.ceil(reach_m / pixel_size_m / factor))
    small_true, small_map = (_reduced(a, factor) for a in (true, _filled(mapped, alpha)))
    small_seen = _reduced(seen.astype(np.uint8) * 255, factor) > 250
    for side in (64, 40, 24):
        corners = patch_corners(small_true, small_seen, side=side, stride=side // 2)
        true_xy, map_xy, score = _search(small_true, small_map, corners, np.zeros((len(corners), 2)), side, reach)
        good = score >= 0.5
        if good.sum() >= 12:
            break
    if not good.any():
        return Similarity2D.identity()
    # a pixel of the reduced picture is `factor` pixels wide: carry centres over
    a, b = ((xy[good] + 0.5) * factor - 0.5 for xy in (map_xy, true_xy))
    return _robust_similarity(a, b, tolerance=max(3.0, 1.0 / pixel_size_m))


def match_patches(
    true: GreyImage,
    seen: BoolArray,
    mapped: GreyImage,
    alpha: BoolArray,
    T_map_true: Similarity2D,
    *,
    patch_px: int = PATCH_PX,
    search_px: int = SEARCH_PX,
) -> Matches:
    """Find every textured patch of the true picture that the map covers, near where its neighbourhood lies.

    The map is first laid on the true picture by the coarse similarity; then patches twice as large, looked for far,
    say where each neighbourhood lies; then each patch is looked for within ``search_px`` of that place, of where the
    similarity alone puts it, or of where a neighbour was found. So a warped or torn map is measured and not lost: what
    is still not found correlates nowhere near.
    """
    size = true.shape[::-1]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(
        _filled(mapped, alpha), T_map_true.matrix[:2], size, flags=flags, borderMode=cv2.BORDER_REFLECT
    )
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    covered = cv2.warpAffine(alpha.astype(np.uint8), T_map_true.matrix[:2], size, flags=flags) > 0
    corners = patch_corners(true, seen & covered, side=patch_px, stride=patch_px)
    near = _neighbourhood_shifts(true, seen & covered, laid, corners, patch_px)
    true_xy, map_xy, score = _search(true, laid, corners, near, patch_px, search_px)

    def look_again(rows: npt.NDArray[np.intp], shifts: FloatArray) -> None:
        _, second_xy, second = _search(true, laid, corners[rows], shifts, patch_px, search_px)
        better = second > score[rows]
        map_xy[rows[better]], score[rows[better]] = second_xy[better], second[better]

    lost = np.flatnonzero(score < NCC_MIN)
    look_again(lost, np.zeros((len(lost), 2)))
    for _ in range(GROWTH_ROUNDS):  # what was found tells its lost neighbours where to look
        lost, shifts = _neighbours_of_lost(corners, map_xy - true_xy, score, patch_px)
        before = int((score >= NCC_MIN).sum())
        for rows, shift in zip(np.split(lost, range(1, len(lost))), shifts, strict=False):
            look_again(rows, shift[None])
        if int((score >= NCC_MIN).sum()) == before:
            break
    map_xy[score < NCC_MIN] = np.nan
    return Matches(true_xy, T_map_true.apply(map_xy), score, T_map_true)


def _neighbours_of_lost(
    corners: npt.NDArray[np.intp], shift: FloatArray, score: FloatArray, patch_px: int
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return rows of lost patches, once for every distinct shift of the found patches around each, and the shifts."""
    cell = {(int(x) // patch_px, int(y) // patch_px): k for k, (x, y) in enumerate(corners)}
    rows: list[int] = []
    shifts: list[FloatArray] = []
    for (x, y), k in cell.items():
        if score[k] >= NCC_MIN:
            continue
        around = [cell.get((x + i, y + j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
        tried: list[FloatArray] = []
        for n in around:
            if n is None or score[n] < NCC_MIN:
                continue
            guess = np.round(shift[n])
            if all(np.abs(guess - other).max() > 4 for other in tried):
                tried.append(guess)
        rows += [k] * len(tried)
        shifts += tried
    return np.array(rows, dtype=np.intp), np.array(shifts).reshape(-1, 2)


def patch_corners(image: GreyImage, usable: BoolArray, *, side: int, stride: int) -> npt.NDArray[np.intp]:
    """``(N, 2)`` upper-left pixels (x, y) of the wholly usable patches with texture in two directions.

    A patch with one straight edge only can be slid along it: it says nothing about the way along.
    """
    h, w = image.shape
    smooth = cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3, scale=0.125) for d in ((1, 0), (0, 1)))
    sums = [cv2.integral(a, sdepth=cv2.CV_64F) for a in (gx * gx, gy * gy, gx * gy, usable.astype(np.uint8))]
    y, x = np.mgrid[0 : h - side + 1 : stride, 0 : w - side + 1 : stride].reshape(2, -1)
    xx, yy, xy, inside = ((s[y + side, x + side] - s[y, x + side] - s[y + side, x] + s[y, x]) / side**2 for s in sums)
    middle, spread = (xx + yy) / 2.0, np.sqrt(((xx - yy) / 2.0) ** 2 + xy**2)
    weaker, stronger = middle - spread, middle + spread
    keep = (inside > 0.9999) & (weaker > 0.35) & (weaker > 0.06 * stronger)
    return np.stack([x[keep], y[keep]], axis=1)


def _neighbourhood_shifts(
    true: GreyImage, usable: BoolArray, laid: GreyImage, corners: npt.NDArray[np.intp], patch_px: int
) -> FloatArray:
    """``(N, 2)`` whole-pixel shifts of each patch's surroundings: the median of the nearest large patches."""
    side = 2 * patch_px
    small_true, small_laid = _reduced(true, 2.0), _reduced(laid, 2.0)
    small_usable = _reduced(usable.astype(np.uint8) * 255, 2.0) > 250
    wide = patch_corners(small_true, small_usable, side=side // 2, stride=side // 4)
    at, found, score = _search(small_true, small_laid, wide, np.zeros((len(wide), 2)), side // 2, 24)
    good = score >= NCC_MIN
    if not good.any() or len(corners) == 0:
        return np.zeros((len(corners), 2))
    places, shifts = at[good] * 2.0 + 0.5, (found - at)[good] * 2.0
    centres = corners + (patch_px - 1) / 2.0
    out = np.zeros((len(corners), 2))
    count = min(7, len(places))
    for k, centre in enumerate(centres):
        distance = np.hypot(*(places - centre).T)
        nearest = np.argpartition(distance, count - 1)[:count]
        close = nearest[distance[nearest] < 3.0 * side]
        if len(close):
            out[k] = np.round(np.median(shifts[close], axis=0))
    return out


def _search(
    true: GreyImage, mapped: GreyImage, corners: npt.NDArray[np.intp], shifts: FloatArray, side: int, reach: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return patch centres, where each was found (sub-pixel; NaN at the search's border), and its correlation."""
    pad = reach + int(np.abs(shifts).max(initial=0.0)) + 2
    wide = cv2.copyMakeBorder(mapped, pad, pad, pad, pad, cv2.BORDER_REFLECT)
    centres: FloatArray = corners.astype(np.float64) + (side - 1) / 2.0
    found: FloatArray = np.full((len(corners), 2), np.nan)
    score: FloatArray = np.full(len(corners), -1.0)
    for k, (x, y) in enumerate(corners):
        dx, dy = (int(s) for s in shifts[k])
        x0, y0 = x + dx - reach + pad, y + dy - reach + pad
        window = wide[y0 : y0 + side + 2 * reach, x0 : x0 + side + 2 * reach]
        ncc = cv2.matchTemplate(window, true[y : y + side, x : x + side], cv2.TM_CCOEFF_NORMED)
        j, i = np.unravel_index(int(np.argmax(ncc)), ncc.shape)
        score[k] = float(ncc[j, i])
        if 0 < i < ncc.shape[1] - 1 and 0 < j < ncc.shape[0] - 1:
            fine = _vertex(ncc[j, i - 1 : i + 2]), _vertex(ncc[j - 1 : j + 2, i])
            found[k] = centres[k] + (dx + i - reach + fine[0], dy + j - reach + fine[1])
        else:
            score[k] = -1.0
    return centres, found, score


def _vertex(three: npt.NDArray[np.float32]) -> float:
    """Offset from the middle of three equally spaced values to their parabola's vertex."""
    left, middle, right = (float(v) for v in three)
    curve = left - 2.0 * middle + right
    return 0.0 if curve >= 0 else max(-0.5, min(0.5, 0.5 * (left - right) / curve))


def _robust_similarity(map_xy: FloatArray, true_xy: FloatArray, *, tolerance: float) -> Similarity2D:
    """Return the similarity that most pairs agree on (seeded random pairs, then least squares over who agrees)."""
    shift = Similarity2D.translation_of(*np.median(map_xy - true_xy, axis=0))
    best = np.hypot(*(shift.apply(true_xy) - map_xy).T) < tolerance
    rng = np.random.default_rng(0)
    for _ in range(400 if len(true_xy) >= 3 else 0):
        pair = rng.choice(len(true_xy), 2, replace=False)
        try:
            guess = fit_similarity(map_xy[pair], true_xy[pair])
        except ValueError:
            continue
        if abs(guess.log_scale) > 0.25 or abs(guess.angle_rad) > 0.35:
            continue
        agree = np.hypot(*(guess.apply(true_xy) - map_xy).T) < tolerance
        if agree.sum() > best.sum():
            best = agree
    if best.sum() < 3:
        return shift
    for _ in range(3):
        try:
            guess = fit_similarity(map_xy[best], true_xy[best])
        except ValueError:
            return shift
        best = np.hypot(*(guess.apply(true_xy) - map_xy).T) < tolerance
        if best.sum() < 3:
            return shift
    return guess


def _reduced(image: GreyImage, factor: float) -> GreyImage:
    """Return a picture whose pixels are ``factor`` wide, its first pixel's corner kept."""
    if factor <= 1.0:
        return image
    h, w = image.shape
    soft = cv2.GaussianBlur(image, (0, 0), 0.45 * factor)
    to_image = np.array([[factor, 0.0, (factor - 1) / 2.0], [0.0, factor, (factor - 1) / 2.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (max(1, int(w / factor)), max(1, int(h / factor)))
    return np.asarray(cv2.warpAffine(soft, to_image, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))


def _filled(image: GreyImage, alpha: BoolArray) -> GreyImage:
    """Return the picture with its holes grey, so that their borders do not pull the correlation."""
    if alpha.all():
        return image
    out = image.copy()
    out[~alpha] = int(image[alpha].mean()) if alpha.any() else 128
    return out
