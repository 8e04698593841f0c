"""See how far the limits of the judgement hold: ``python -m benchmarks.registration.faults.calibrate [--count N]``.

Frames of the *tuning* pictures, faulty ones and sound ones that are hard to tell from them. For every witness that
judges by a limit, printed are the limit in use, how many sound and how many faulty frames lie beyond it, and the values
of the sound ones that come nearest. Nothing is written: the numbers are looked at, and limits are then set between.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2

from benchmarks.registration.faults.broken import Kind
from benchmarks.registration.faults.cases import Case
from benchmarks.registration.faults.measure import make_case
from benchmarks.registration.faults.sound import Sound, available
from photomap_gis.core.measurement import Registration
from photomap_gis.ifmi import FrameLook, judge_frame, look_at, make_spectrum, register
from photomap_gis.ifmi.frames import doubt as doubts
from photomap_gis.ifmi.frames import registered, rows
from photomap_gis.ifmi.frames.doubt import Doubt, doubt_of
from photomap_gis.ifmi.frames.drawn import drawn_out
from photomap_gis.ifmi.frames.rescue import register_part
from photomap_gis.ifmi.frames.rows import RowMotion, row_motion

FAULTY = (Kind.BLOCKS, Kind.TORN, Kind.BLURRED)
SOUND = (Sound.STRANGERS, Sound.PHOTOS, Sound.REAL, Sound.REPEATS, Sound.EDGES, Sound.TILT, Sound.BARE, Sound.CODED)
STRANGERS_TIMES = 4
NEAREST = 5


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """What the witnesses say of a frame that passed the first judgement."""

    case: Case
    found: Registration
    accepted: bool
    rows: RowMotion
    drawn_out: float
    doubt: Doubt

    @property
    def is_kin(self) -> bool:
        """Whether there is a sign of common ground."""
        return self.rows.known_share > 0.0 or self.found.probability >= registered.KIN_PROBABILITY


@dataclass(frozen=True, slots=True)
class Witness:
    """A limit: of which frames it decides, what it looks at, and the value in use."""

    name: str
    limit: float
    decides: Callable[[Sample], bool]
    value: Callable[[Sample], float]


def _of_strangers(s: Sample) -> bool:
    return not s.accepted and not s.is_kin


WITNESSES = (
    Witness("slanted rows (share)", rows.LEAST_SLANTED / 16, lambda s: not s.accepted, lambda s: s.rows.slanted_share),
    Witness("step between rows (of the width)", rows.LEAST_STEP, lambda s: not s.accepted, lambda s: s.rows.step),
    Witness("drawn out", registered.DRAWN_OUT, lambda s: not s.accepted, lambda s: s.drawn_out),
    Witness("smeared, other ground", doubts.STRANGE_SMEAR, _of_strangers, lambda s: s.doubt.smeared),
    Witness("blocky, other ground", doubts.STRANGE_BLOCKS, _of_strangers, lambda s: s.doubt.blocky),
    Witness("cornered, other ground", doubts.STRANGE_CORNERS, _of_strangers, lambda s: s.doubt.cornered),
    Witness("blurred, other ground", registered.BELIEVED_DOUBT, _of_strangers, lambda s: s.doubt.blurred),
    Witness("torn, other ground", doubts.STRANGE_TEAR, _of_strangers, lambda s: s.doubt.torn),
    Witness("probability: the same ground", registered.KIN_PROBABILITY, lambda s: not s.accepted and (
        s.case.faulty or s.case.kind == Sound.STRANGERS), lambda s: s.found.probability),
    Witness("skewed along its rows", registered.MOST_SKEWED, lambda s: s.accepted, lambda s: _skew(s.found)),
)  # fmt: skip


def _skew(found: Registration) -> float:
    return registered.skew(found.T_a_b.matrix if found.H_a_b is None else found.H_a_b)


def sample_of(case: Case) -> Sample | None:
    """Return what the witnesses say of a case; ``None`` where none of them is asked."""
    if case.previous is None or case.previous.shape != case.frame.shape:
        return None
    look, before = look_at(case.frame), look_at(case.previous)
    if not judge_frame(look, before, expected_px=case.expected_px).ok:
        return None
    spectrum = make_spectrum(case.previous)
    found = register(spectrum, make_spectrum(case.frame))
    if not found.accepted:
        found = register_part(spectrum, case.frame) or found
    drawn = drawn_out(look.coarse) - max(0.0, drawn_out(before.coarse))
    return Sample(case, found, found.accepted, _rows(look, before, found), drawn, doubt_of(look.traits, before.traits))


def _rows(look: FrameLook, before: FrameLook, found: Registration) -> RowMotion:
    return RowMotion(0.0, 0.0, 0.0, False) if found.accepted else row_motion(look, before)


def table(samples: Sequence[Sample]) -> list[str]:
    """Return a line for every witness."""
    lines = []
    for w in WITNESSES:
        asked = [s for s in samples if w.decides(s)]
        sound = sorted((w.value(s) for s in asked if not s.case.faulty), reverse=True)
        faulty = [w.value(s) for s in asked if s.case.faulty]
        nearest = ", ".join(f"{v:.2f}" for v in sound[:NEAREST])
        lines.append(
            f"{w.name}: limit {w.limit:.2f}; beyond it {sum(v > w.limit for v in sound)} of {len(sound)} sound, "
            f"{sum(v > w.limit for v in faulty)} of {len(faulty)} faulty; sound ones reach {nearest or '-'}"
        )
    return lines


def main(arguments: list[str] | None = None) -> int:
    """Print how far the limits hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration.faults.calibrate", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="frames a kind; four times of those of other ground")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    samples = []
    here = available("tuning")
    groups = [("faulty", k.value) for k in FAULTY] + [("sound", k.value) for k in SOUND if k in here]
    for group, kind in groups:
        times = STRANGERS_TIMES if kind == Sound.STRANGERS else 1
        for seed in range(chosen.seed, chosen.seed + times * chosen.count):
            found = sample_of(make_case(group, kind, seed, "tuning"))
            if found is not None:
                samples.append(found)
        print(f"{kind}: {sum(s.case.kind == kind for s in samples)}", file=sys.stderr)
    print("\n".join(table(samples)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
