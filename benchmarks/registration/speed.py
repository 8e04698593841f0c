"""Section ``speed``: CPU time, each thing timed in turn with the others in one run, so that all meet the same machine.

The floor is what one registration cannot do without, as bare calls of OpenCV: the transforms and warps of Algorithm 2
for a new frame against one that is known. Its spectrum and its log-polar spectrum's (two forward transforms and a
remap), the pulse of turn and scale (inverse), the turned frame (warp), its spectrum (forward), the pulse of the shift
(inverse), and one warp to look whether it is true.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from .methods import LOOP, TRACKING, method_named, prior_of
from .pairs import Pair, pairs
from .report import Bar, Figure, Section, Unit
from .running import Options
from .score import Interval, bootstrap

LOG_POLAR_SHAPE = (256, 256)
TRACKING_256_MS, TRACKING_512_MS = 4.0, 14.0
LOOPS_PER_S = 300.0
OVER_FLOOR = 3.0
IMREG_DFT, ORB = 60.0, 3.0
WARM_UP = 3


Found = dict[str, list[float]]


@dataclass(frozen=True, slots=True)
class Timed:
    """Something that is timed on every pair; ``once`` in ``every`` rounds (slow rivals need not run as often)."""

    name: str
    call: Callable[[int], Any]
    every: int = 1


def measure(options: Options) -> Section:
    """Return the section; pairs are of the nominal class, priors err as tracking's and a loop's do."""
    cv2.setNumThreads(1)
    rounds = max(20, min(options.count, 300))
    small = timings(rounds, options, 256)
    large = timings(max(10, rounds // 3), options, 512)
    rng = np.random.default_rng(options.seed)

    def median_ms(values: list[float]) -> Interval:
        return bootstrap(values, np.median, rng)

    def figure(name: str, ms: list[float], unit: Unit = "ms", bar: Bar | None = None) -> Figure:
        return Figure(name, median_ms(ms), len(ms), unit, bar)

    def ratio(name: str, found: Found, of: tuple[str, str], bar: Bar | None = None) -> Figure:
        return Figure(name, _ratio(found, *of, rng), min(len(found[o]) for o in of), "x", bar)

    loops = [1e3 / v for v in small["loop"]]
    figures = [
        figure("new frame, tracking, 256", small["tracking"], "ms", Bar(high=TRACKING_256_MS)),
        figure("new frame, tracking, 512", large["tracking"], "ms", Bar(high=TRACKING_512_MS)),
        figure("loop closures a second, 256", loops, "/s", Bar(low=LOOPS_PER_S)),
        ratio("tracking over the floor, 256", small, ("tracking", "floor"), Bar(high=OVER_FLOOR)),
        ratio("tracking over the floor, 512", large, ("tracking", "floor"), Bar(high=OVER_FLOOR)),
        ratio("loop closure over its floor, 256", small, ("loop", "loop floor")),
        ratio("ORB at its best over tracking", small, ("orb", "tracking"), Bar(low=ORB)),
    ]
    if "imreg_dft" in small:
        figures.append(ratio("imreg_dft over tracking", small, ("imreg_dft", "tracking"), Bar(low=IMREG_DFT)))
    figures += [figure(f"{name}, 256", small[name]) for name in small if name not in ("tracking", "loop")]
    figures += [figure(f"{name}, 512", large[name]) for name in large if name not in ("tracking", "loop")]
    figures.append(figure("loop closure, 512", large["loop"]))
    return Section(
        "speed",
        tuple(figures),
        notes=("process CPU time, medians, one thread; all timed in turn within one run", _absent()),
    )


def timings(rounds: int, options: Options, side: int) -> Found:
    """Return CPU milliseconds of everything, by name, timed in turn."""
    lot = list(pairs("nominal", min(rounds, 24), options.seed, options.part, size=(side, side)))
    timed = _contestants(lot, options.seed, side)
    found: Found = {t.name: [] for t in timed}
    for k in range(-WARM_UP, rounds):
        # the order turns from round to round: whoever comes first finds the caches cold
        for t in timed[k % len(timed) :] + timed[: k % len(timed)]:
            if k >= 0 and k % t.every:
                continue
            start = time.process_time()
            t.call(k % len(lot))
            if k >= 0:
                found[t.name].append(1e3 * (time.process_time() - start))
    return found


def _contestants(lot: list[Pair], seed: int, side: int) -> list[Timed]:
    tracking, orb, imreg = (method_named(n) for n in ("ifmi-tracking", "orb", "imreg_dft"))
    known = [tracking.prepare(p.a) for p in lot]
    other = [tracking.prepare(p.b) for p in lot]
    rng = np.random.default_rng([seed, 0x5BEED])
    near, loop = ([prior_of(p, spread, rng) for p in lot] for spread in (TRACKING, LOOP))
    orb_known = [orb.prepare(p.a) for p in lot]
    unknown = method_named("ifmi")
    floor, loop_floor = _floors(lot, side)
    timed = [
        Timed("tracking", lambda k: tracking.match(known[k], tracking.prepare(lot[k].b), near[k])),
        Timed("floor", floor),
        Timed("loop", lambda k: tracking.match(known[k], other[k], loop[k])),
        Timed("loop floor", loop_floor),
        Timed("no prior, new frame", lambda k: unknown.match(known[k], unknown.prepare(lot[k].b), None)),
        Timed("spectrum", lambda k: tracking.prepare(lot[k].b)),
        Timed("orb", lambda k: orb.match(orb_known[k], orb.prepare(lot[k].b), None)),
    ]
    if imreg.absent is None:
        states = [(imreg.prepare(p.a), imreg.prepare(p.b)) for p in lot]
        timed.append(Timed("imreg_dft", lambda k: imreg.match(*states[k], None), every=8))
    return timed


def _floors(lot: list[Pair], side: int) -> tuple[Callable[[int], None], Callable[[int], None]]:
    """Return the bare calls of a new frame's registration, and of one from cached spectra."""
    frames = [p.b.astype(np.float32) for p in lot]
    spectra = [cv2.dft(f) for f in frames]
    rng = np.random.default_rng(0)
    rows, columns = LOG_POLAR_SHAPE
    x = (rng.random((rows, columns)) * (side - 1)).astype(np.float32)
    y = (rng.random((rows, columns)) * (side - 1)).astype(np.float32)
    x.sort(axis=1)  # a remap reads along smooth curves
    y.sort(axis=0)
    log_polar = [cv2.remap(f, x, y, cv2.INTER_LINEAR) for f in frames]
    log_polar_spectra = [cv2.dft(f) for f in log_polar]
    turn = cv2.getRotationMatrix2D((side / 2, side / 2), 7.0, 1.03)
    inverse = cv2.DFT_INVERSE | cv2.DFT_SCALE

    def pair(k: int) -> None:
        cv2.dft(log_polar_spectra[k], flags=inverse)
        turned = cv2.warpAffine(frames[k], turn, (side, side), flags=cv2.INTER_LINEAR)
        cv2.dft(turned)
        cv2.dft(spectra[k], flags=inverse)
        cv2.warpAffine(frames[k], turn, (side, side), flags=cv2.INTER_LINEAR)

    def frame_and_pair(k: int) -> None:
        cv2.dft(frames[k])
        cv2.dft(cv2.remap(frames[k], x, y, cv2.INTER_LINEAR))
        pair(k)

    return frame_and_pair, pair


def _ratio(found: Found, above: str, below: str, rng: np.random.Generator) -> Interval:
    """Return the ratio of two medians, its interval by resampling each."""
    x, y = np.array(found[above]), np.array(found[below])
    drawn = [np.median(rng.choice(x, len(x))) / np.median(rng.choice(y, len(y))) for _ in range(400)]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return Interval(float(np.median(x) / np.median(y)), float(low), float(high))


def _absent() -> str:
    return method_named("imreg_dft").absent or "imreg_dft with its numiter of 3"
