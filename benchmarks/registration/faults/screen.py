"""What is drawn over the camera's picture: telemetry text, letter boxes, logos, menus."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]
WORDS = ("ALT 84m", "SPD 5.2", "BAT 14.8V", "GPS 12", "REC 00:12:41", "HDG 207", "MODE LOITER", "RSSI 71%", "N 54.3521",
         "E 18.6466", "ISO 200", "1/500", "HOME 233m", "SAT 14", "CAM 1")  # fmt: skip
ENTRIES = ("EXPOSURE", "WHITE BALANCE", "SHARPNESS", "DAY/NIGHT", "BACKLIGHT", "MOTION", "LANGUAGE", "RESET", "EXIT",
           "SAVE AND EXIT", "PRIVACY", "MIRROR", "FREQUENCY 5.8G", "CHANNEL 4", "POWER 600mW", "NO SIGNAL")  # fmt: skip
FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_PLAIN, cv2.FONT_HERSHEY_DUPLEX)


def write(image: Grey, text: str, at_xy: tuple[int, int], height_px: float, value: int, *, outlined: bool) -> None:
    """Draw a line of text into an image."""
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, max(height_px, 6.0) / 22.0
    thick = max(1, round(scale * 1.6))
    if outlined:
        cv2.putText(image, text, at_xy, font, scale, 255 - value, thick + 2, cv2.LINE_AA)
    cv2.putText(image, text, at_xy, font, scale, value, thick, cv2.LINE_AA)


def draw_telemetry(rng: np.random.Generator, frames: list[Grey]) -> list[Grey]:
    """Return a take with small text in its corners and perhaps a cross in its middle; the numbers count on."""
    h, w = frames[0].shape
    size = max(7.0, h * float(rng.uniform(0.035, 0.055)))
    value, outlined = int(rng.choice((255, 230))), bool(rng.uniform() < 0.7)
    words = [str(v) for v in rng.permutation(WORDS)[: int(rng.integers(2, 7))]]
    places = [(0.03, 0.08), (0.66, 0.08), (0.03, 0.96), (0.66, 0.96), (0.03, 0.15), (0.66, 0.15)]
    cross = rng.uniform() < 0.5
    out = []
    for number, frame in enumerate(frames):
        image = frame.copy()
        for word, (x, y) in zip(words, places, strict=False):
            write(image, f"{word}{number % 10}", (int(x * w), int(y * h)), size, value, outlined=outlined)
        if cross:
            cv2.drawMarker(image, (w // 2, h // 2), value, cv2.MARKER_CROSS, h // 12, max(1, h // 240))
        out.append(image)
    return out


def draw_box(rng: np.random.Generator, frames: list[Grey]) -> list[Grey]:
    """Return a take with black bars at top and bottom, or left and right."""
    h, w = frames[0].shape
    dark, tall = int(rng.choice((0, 0, 16))), rng.uniform() < 0.5
    bar = int((h if tall else w) * float(rng.uniform(0.06, 0.16)))
    out = []
    for frame in frames:
        image = frame.copy()
        if tall:
            image[:bar] = image[h - bar :] = dark
        else:
            image[:, :bar] = image[:, w - bar :] = dark
        out.append(image)
    return out


def draw_propellers(rng: np.random.Generator, frames: list[Grey]) -> list[Grey]:
    """Return a take with the blurred tips of propellers and a skid in its corners."""
    h, w = frames[0].shape
    corners = [(0, 0), (w, 0), (0, h), (w, h)]
    chosen = [corners[int(k)] for k in rng.permutation(4)[: int(rng.integers(1, 3))]]
    value = int(rng.integers(10, 90))
    radius = int(w * float(rng.uniform(0.08, 0.16)))
    out = []
    for frame in frames:
        cover = np.zeros((h, w), np.float32)
        for corner in chosen:
            cv2.ellipse(cover, corner, (radius, radius // 2), float(rng.normal(30, 4)), 0, 360, 0.9, -1)
        cover = cv2.GaussianBlur(cover, (0, 0), 1.5)
        out.append(np.asarray(frame * (1 - cover) + value * cover, np.uint8))
    return out


def draw_menu(rng: np.random.Generator, frame: Grey) -> Grey:
    """Return a frame with an on-screen menu over a good part of it, opaque or half transparent."""
    h, w = frame.shape
    image = frame.astype(np.float32)
    panels = 1 if rng.uniform() < 0.7 else 2
    for _ in range(panels):
        share_w, share_h = float(rng.uniform(0.35, 0.9)), float(rng.uniform(0.35, 0.9))
        pw, ph = int(w * share_w), int(h * share_h)
        x, y = int(rng.integers(0, w - pw + 1)), int(rng.integers(0, h - ph + 1))
        value = float(rng.choice((0, 16, 40, 70, 110, 200)))
        opacity = 1.0 if rng.uniform() < 0.5 else float(rng.uniform(0.45, 0.85))
        panel = image[y : y + ph, x : x + pw]
        panel *= 1.0 - opacity
        panel += opacity * value
        drawn = np.clip(image, 0, 255).astype(np.uint8)
        ink = 255 if value < 120 else 10
        lines = int(rng.integers(4, 11))
        step = ph / (lines + 0.5)
        for k in range(lines):
            text = str(rng.choice(ENTRIES))
            if rng.uniform() < 0.5:
                text += f"  {int(rng.integers(0, 100))}"
            size = min(0.6 * step, 0.07 * h)
            below = y + int((k + 0.8) * step)
            if k == 1 and rng.uniform() < 0.5:  # the chosen entry's bar
                left_top = x + pw // 30, below - int(0.7 * step)
                right_bottom = x + pw - pw // 30, below + int(0.2 * step)
                cv2.rectangle(drawn, left_top, right_bottom, int(rng.integers(60, 200)), -1)
            write(drawn, text, (x + pw // 15, below), size, ink, outlined=False)
        if rng.uniform() < 0.6:
            cv2.rectangle(drawn, (x, y), (x + pw - 1, y + ph - 1), ink, max(1, h // 200))
        outside = np.ones((h, w), bool)
        outside[y : y + ph, x : x + pw] = False
        image = np.where(outside, image, drawn).astype(np.float32)
    return np.clip(image, 0, 255).astype(np.uint8)
