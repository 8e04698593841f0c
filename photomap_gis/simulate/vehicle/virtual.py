"""A vehicle at the other end of a link in simulated time: hours of noisy radio in seconds, the same in every run."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle.airframe import Airframe, Message
from photomap_gis.simulate.vehicle.channel import Weather, arrivals

_TICK_S = 0.05


class VirtualLink:
    """A ground station's link to a vehicle: a clock, ``send`` and ``receive``; messages are packed and parsed.

    ``at`` is called at every tick with the time and the link: for what a pilot or another station does then.
    """

    def __init__(
        self,
        vehicle: Airframe,
        weather: Weather = Weather(),  # noqa: B008 - a frozen value
        *,
        seed: int = 0,
        address: tuple[int, int] = (254, 190),
        at: Callable[[float, VirtualLink], None] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.weather = weather
        self.sent = 0
        self._at = at
        self._rng = np.random.default_rng(seed)
        self._now_s = 0.0
        self._tick_s = 0.0
        self._number = itertools.count()
        self._flying: list[tuple[float, int, bool, bytes]] = []  # arrival, order, upwards, packet
        self._ours = mavlink.MAVLink(None, *address)
        self._theirs = mavlink.MAVLink(None, vehicle.system, 1)

    def now_s(self) -> float:
        """Return the simulated time."""
        return self._now_s

    def send(self, message: Message) -> None:
        """Send a message to the vehicle."""
        self.sent += 1
        self._throw(message.pack(self._ours), upwards=True)

    def inject(self, message: Message, address: tuple[int, int]) -> None:
        """Let another station speak to the vehicle, without loss."""
        packet = message.pack(mavlink.MAVLink(None, *address))
        heapq.heappush(self._flying, (self._now_s, next(self._number), True, packet))

    def receive(self, timeout_s: float) -> Message | None:
        """Let time pass until a message arrives, at most ``timeout_s``."""
        end_s = self._now_s + timeout_s
        while True:
            first_s = self._flying[0][0] if self._flying else end_s
            if min(first_s, self._tick_s) > end_s or (first_s >= end_s and self._tick_s >= end_s):
                self._now_s = end_s
                return None
            if self._tick_s <= first_s:
                self._now_s = max(self._now_s, self._tick_s)
                self._tick_s = self._now_s + _TICK_S
                if self._at is not None:
                    self._at(self._now_s, self)
                self.vehicle.tick(self._now_s)
                self._collect()
                continue
            arrival_s, _, upwards, packet = heapq.heappop(self._flying)
            self._now_s = max(self._now_s, arrival_s)
            message = _parsed(packet)
            if not upwards:
                return message
            self.vehicle.receive(message, self._now_s)
            self._collect()

    def _collect(self) -> None:
        for message in self.vehicle.take_outbox():
            self._throw(message.pack(self._theirs), upwards=False)

    def _throw(self, packet: bytes, *, upwards: bool) -> None:
        for arrival_s in arrivals(self.weather, self._now_s, self._rng):
            heapq.heappush(self._flying, (arrival_s, next(self._number), upwards, bytes(packet)))


def _parsed(packet: bytes) -> Message:
    return mavlink.MAVLink(None).decode(bytearray(packet))
