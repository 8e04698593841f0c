"""Section ``faults``: how many error frames are told, and how many sound ones are lost for it."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from statistics import median

import cv2

from benchmarks.registration.faults.broken import RIM, Kind, make_faulty
from benchmarks.registration.faults.cases import FAULTY_SHARE, NEAR, Case
from benchmarks.registration.faults.judging import Outcome, judge_case
from benchmarks.registration.faults.partly import LOST_ROWS, Loss, make_partly
from benchmarks.registration.faults.sound import Sound, available, make_sound
from benchmarks.registration.pictures import Part
from benchmarks.registration.report import Bar, Figure, Section, Table
from benchmarks.registration.running import Options
from benchmarks.registration.score import Interval, wilson

DETECTED, LOST = Bar(low=0.99), Bar(high=0.005)
FAULTY_COUNT = 2000
SOUND_SHARE, PARTLY_SHARE = 0.25, 0.1
"""Sound frames a kind, and partly lost ones a loss, as shares of the faulty frames a kind."""
RIM_SHARE = 0.3
"""About so many frames with corrupt blocks turn out to be damaged at the rim only; they do not count."""
SEED_STEP = 1_000_000
CHUNK = 20


@dataclass(frozen=True, slots=True)
class Batch:
    """Cases of one kind, by their seeds."""

    group: str
    kind: str
    seeds: tuple[int, ...]
    part: Part


def make_case(group: str, kind: str, seed: int, part: Part) -> Case:
    """Return a case by name."""
    if group == "faulty":
        return make_faulty(Kind(kind), seed, part)
    return make_sound(Sound(kind), seed, part) if group == "sound" else make_partly(Loss(kind), seed, part)


def judge_batch(batch: Batch) -> list[Outcome]:
    """Make and judge a batch's cases."""
    cv2.setNumThreads(1)
    return [judge_case(make_case(batch.group, batch.kind, seed, batch.part)) for seed in batch.seeds]


def batches(count: int, seed: int, part: Part) -> list[Batch]:
    """Return all batches for ``count`` faulty frames a kind."""
    more = 1.0 / (1.0 - RIM_SHARE)
    wanted = [("faulty", k.value, round(more * count) if k is Kind.BLOCKS else count) for k in Kind]
    wanted += [("sound", s.value, max(1, round(SOUND_SHARE * count))) for s in available(part)]
    wanted += [("partly", loss.value, max(1, round(PARTLY_SHARE * count))) for loss in Loss]
    out = []
    for group, kind, n in wanted:
        seeds = range(seed * SEED_STEP, seed * SEED_STEP + n)
        out += [Batch(group, kind, tuple(seeds[k : k + CHUNK]), part) for k in range(0, n, CHUNK)]
    return out


def measure(options: Options) -> Section:
    """Return the section for ``options.count`` faulty frames a kind."""
    todo = batches(options.count, options.seed, options.part)
    outcomes: list[Outcome] = []
    total = sum(len(b.seeds) for b in todo)
    for some in run(todo, options.processes):
        outcomes += some
        options.on_progress(len(outcomes), total)
    return section_of(outcomes)


def report(n: int, seed: int = 0, part: Part = "reporting", processes: int = 1) -> Section:
    """Return the section for ``n`` faulty frames a kind."""
    return measure(Options(n, seed, part, processes))


def run(todo: Sequence[Batch], processes: int = 1) -> Iterator[list[Outcome]]:
    """Yield each batch's outcomes, in order; the same in any number of processes."""
    if processes == 1:
        yield from map(judge_batch, todo)
        return
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(judge_batch, todo)


def section_of(outcomes: Sequence[Outcome]) -> Section:
    """Return figures and tables of what became of all cases."""
    kinds = [k.value for k in Kind]
    faulty = [o for o in outcomes if o.kind in kinds and o.variety != RIM]
    sound = [o for o in outcomes if not o.faulty]
    figures = [_share(f"{k}: detected", [o for o in faulty if o.kind == k], _detected, DETECTED) for k in kinds]
    figures.append(_share("sound frames lost", sound, _rejected, LOST))
    for side in sorted({256 if o.side_px <= 320 else 512 for o in outcomes}):
        figures.append(_cost(f"judgement at {side} px", [o for o in outcomes if (o.side_px > 320) == (side == 512)]))
    silent = [o for o in faulty if o.kind == Kind.BLOCKS and not o.suspect]
    if silent:
        figures.append(_share("blocks without the decoder's word: detected", silent, _detected, None))
    rim = [o for o in outcomes if o.variety == RIM]
    if rim:
        figures.append(_share("blocks at the rim only: detected", rim, _detected, None))
    tables = (_varieties(faulty), _sound_table(sound), _partly_table([o for o in outcomes if o.kind == "partly"]))
    return Section("faults", tuple(figures), tables, NOTES, {"misses": [_line(o) for o in misses(outcomes)]})


NOTES = (
    f"Faulty is a frame of which at least {FAULTY_SHARE:.0%} is damaged: shows what its clean picture shows nowhere "
    f"within {NEAR:.1%} of the width, brightness and a common displacement of the whole evened out. A decoder often "
    "conceals what was lost; such frames are drawn again.",
    "Detected is a frame that is rejected, or kept with the fault named and its place masked, or at least half of the "
    "damage of which is masked. Lost is a sound frame that is rejected.",
    "Blocks at the rim lie where the predecessor did not show the ground: only the next frame can tell. No bar.",
    "The decoder's word counts as it does in the product: a frame is judged knowing whether data was lost since the "
    "last key frame. Sound frames of which it says so are among the sound ones (mended stream).",
    "A frozen frame is judged knowing how far the camera moved before, as the motion of the frames before tells.",
    "A sound frame that is its predecessor to the bit in most places (the coder left it out) is drawn again.",
)


def misses(outcomes: Iterable[Outcome]) -> list[Outcome]:
    """Return faulty frames that passed, sound frames lost, and partly lost frames registered wrongly."""
    return [
        o
        for o in outcomes
        if o.wrong or (o.kind != "partly" and o.variety != RIM and (o.rejected if not o.faulty else not o.detected))
    ]


def _line(o: Outcome) -> str:
    return f"{o.kind} {o.variety} seed {o.seed}: {o.reason or 'passed'}"


def _detected(o: Outcome) -> bool:
    return o.detected


def _rejected(o: Outcome) -> bool:
    return o.rejected


def _share(name: str, of: Sequence[Outcome], test: Callable[[Outcome], bool], bar: Bar | None) -> Figure:
    return Figure(name, wilson(sum(map(test, of)), len(of)), len(of), "%", bar)


def _cost(name: str, of: Sequence[Outcome]) -> Figure:
    ms = sorted(o.ms for o in of)
    # most of all on the middle: other work on the machine makes the tail
    return Figure(name, Interval(median(ms), ms[len(ms) // 10], ms[9 * len(ms) // 10]), len(ms), "ms")


def _percent(count: int, of: int) -> str:
    return f"{100.0 * count / of:.1f}" if of else "-"


def _varieties(faulty: Sequence[Outcome]) -> Table:
    rows = []
    for kind, variety in sorted({(o.kind, o.variety) for o in faulty}):
        some = [o for o in faulty if (o.kind, o.variety) == (kind, variety)]
        n = len(some)
        shares = (
            sum(o.detected for o in some),
            sum(o.rejected for o in some),
            sum(o.alone for o in some),
            sum(o.masked > 0 for o in some),
        )
        rows.append((kind, variety, str(n), *(_percent(share, n) for share in shares), _names(some)))
    head = ("kind", "made by", "n", "detected %", "rejected %", "before registration %", "kept with mask %", "named")
    return Table("Error frames", head, tuple(rows))


def _names(some: Sequence[Outcome]) -> str:
    names = sorted({o.fault for o in some if o.fault}, key=lambda f: -sum(o.fault == f for o in some))
    return ", ".join(f"{f} {_percent(sum(o.fault == f for o in some), len(some))}" for f in names[:3])


def _sound_table(sound: Sequence[Outcome]) -> Table:
    rows = []
    for kind in dict.fromkeys(o.kind for o in sound):
        some = [o for o in sound if o.kind == kind]
        n = len(some)
        lost = wilson(sum(o.rejected for o in some), n)
        masked = [o.masked for o in some if o.masked > 0]
        rows.append(
            (kind, str(n), f"{100 * lost.value:.2f} [{100 * lost.low:.2f}, {100 * lost.high:.2f}]",
             _percent(sum(o.fault is not None and not o.rejected for o in some), n), _percent(len(masked), n),
             f"{100 * sum(masked) / len(masked):.1f}" if masked else "-")
        )  # fmt: skip
    head = ("sound frames", "n", "lost %", "kept, but named faulty %", "kept with mask %", "of their area %")
    return Table("Sound frames", head, tuple(rows))


def _partly_table(partly: Sequence[Outcome]) -> Table:
    rows = []
    for loss in dict.fromkeys(o.variety for o in partly):
        some = [o for o in partly if o.variety == loss]
        n = len(some)
        kept = [o for o in some if not o.rejected]
        rows.append(
            (loss, str(n), _percent(n - len(kept), n), _percent(sum(o.masked > 0 for o in kept), n),
             _percent(sum(o.masked == 0 for o in kept), n), _percent(sum(o.wrong for o in some), n))
        )  # fmt: skip
    head = ("instead of the rows", "n", "rejected %", "masked %", "unseen %", "registered wrongly %")
    return Table(f"Frames that lost {LOST_ROWS:.0%} of their rows", head, tuple(rows))
