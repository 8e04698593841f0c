"""How well a frame and its predecessor fit under a motion, place by place: what does not fit, and why."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.frame import ImageArray
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ifmi.frames.lightstep import LightStep, light_step
from photomap_gis.ifmi.frames.look import FrameLook

MEAN_SIDE_PX = 17
"""Side of the neighbourhood whose mean is taken out: light may change, detail may not."""
GAIN_SIDE_PX = 33
GIVE_SIDE_PX = 9
GIVE_PX = 2.0
"""How far a place may lie from where the motion puts it (pixels of the coarse picture): tilt and relief do that."""
ENERGY_SIDE_PX = 5
NOISE_QUANTILE = 40.0
NOISE_FACTOR = 2.0
DETAIL_FACTOR = 0.25
FLOOR_GREY = 3.5
FLOOR_CONTRAST = 0.15
TEXTURED = 60.0

FloatImage = npt.NDArray[np.float32]
Mask8 = npt.NDArray[np.uint8]


_FIVE = np.ones((5, 5), np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A comparison on the frame's coarse picture, all maps ``(h, w)``.

    ``seen`` is 1 where the predecessor showed the place too; ``misfit`` 1 where it showed something else there;
    ``still`` 1 where the frame shows what the predecessor showed at the same pixels although the ground moved.
    ``excess`` is what differs over what may. ``M_a_b`` maps coarse pixels of the frame into the predecessor's,
    ``moved_px`` is how far, on average. ``agreement`` is the correlation of what was seen twice; ``light`` the largest
    jump of its brightness.
    """

    seen: Mask8
    misfit: Mask8
    excess: FloatImage
    still: Mask8
    M_a_b: FloatArray
    moved_px: float
    agreement: float
    light: LightStep

    @property
    def overlap(self) -> float:
        """Share of the frame that the predecessor showed too."""
        return float(self.seen.mean())


def fit(look: FrameLook, before: FrameLook, H_a_b: FloatArray) -> Fit:
    """Compare a frame with its predecessor laid under it by ``H_a_b``, ``(3, 3)`` in pixels of the whole frames."""
    a8, b8 = before.coarse, look.coarse
    h, w = b8.shape
    M = _coarse_motion(look, H_a_b)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    framed = np.where(bars(a8, b8), 0, 255).astype(np.uint8)
    under = cv2.warpPerspective(a8, M, (w, h), flags=flags)
    shown = framed if before.usable is None else framed & before.usable
    seen = cv2.warpPerspective(shown, M, (w, h), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    seen = cv2.erode(seen, _FIVE, borderType=cv2.BORDER_CONSTANT, borderValue=255) & framed
    if look.usable is not None:
        seen &= cv2.erode(look.usable, _FIVE, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    weight = (seen > 0).astype(np.float32)
    soft_a, soft_b = (cv2.GaussianBlur(p, (3, 3), 0.7).astype(np.float32) for p in (under, b8))
    a, b = _detail(soft_a, weight), _detail(soft_b, weight)
    a *= _gain(a, b)
    excess = _unexplained(a, b)
    energy = cv2.blur(excess * excess, (ENERGY_SIDE_PX, ENERGY_SIDE_PX))
    power = cv2.blur(cv2.max(a * a, b * b), (ENERGY_SIDE_PX, ENERGY_SIDE_PX))
    inside = seen > 0
    noise = float(np.percentile(energy[inside][::3], NOISE_QUANTILE)) if inside.any() else 0.0
    floor = max(FLOOR_GREY, FLOOR_CONTRAST * float(b8.std())) ** 2
    limit = NOISE_FACTOR * noise + DETAIL_FACTOR * power + floor
    ratio = energy / limit
    misfit = ((ratio > 1.0) & inside).astype(np.uint8)
    norm = float(cv2.norm(a)) * float(cv2.norm(b))
    agreement = float(np.vdot(a, b)) / norm if norm > 1.0 else 0.0
    moved = _mean_motion(M, w, h)
    still = _still(a8, b8) & misfit if moved > 1.5 else np.zeros_like(misfit)
    light = light_step(soft_a, soft_b, seen * (1 - cv2.dilate(still, _FIVE)))
    return Fit(inside.astype(np.uint8), misfit, ratio, still, M, moved, agreement, light)


def bars(a: ImageArray, b: ImageArray) -> npt.NDArray[np.bool_]:
    """``(h, w)`` True where both pictures have one dark bar along a border: a letter box."""
    out = np.zeros(b.shape, np.bool_)
    for axis in (0, 1):
        (ma, sa), (mb, sb) = ((p.mean(axis=1 - axis), p.std(axis=1 - axis)) for p in (a, b))
        dark = (sa < 2.5) & (sb < 2.5) & (ma < 40.0) & (np.abs(ma - mb) < 2.0)
        if not (dark[0] or dark[-1]):
            continue
        n = len(dark)
        first = int(np.argmin(dark)) if not dark.all() else n
        last = int(np.argmin(dark[::-1])) if not dark.all() else n
        lines = np.zeros(n, np.bool_)
        if first:
            lines[: first + 1] = True
        if last:
            lines[n - last - 1 :] = True
        out |= lines[:, None] if axis == 0 else lines[None, :]
    return out


def _coarse_motion(look: FrameLook, H_a_b: FloatArray) -> FloatArray:
    """Carry a motion between whole frames to their coarse pictures, whose pixels cover several of the frame's."""
    k = look.shape[1] / look.coarse.shape[1]
    offset = (k - 1.0) / 2.0
    T_frame_coarse = np.array([[k, 0.0, offset], [0.0, k, offset], [0.0, 0.0, 1.0]])
    return np.asarray(np.linalg.inv(T_frame_coarse) @ H_a_b @ T_frame_coarse, np.float64)


def _mean_motion(M: FloatArray, w: int, h: int) -> float:
    corners = np.array([[0.0, w, 0.0, w], [0.0, 0.0, h, h], [1.0, 1.0, 1.0, 1.0]])
    moved = M @ corners
    d = moved[:2] / moved[2] - corners[:2]
    return float(np.hypot(d[0], d[1]).mean())


def _detail(picture: FloatImage, weight: FloatImage) -> FloatImage:
    """Take out the local mean over what both frames saw."""
    side = (MEAN_SIDE_PX, MEAN_SIDE_PX)
    mean = cv2.blur(picture * weight, side) / cv2.max(cv2.blur(weight, side), 1e-3)
    out: FloatImage = (picture - mean) * weight
    return out


def _gain(a: FloatImage, b: FloatImage) -> FloatImage:
    """Return the local gain from a to b, within a factor of two of the whole picture's."""
    side = (GAIN_SIDE_PX, GAIN_SIDE_PX)
    whole = float(np.clip(np.sqrt((b * b).mean() / max(float((a * a).mean()), 1e-3)), 0.3, 3.0))
    local = (cv2.blur(a * b, side) + 20.0 * whole) / (cv2.blur(a * a, side) + 20.0)
    gain: FloatImage = np.clip(local, 0.5 * whole, 2.0 * whole)
    return gain


def _unexplained(a: FloatImage, b: FloatImage) -> FloatImage:
    """Return what remains of b - a when each place may give way a little: one regularised step of Lucas-Kanade."""
    r, s = b - a, a + b
    gx, gy = cv2.Sobel(s, cv2.CV_32F, 1, 0, scale=1 / 16), cv2.Sobel(s, cv2.CV_32F, 0, 1, scale=1 / 16)
    side = (GIVE_SIDE_PX, GIVE_SIDE_PX)
    xx, xy, yy = cv2.blur(gx * gx, side), cv2.blur(gx * gy, side), cv2.blur(gy * gy, side)
    xr, yr = cv2.blur(gx * r, side), cv2.blur(gy * r, side)
    stiff = 0.02 * (xx + yy) + 1.0
    xx, yy = xx + stiff, yy + stiff
    det = xx * yy - xy * xy
    dx, dy = (yy * xr - xy * yr) / det, (xx * yr - xy * xr) / det
    short = cv2.min(GIVE_PX / cv2.max(cv2.magnitude(dx, dy), 1e-6), 1.0)
    out: FloatImage = r - short * (dx * gx + dy * gy)
    return out


def _still(a: ImageArray, b: ImageArray) -> Mask8:
    """``(h, w)`` 1 where there is detail that both pictures show at the same pixels."""
    side = (MEAN_SIDE_PX, MEAN_SIDE_PX)
    fa, fb = a.astype(np.float32), b.astype(np.float32)
    da, db = fa - cv2.blur(fa, side), fb - cv2.blur(fb, side)
    d = db - da
    same = cv2.blur(d * d, (3, 3)) < 0.2 * cv2.blur(db * db, (3, 3))
    return np.asarray(same & (cv2.blur(db * db, (3, 3)) > TEXTURED), np.uint8)
