"""How long a flight was flown by the autopilot and by hand: table 1 of the paper, from the changes of the flight mode.

The paper's overall time also holds set-up and the delivery of results; here it is what the log covers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

AIRBORNE_M = 1.0
"""Higher than this above take-off counts as flying."""
LONGEST_GAP_S = 10.0
"""A longer silence of the log tells nothing: it counts to the overall time alone."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A moment of a flight: its time and the height above take-off, ``None`` where the log does not tell it."""

    time_s: float
    height_m: float | None


@dataclass(frozen=True, slots=True)
class FlightTimes:
    """Seconds: flown by the autopilot, flown by hand, and covered by the log (on the ground, too).

    ``airborne_known`` is false where the log tells no height: then time on the ground counts as flown.
    """

    name: str
    autonomous_s: float
    manual_s: float
    overall_s: float
    airborne_known: bool = True


def flight_times(
    name: str, moments: Sequence[Moment], changes: Sequence[tuple[float, bool]], *, overall_s: float
) -> FlightTimes | None:
    """Return the times of one flight; ``None`` where no mode is known.

    ``moments`` are in order of time; ``changes`` are (time, whether the autopilot flies by itself from then on). What
    lies before the first change counts as by hand.

    >>> t = flight_times("f", [Moment(float(s), 5.0) for s in range(11)], [(0.0, False), (4.0, True)], overall_s=12.0)
    >>> t.autonomous_s, t.manual_s, t.overall_s
    (6.0, 4.0, 12.0)
    """
    if not changes:
        return None
    ordered = sorted(changes, key=lambda c: c[0])
    starts = [c[0] for c in ordered]
    known = any(m.height_m is not None for m in moments)
    seconds = {True: 0.0, False: 0.0}
    for a, b in pairwise(moments):
        if b.time_s - a.time_s > LONGEST_GAP_S or (known and (a.height_m is None or a.height_m < AIRBORNE_M)):
            continue
        cuts = [a.time_s, *(s for s in starts if a.time_s < s < b.time_s), b.time_s]
        for begin, end in pairwise(cuts):
            k = bisect_right(starts, begin) - 1
            seconds[ordered[k][1] if k >= 0 else False] += end - begin
    return FlightTimes(name, seconds[True], seconds[False], overall_s, known)
