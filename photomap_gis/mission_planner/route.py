"""In which order and direction to fly lanes: the hops between them as short as local search makes them.

Lanes are arcs that must each be flown once, either way (an arc routing problem): a boustrophedon and a nearest-lane
order are improved by 2-opt and Or-opt, and the better one is kept. Cells of a decomposition come out by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.free_space import FreeSpace
from photomap_gis.mission_planner.lanes import Lane

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_MOST_LANES = 700
_NEIGHBOURS = 10
_MOST_BLOCKED = 1500


def order_lanes(lanes: Sequence[Lane], home: FloatArray, free: FreeSpace, model: FlightModel) -> list[Lane]:
    """Return the lanes in the order and direction in which to fly them from home and back."""
    if len(lanes) > _MOST_LANES:
        half = len(lanes) // 2
        first = order_lanes(lanes[:half], home, free, model)
        return first + order_lanes(lanes[half:], first[-1].xy[-1], free, model)
    if not lanes:
        return []
    ports = _Ports(lanes, home, free, model)
    tours = [_improved(ports, start) for start in (ports.back_and_forth(), ports.nearest_first())]
    best = min(tours, key=ports.cost)
    return [lanes[p // 2] if p % 2 == 0 else lanes[p // 2].reversed() for p in best]


class _Ports:
    """The costs in seconds between lane ends; port 2 i is the start of lane i, 2 i + 1 its end.

    A tour is ``(N,)`` ports of entry; a lane is left by the other port, ``p ^ 1``.
    """

    def __init__(self, lanes: Sequence[Lane], home: FloatArray, free: FreeSpace, model: FlightModel) -> None:
        self.places = np.array([end for lane in lanes for end in (lane.xy[0], lane.xy[-1])])
        outward = np.array([_outward(lane, end) for lane in lanes for end in (0, 1)])
        hops = self.places[None] - self.places[:, None]
        length = np.hypot(hops[..., 0], hops[..., 1])
        direction = hops / np.maximum(length, 1e-9)[..., None]
        speed = model.speed_m_s
        leaving = speed * np.maximum(np.einsum("ijk,ik->ij", direction, outward), 0.0)
        entering = speed * np.maximum(np.einsum("ijk,jk->ij", direction, -outward), 0.0)
        most = np.sqrt(2.0 * model.accel_m_s2 * length)
        self.hop = model.leg_s(length, speed, np.minimum(leaving, most), np.minimum(entering, most))
        # what slowing down at the lanes' own ends costs belongs to the hop
        self.hop = self.hop + ((speed - leaving) ** 2 + (speed - entering) ** 2) / (2 * model.accel_m_s2 * speed)
        self.home = np.hypot(*(self.places - home).T) / speed
        if not free.is_open:
            self._go_around(free, length, speed)
        # home is the last port, which is also index -1
        self.full = np.zeros((len(self.home) + 1,) * 2)
        self.full[:-1, :-1] = self.hop
        self.full[-1, :-1] = self.full[:-1, -1] = self.home

    def _go_around(self, free: FreeSpace, length: FloatArray, speed: float) -> None:
        """Lengthen hops that a no-fly zone blocks: exactly between neighbours, by a guess between others."""
        n = len(self.places)
        a, b = np.triu_indices(n, 1)
        near = np.argsort(length, axis=1, kind="stable")[:, : _NEIGHBOURS + 2]
        close = np.zeros((n, n), bool)
        close[np.repeat(np.arange(n), near.shape[1]), near.ravel()] = True
        wanted = (close | close.T)[a, b] & (a // 2 != b // 2)
        a, b = a[wanted], b[wanted]
        blocked = ~free.sees(self.places[a], self.places[b])
        for k, (i, j) in enumerate(zip(a[blocked], b[blocked], strict=True)):
            way = free.path(self.places[i], self.places[j]) if k < _MOST_BLOCKED else None
            extra = length[i, j] if way is None else float(np.hypot(*np.diff(way, axis=0).T).sum()) - length[i, j]
            turns = 2 if way is None else len(way) - 2
            self.hop[i, j] += (extra + 10.0 * turns) / speed
            self.hop[j, i] = self.hop[i, j]

    def cost(self, tour: IntArray) -> float:
        return float(self.home[tour[0]] + self.hop[tour[:-1] ^ 1, tour[1:]].sum() + self.home[tour[-1] ^ 1])

    def back_and_forth(self) -> IntArray:
        count = len(self.places) // 2
        return np.array([2 * i + (i % 2) for i in range(count)], np.intp)

    def nearest_first(self) -> IntArray:
        count = len(self.places) // 2
        left = np.ones(2 * count, bool)
        port = int(np.argmin(self.home))
        tour = []
        while True:
            tour.append(port)
            left[[port, port ^ 1]] = False
            if len(tour) == count:
                return np.array(tour, np.intp)
            port = int(np.argmin(np.where(left, self.hop[port ^ 1], math.inf)))


def _unit(tip: FloatArray, inner: FloatArray) -> FloatArray:
    d = tip - inner
    return d / max(float(np.hypot(*d)), 1e-9)


def _outward(lane: Lane, end: int) -> FloatArray:
    if len(lane.xy) < 2:
        return np.zeros(2)
    return _unit(lane.xy[0], lane.xy[1]) if end == 0 else _unit(lane.xy[-1], lane.xy[-2])


def _improved(ports: _Ports, tour: IntArray, *, most_rounds: int = 40) -> IntArray:
    tour = tour.copy()
    for _ in range(most_rounds):
        if not (_two_opt(ports, tour) | _or_opt(ports, tour)):
            break
    return tour


def _two_opt(ports: _Ports, tour: IntArray) -> bool:
    """Turn stretches round wherever that shortens the tour; change it in place."""
    n, better = len(tour), False
    for i in range(n):
        leave = ports.hop[tour[i - 1] ^ 1] if i else ports.home
        old_in = leave[tour[i]]
        j = np.arange(i, n)
        exits, entries = tour[j] ^ 1, np.append(tour[i + 1 :], -1)
        old_out = np.where(entries >= 0, ports.hop[exits, entries], ports.home[exits])
        new_out = np.where(entries >= 0, ports.hop[tour[i], entries], ports.home[tour[i]])
        gain = old_in + old_out - leave[exits] - new_out
        k = int(np.argmax(gain))
        if gain[k] > 1e-6:
            tour[i : i + k + 1] = tour[i : i + k + 1][::-1] ^ 1
            better = True
    return better


def _or_opt(ports: _Ports, tour: IntArray) -> bool:
    """Move short stretches to where they fit better; change the tour in place. Port -1 is home."""
    n, better, full = len(tour), False, ports.full
    for size in (1, 2, 3):
        if n <= size:
            break
        for i in range(n - size + 1):
            part = tour[i : i + size].copy()
            rest = np.concatenate([tour[:i], tour[i + size :]])
            enter, leave = int(part[0]), int(part[-1] ^ 1)
            before = tour[i - 1] ^ 1 if i else -1
            after = tour[i + size] if i + size < n else -1
            gain = full[before, enter] + full[leave, after] - full[before, after]
            exits = np.concatenate([[-1], rest ^ 1])
            entries = np.concatenate([rest, [-1]])
            base = full[exits, entries]
            kept = full[exits, enter] + full[entries, leave] - base
            swapped = full[exits, leave] + full[entries, enter] - base
            k = int(np.argmin(np.minimum(kept, swapped)))
            if min(kept[k], swapped[k]) < gain - 1e-6:
                moved = part if kept[k] <= swapped[k] else part[::-1] ^ 1
                tour[:] = np.concatenate([rest[:k], moved, rest[k:]])
                better = True
    return better
