"""Judge cases as the product does: the frame, its predecessor, then their registration."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.registration.faults.cases import Case
from benchmarks.registration.faults.partly import WRONG_SHARE, error_share
from photomap_gis.core.measurement import Registration
from photomap_gis.ifmi import FrameVerdict, judge_frame, judge_registered, look_at, make_spectrum, register
from photomap_gis.ifmi.frames.rescue import register_part

COVERED = 0.5
"""A faulty frame counts as detected, too, where so much of its damage is masked though no fault is named."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a case.

    ``fault`` is the name given, ``reason`` its words, ``masked`` the share of the frame that is masked of a frame that
    is kept. ``alone`` tells that it was rejected before any registration. ``ms`` is the CPU time of the judgement
    without the registration, at working size ``side_px``. ``wrong`` tells of partly lost frames that the frame is kept
    and its registration, masked where there is a mask, is accepted and wrong. ``suspect`` is the decoder's word.
    """

    kind: str
    variety: str
    seed: int
    faulty: bool
    detected: bool
    rejected: bool
    fault: str | None
    reason: str | None
    masked: float
    alone: bool
    ms: float
    side_px: int
    wrong: bool = False
    suspect: bool = False


def judge_case(case: Case) -> Outcome:
    """Return what the product says of a case."""
    before = None if case.previous is None else look_at(case.previous)
    start = time.process_time()
    look = look_at(case.frame)
    first = verdict = judge_frame(look, before, expected_px=case.expected_px)
    seconds = time.process_time() - start
    found: Registration | None = None
    if first.ok and case.previous is not None and before is not None and case.previous.shape == case.frame.shape:
        spectrum = make_spectrum(case.previous)
        found = register(spectrum, make_spectrum(case.frame))
        shown = found if found.accepted else register_part(spectrum, case.frame) or found
        start = time.process_time()
        verdict = judge_registered(look, before, shown, doubt=first.doubt, suspect=case.suspect)
        seconds += time.process_time() - start
    detected = not verdict.ok or verdict.fault is not None or _covers(verdict, case)
    return Outcome(
        str(case.kind),
        str(case.variety),
        case.seed,
        case.faulty,
        detected,
        not verdict.ok,
        None if verdict.fault is None else verdict.fault.value,
        verdict.reason,
        verdict.lost_share if verdict.ok and verdict.mask is not None else 0.0,
        not first.ok,
        1e3 * seconds,
        max(case.frame.shape),
        _is_wrong(case, verdict, found),
        case.suspect,
    )


def _covers(verdict: FrameVerdict, case: Case) -> bool:
    if verdict.mask is None or case.damaged is None or not case.damaged.any():
        return False
    return float(np.mean(~verdict.mask[case.damaged])) > COVERED


def _is_wrong(case: Case, verdict: FrameVerdict, found: Registration | None) -> bool:
    if case.H_previous_frame is None or not verdict.ok or found is None or case.previous is None:
        return False
    if verdict.mask is not None:
        found = register(make_spectrum(case.previous), make_spectrum(case.frame, mask=verdict.mask))
    return found.accepted and error_share(found.T_a_b.matrix, case) > WRONG_SHARE
