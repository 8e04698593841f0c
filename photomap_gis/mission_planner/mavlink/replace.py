"""New lists in the place of old ones: sent, read back, compared; the old ones put back where that did not verify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink.compare import Comparison, compare
from photomap_gis.mission_planner.mavlink.report import Holds, Outcome
from photomap_gis.mission_planner.mavlink.talk import MissionModeEntered, Steps, Stopped, Talk, Unreachable
from photomap_gis.mission_planner.mavlink.transfer import End, Transfer, cancelled, clear, download, upload
from photomap_gis.mission_planner.mavlink.wire import Kind, Lists, WireItem, first_seq

ORDER = (Kind.FENCE, Kind.RALLY, Kind.MISSION)
"""The mission last: it is checked by some vehicles against the fence, and it is what flies."""

_ROUNDS = 3
_ARDUPILOT_CANCELS_S = 9.0


@dataclass(slots=True)
class Replaced:
    """How replacing ended."""

    outcome: Outcome
    holds: Holds
    message: str
    comparisons: dict[Kind, Comparison] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Put:
    """How one list's upload ended: the comparison where it could be read back, and why it is not right."""

    comparison: Comparison | None
    reason: str = ""

    @property
    def is_verified(self) -> bool:
        return self.comparison is not None and self.comparison.is_same


def replace_lists(talk: Talk, new: Lists, previous: Lists, *, puts_back: bool = True) -> Steps[Replaced]:
    """Replace the lists in ``new``; what they were is ``previous``, which is put back where the new do not verify.

    Never raises for what vehicle, link or user do: each of them is an outcome. ``puts_back`` is False where
    ``previous`` is not worth it: in finishing a restore.
    """
    autopilot = _autopilot(talk)
    comparisons: dict[Kind, Comparison] = {}
    touched: list[Kind] = []
    try:
        for kind in (k for k in ORDER if k in new):
            touched.append(kind)
            put = yield from _put(talk, kind, new[kind], autopilot)
            if put.comparison is not None:
                comparisons[kind] = put.comparison
            if not put.is_verified:
                why = f"{kind.name.lower()}: {put.reason}"
                break
        else:
            return Replaced(Outcome.VERIFIED, Holds.NEW, "read back and found as sent", comparisons)
    except Unreachable:
        return Replaced(Outcome.UNKNOWN, Holds.UNKNOWN, _may_hold(touched, autopilot, talk), comparisons)
    except MissionModeEntered:
        return (yield from _look_only(talk, touched, new, previous, comparisons))
    except Stopped:
        why = "stopped by the user"
        talk.heeds_stop = False
    if not puts_back:
        return (yield from _look(talk, touched, new, previous, comparisons, why))
    return (yield from _put_back(talk, touched, previous, comparisons, why))


def _put(talk: Talk, kind: Kind, items: Sequence[WireItem], autopilot: Autopilot) -> Steps[_Put]:
    """Upload a list and read it back, a few times."""
    last = _Put(None, "nothing was tried")
    first = first_seq(autopilot) if kind is Kind.MISSION else 0
    for _ in range(_ROUNDS):
        is_empty = len(items) <= first
        sent: Transfer = (yield from clear(talk, kind)) if is_empty else (yield from upload(talk, kind, items))
        if sent.end is not End.DONE:
            return _Put(last.comparison, sent.reason(first))
        for _ in range(2):  # an echo may be wrong itself
            read = yield from download(talk, kind, serving=items, stage=f"check {kind.name.lower()}")
            if read.end is not End.DONE:
                return _Put(last.comparison, f"it cannot be read back: {read.reason()}")
            comparison = compare(kind, items, read.items, autopilot)
            told = str(comparison.differences[0]) if comparison.differences else ""
            last = _Put(comparison, f"what was read back differs ({told})" if told else "")
            if comparison.is_same:
                return last
    return last


def _put_back(
    talk: Talk, touched: Sequence[Kind], previous: Lists, comparisons: Mapping[Kind, Comparison], why: str
) -> Steps[Replaced]:
    autopilot = _autopilot(talk)
    changed = False
    talk.heeds_stop = False  # putting back is the known end that a stop asks for
    try:
        for kind in reversed(touched):
            before = previous.get(kind, ())
            now = yield from download(talk, kind, stage=f"look {kind.name.lower()}")
            if now.end is End.DONE and compare(kind, before, now.items, autopilot).is_same:
                continue
            changed = True
            put = yield from _put(talk, kind, before, autopilot)
            if not put.is_verified:
                return Replaced(
                    Outcome.REFUSED,
                    Holds.MIXED,
                    f"{why}; and what the vehicle held before could not be put back ({kind.name.lower()}: "
                    f"{put.reason}): do not fly; finish with photomap upload --restore",
                    dict(comparisons),
                )
    except Unreachable:
        return Replaced(
            Outcome.UNKNOWN, Holds.UNKNOWN, f"{why}; {_may_hold(touched, autopilot, talk)}", dict(comparisons)
        )
    except MissionModeEntered:
        ended = yield from _look_only(talk, touched, {}, previous, comparisons)
        return Replaced(ended.outcome, ended.holds, f"{why}; {ended.message}", ended.comparisons)
    if changed:
        return Replaced(
            Outcome.RESTORED, Holds.PREVIOUS, f"{why}; what the vehicle held before was put back", dict(comparisons)
        )
    return Replaced(Outcome.REFUSED, Holds.PREVIOUS, f"{why}; the vehicle holds what it held before", dict(comparisons))


def _look_only(
    talk: Talk, touched: Sequence[Kind], new: Lists, previous: Lists, comparisons: Mapping[Kind, Comparison]
) -> Steps[Replaced]:
    """Say what the vehicle holds, without changing anything: it flies by it."""
    talk.forbids_mission_mode = False
    why = f"the vehicle went to {talk.vehicle.mode} in mid upload, which was stopped at once"
    try:
        if _autopilot(talk) is Autopilot.PX4:
            for kind in touched:
                talk.say(cancelled(talk, kind))
        else:
            yield from talk.pause(min(_ARDUPILOT_CANCELS_S, talk.patience.timeout_s / 2))  # until it lets us read
    except (Unreachable, Stopped):
        pass
    return (yield from _look(talk, touched, new, previous, comparisons, why))


def _look(
    talk: Talk,
    touched: Sequence[Kind],
    new: Lists,
    previous: Lists,
    comparisons: Mapping[Kind, Comparison],
    why: str,
) -> Steps[Replaced]:
    autopilot = _autopilot(talk)
    is_new = bool(new) and set(touched) == set(new)
    is_previous = True
    held: list[str] = []
    talk.heeds_stop = False
    try:
        for kind in touched:
            read = yield from download(talk, kind, stage=f"look {kind.name.lower()}")
            if read.end is not End.DONE:
                words = f"{why}; {kind.name.lower()} cannot be read ({read.reason()}); {_HINT}"
                return Replaced(Outcome.REFUSED, Holds.MIXED, words, dict(comparisons))
            same_new = kind in new and compare(kind, new[kind], read.items, autopilot).is_same
            same_before = compare(kind, previous.get(kind, ()), read.items, autopilot).is_same
            is_new, is_previous = is_new and same_new, is_previous and same_before
            if same_new or same_before:
                held.append(f"the {kind.name.lower()} is {'the new' if same_new else 'as before'}")
            else:
                held.append(_mixture(kind, read.items, new.get(kind, ()), previous.get(kind, ()), autopilot))
    except Unreachable:
        return Replaced(
            Outcome.UNKNOWN, Holds.UNKNOWN, f"{why}; {_may_hold(touched, autopilot, talk)}", dict(comparisons)
        )
    if is_previous:
        return Replaced(
            Outcome.REFUSED, Holds.PREVIOUS, f"{why}; the vehicle holds what it held before", dict(comparisons)
        )
    if is_new:
        return Replaced(Outcome.REFUSED, Holds.NEW, f"{why}; the vehicle holds the new lists whole", dict(comparisons))
    return Replaced(Outcome.REFUSED, Holds.MIXED, f"{why}; {'; '.join(held)}; {_HINT}", dict(comparisons))


_HINT = "leave that mode, do not fly by it, then finish with photomap upload --restore"


def _mixture(
    kind: Kind, read: Sequence[WireItem], new: Sequence[WireItem], before: Sequence[WireItem], autopilot: Autopilot
) -> str:
    """Say how many items at the front are the new ones."""
    count = 0
    while count < min(len(read), len(new)) and compare(
        kind, new[: count + 1], read[: count + 1], autopilot
    ).is_same:  # fmt: skip
        count += 1
    home = first_seq(autopilot) if kind is Kind.MISSION else 0
    if count == len(read):
        total = f"of {len(new) - home} new {kind.name.lower()} items"
        return f"{total} it holds the first {max(0, count - home)} and no others"
    return (
        f"it holds a mixture: of {len(read) - home} {kind.name.lower()} items the first {max(0, count - home)} are "
        "new, the rest is as before"
    )


def _may_hold(touched: Sequence[Kind], autopilot: Autopilot, talk: Talk) -> str:
    names = ", ".join(kind.name.lower() for kind in touched) or "nothing"
    what = (
        "a mixture of the new and the old (ArduPilot replaces items in place), or the old cut short"
        if autopilot is Autopilot.ARDUPILOT
        else "the old or the new, each whole (PX4 swaps them at the end)"
    )
    return (
        f"the vehicle did not answer for {talk.patience.timeout_s:g} s while {names} was under way: it may hold "
        f"{what}; do not fly by it; finish with photomap upload --restore as soon as the link is back"
    )


def _autopilot(talk: Talk) -> Autopilot:
    autopilot = talk.vehicle.autopilot
    if autopilot is None:
        raise ValueError("the vehicle is neither ArduPilot nor PX4")
    return autopilot
