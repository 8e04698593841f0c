"""Where one flight ends and the next begins, in a heap of photos of one camera body."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median

# Landing, a new battery, starting again. A lone long pause in the air (a turn, a wait) is shorter.
FLIGHT_GAP_S = 600.0
# A card's next folder (100MEDIA -> 101MEDIA) goes on within seconds.
FOLDER_GAP_S = 120.0


@dataclass(frozen=True, slots=True)
class Shot:
    """A photo as this file sees it: which one it is, when and where on disk it lies."""

    at: int
    path: Path
    time_s: float | None


def natural_key(path: Path | str) -> tuple[object, ...]:
    """Return a key that sorts IMG_9 before IMG_10; folders before the names within them."""
    words = re.split(r"(\d+)", str(path).lower())
    return tuple((0, int(w), "") if w.isdigit() else (1, 0, w) for w in words)


def split_flights(shots: Sequence[Shot]) -> list[list[Shot]]:
    """Return the flights of one camera body, in order of time, each in order of time, then of natural name.

    A folder is a flight of its own, unless the next folder goes on where it ends; and a flight ends where nothing was
    taken for ten minutes. Without times a folder is one flight. A photo without a time stays with its neighbours.
    """
    folders: dict[Path, list[Shot]] = {}
    for shot in sorted(shots, key=lambda s: natural_key(s.path)):
        folders.setdefault(shot.path.parent, []).append(shot)
    timed: list[list[tuple[float, Shot]]] = []
    untimed: list[list[Shot]] = []
    for folder in folders.values():
        filled = _fill(folder)
        if filled:
            timed.append(sorted(filled, key=lambda pair: pair[0]))  # stable: ties keep their names' order
        else:
            untimed.append(folder)
    timed.sort(key=lambda part: part[0][0])
    joined: list[list[tuple[float, Shot]]] = []
    for part in timed:
        if joined and 0.0 <= part[0][0] - joined[-1][-1][0] <= FOLDER_GAP_S:
            joined[-1].extend(part)
        else:
            joined.append(list(part))
    flights = [flight for part in joined for flight in _split_at_gaps(part)]
    flights.sort(key=lambda flight: flight[0][0])
    return [[shot for _, shot in flight] for flight in flights] + untimed


def _fill(folder: Sequence[Shot]) -> list[tuple[float, Shot]]:
    """Pair every photo with its time, or the time of the nearest named neighbour that has one; empty where none has."""
    known = next((s.time_s for s in folder if s.time_s is not None), None)
    if known is None:
        return []
    pairs = []
    for shot in folder:
        known = shot.time_s if shot.time_s is not None else known
        pairs.append((known, shot))
    return pairs


def _split_at_gaps(part: Sequence[tuple[float, Shot]]) -> list[list[tuple[float, Shot]]]:
    gaps = [b[0] - a[0] for a, b in pairwise(part)]
    usual = median(gaps) if gaps else 0.0
    limit = max(FLIGHT_GAP_S, 20.0 * usual)
    flights = [[part[0]]]
    for gap, pair in zip(gaps, part[1:], strict=True):
        if gap > limit:
            flights.append([])
        flights[-1].append(pair)
    return flights
