"""Drawn pixels against an independent twin: every one looked up by itself, by the definition of the cubic kernel."""

import math

import numpy as np
import pytest

from photomap_gis.mosaic.cells import UNSETTLED
from photomap_gis.mosaic.drawing import FEATHER_PX
from photomap_gis.mosaic.lattice import STEP_PX, Box
from photomap_gis.mosaic.light import Light
from photomap_gis.mosaic.paint import Shares, paint
from photomap_gis.mosaic.pixels import SourceImage
from photomap_gis.mosaic.taps import STEPS, cubic_weights

ROWS, COLUMNS = 8, 9
HEIGHT, WIDTH = STEP_PX * (ROWS - 2), STEP_PX * (COLUMNS - 2)
BOX = Box(STEP_PX, STEP_PX, WIDTH - 2 * STEP_PX, HEIGHT - 2 * STEP_PX)


def keys(d: float) -> float:
    d, a = abs(d), -0.75
    if d <= 1:
        return (a + 2) * d**3 - (a + 3) * d**2 + 1
    return a * d**3 - 5 * a * d**2 + 8 * a * d - 4 * a if d < 2 else 0.0


def looked_up(image: np.ndarray, x: float, y: float) -> np.ndarray:
    """``(3,)`` BGR at a place rounded to ``1 / STEPS`` of a pixel; the edge repeated."""
    colour = image if image.ndim == 3 else np.repeat(image[..., None], 3, -1)
    x, y = math.floor(x * STEPS + 0.5) / STEPS, math.floor(y * STEPS + 0.5) / STEPS
    out = np.zeros(3)
    for q in range(math.floor(y) - 1, math.floor(y) + 3):
        for p in range(math.floor(x) - 1, math.floor(x) + 3):
            out += (
                keys(x - p) * keys(y - q) * colour[np.clip(q, 0, len(colour) - 1), np.clip(p, 0, colour.shape[1] - 1)]
            )
    return out


def between_nodes(values: np.ndarray, x: int, y: int) -> np.ndarray:
    """Node values at pixel (x, y) of the domain, between the four nodes around."""
    u, v = (x + 0.5) / STEP_PX + 0.5, (y + 0.5) / STEP_PX + 0.5
    j, i = math.floor(u), math.floor(v)
    u, v = u - j, v - i
    upper, lower = (values[r, j] * (1 - u) + values[r, j + 1] * u for r in (i, i + 1))
    return upper * (1 - v) + lower * v


def scene(rng, sides, *, grey=False, scale=1.0, turn=0.4, at=(30.0, 25.0)):
    """Frames with their sights of the nodes (x and y only) and lights at them, all different."""
    images, sights, lights = [], np.zeros((len(sides), 4, ROWS, COLUMNS), np.float32), {}
    gx, gy = np.meshgrid(np.arange(COLUMNS) * STEP_PX, np.arange(ROWS) * STEP_PX)
    for k, (w, h) in enumerate(sides):
        images.append(rng.integers(0, 256, (h, w, 3)[: 2 if grey else 3], dtype=np.uint8))
        images[-1].setflags(write=False)  # as decoders hand them out
        c, s = math.cos(turn + k), math.sin(turn + k)
        x, y = gx - 36.0, gy - 32.0
        sights[k, 0] = at[0] + c * x - s * y + 0.004 * x * y
        sights[k, 1] = at[1] + s * x + c * y
        lights[k] = Light(
            rng.uniform(0.8, 1.2, (ROWS, COLUMNS, 3)).astype(np.float32),
            rng.uniform(-20, 20, (ROWS, COLUMNS, 3)).astype(np.float32),
        )
    return images, sights, lights, scale


def drawn(images, sights, lights, scale, labels, givers, box=BOX):
    class Numbered(int):
        """A view is only handed on to who opens its picture."""

    rgba = np.zeros((box.height, box.width, 4), np.uint8)
    shares = Shares.of(labels, givers, len(images), box)
    paint(rgba, shares, [Numbered(k) for k in range(len(images))], sights, lights, STEP_PX,
          lambda view: SourceImage(images[view], scale))  # fmt: skip
    return rgba


def expected_at(images, sights, lights, scale, labels, x, y):
    """``(4,)`` RGBA of a pixel of the domain: a mean of all that give pixels around, as many as each gives."""
    if labels[y, x] < 0:
        return np.zeros(4)
    around = labels[y - FEATHER_PX : y + FEATHER_PX + 1, x - FEATHER_PX : x + FEATHER_PX + 1]
    total, weights = np.zeros(3), 0
    for k, image in enumerate(images):
        count = int((around == k).sum())
        if count:
            u, v = (between_nodes((sights[k, n] + 0.5) * scale - 0.5, x, y) for n in (0, 1))
            value = looked_up(image, u, v) * between_nodes(lights[k].factor, x, y)
            total += count * (value + between_nodes(lights[k].offset, x, y))
            weights += count
    return np.append(np.clip(np.floor(total / weights + 0.5), 0, 255)[::-1], 255)


def differences(parts, labels, givers):
    rgba = drawn(*parts, labels, givers).astype(int)
    y, x = np.mgrid[: BOX.height, : BOX.width]
    expected = np.array(
        [expected_at(*parts, labels, i + BOX.x, j + BOX.y) for i, j in zip(x.ravel(), y.ravel(), strict=True)]
    )
    return np.abs(rgba - expected.reshape(rgba.shape))


def check(difference):
    # A place that lies between two steps may be rounded either way.
    assert np.mean(difference > 1) < 0.01 and np.percentile(difference, 99.5) <= 3
    assert (difference[..., 3] == 0).all()


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_one_frame_that_gives_all(rng, grey, scale):
    parts = scene(rng, [(90, 80)], grey=grey, scale=scale, at=(44.0, 40.0) if scale == 1.0 else (70.0, 66.0))
    labels, givers = np.zeros((HEIGHT, WIDTH), np.int16), np.zeros((ROWS - 1, COLUMNS - 1), np.int16)
    check(differences(parts, labels, givers))


def test_beyond_a_frames_edge_its_edge_goes_on(rng):
    parts = scene(rng, [(31, 23)], at=(12.0, 9.0))
    labels, givers = np.zeros((HEIGHT, WIDTH), np.int16), np.zeros((ROWS - 1, COLUMNS - 1), np.int16)
    check(differences(parts, labels, givers))


def test_where_a_node_is_not_seen_nothing_breaks(rng):
    parts = scene(rng, [(31, 23)])
    parts[1][0, :, 3, 4] = np.nan
    labels, givers = np.zeros((HEIGHT, WIDTH), np.int16), np.zeros((ROWS - 1, COLUMNS - 1), np.int16)
    assert (drawn(*parts, labels, givers)[..., 3] == 255).all()


def test_along_seams_frames_are_mixed_by_how_much_of_the_place_is_theirs(rng):
    parts = scene(rng, [(80, 70), (75, 90), (60, 60)], at=(38.0, 34.0))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels = np.where(x + 0.4 * y < 38, 0, np.where(y > 30, 2, 1)).astype(np.int16)
    labels[:14, 20:40] = -1  # and a hole
    givers = np.full((ROWS - 1, COLUMNS - 1), UNSETTLED, np.int16)
    for i in range(ROWS - 1):
        for j in range(COLUMNS - 1):
            part = labels[max(STEP_PX * i - 4, 0) : STEP_PX * i + 4, max(STEP_PX * j - 4, 0) : STEP_PX * j + 4]
            if len(np.unique(part)) == 1:
                givers[i, j] = part[0, 0]
    difference = differences(parts, labels, givers)
    check(difference)
    # A part of the box is a part of the picture.
    part = Box(BOX.x + 3, BOX.y + 9, 22, 13)
    whole = drawn(*parts, labels, givers)
    assert np.array_equal(drawn(*parts, labels, givers, part), whole[9 : 9 + 13, 3 : 3 + 22])


def test_weights_are_those_of_the_kernel_and_add_up():
    weights = cubic_weights()
    assert np.allclose(weights.sum(axis=1), 1.0, atol=1e-6)
    for step in (0, 1, 20, STEPS - 1):
        t = step / STEPS
        assert weights[step] == pytest.approx([keys(t + 1), keys(t), keys(t - 1), keys(t - 2)], abs=1e-6)
