"""One side of a conversation with a vehicle, without a socket and without a clock.

What is said to a vehicle is written as generators (``Steps``): each ``yield`` names a moment until which it waits,
and is sent the vehicle's next message, or None at that moment. ``converse`` lends them a link; in tests and benchmarks
that is a simulated vehicle under a simulated clock.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.mission_planner.mavlink.state import Message, VehicleState, updated

T = TypeVar("T")
Steps = Generator[float, "Message | None", T]
"""Yields the moment (seconds of the link's clock) until which it waits; is sent a message, or None at that moment."""

HEARTBEAT_EVERY_S = 1.0
_MAVLINK_2, _SIGNED = 0xFD, 1


class Unreachable(Exception):
    """The vehicle answered nothing for the whole stated time."""


class MissionModeEntered(Exception):
    """The vehicle began to fly its mission while that mission was being replaced."""


class Stopped(Exception):
    """The user asked to stop."""


class Link(Protocol):
    """What ``converse`` needs: a clock in seconds, and messages both ways."""

    def now_s(self) -> float:
        """Return the clock."""

    def send(self, message: Message) -> None:
        """Send a message; a link that is down drops it."""

    def receive(self, timeout_s: float) -> Message | None:
        """Return the next message, None where none came within the time."""


@dataclass(frozen=True, slots=True)
class Address:
    """A system and component id of MAVLink."""

    system: int
    component: int


@dataclass(frozen=True, slots=True)
class Patience:
    """Seconds that the exchange waits. ``timeout_s`` without any answer makes a vehicle unreachable."""

    timeout_s: float = 60.0
    item_s: float = 0.25
    count_s: float = 1.0
    stall_s: float = 10.0  # ArduPilot itself gives up a transfer after 8 s
    no_space_s: float = 30.0  # just after boot the storage says that it is full


class Talk:
    """The memory of one conversation: who we are, what the vehicle said of itself, what is waiting to be sent."""

    def __init__(
        self,
        me: Address,
        patience: Patience,
        *,
        on_progress: Callable[[str, int, int], None] | None = None,
        signs: bool = False,
    ) -> None:
        self.me = me
        self.signs = signs
        self.hears_signed = False
        self.patience = patience
        self.on_progress = on_progress or (lambda stage, done, total: None)
        self.now_s = 0.0
        self.outbox: list[Message] = []
        self.state: VehicleState | None = None
        self.last_answer_s = 0.0
        self.stop_asked = False
        self.heeds_stop = True
        self.forbids_mission_mode = False

    def begin(self, now_s: float) -> None:
        """Set the clock before the first step."""
        self.now_s = self.last_answer_s = now_s

    def say(self, message: Message) -> None:
        """Put a message in the outbox."""
        self.outbox.append(message)

    def hear(self, message: Message, now_s: float) -> bool:
        """Take note of a message; say whether it is the vehicle's, so that the steps want it."""
        self.now_s = now_s
        if self.state is None:
            return True
        if message.get_srcSystem() != self.state.system:
            return False
        if message.get_type() == "HEARTBEAT" and message.get_srcComponent() != self.state.component:
            return False  # a gimbal or camera of the same vehicle
        self.hears_signed = self.hears_signed or is_signed(message.get_msgbuf())
        if self.state.component == message.get_srcComponent():
            self.state = updated(self.state, message, now_s)
        return True

    @property
    def silence(self) -> str:
        """What is said of a vehicle that is heard and does not answer."""
        words = f"the vehicle sends but did not answer for {self.patience.timeout_s:g} s"
        if self.hears_signed and not self.signs:
            words += " (it signs its messages: give --signing-key)"
        return words

    @property
    def vehicle(self) -> VehicleState:
        """The vehicle that was found."""
        if self.state is None:
            raise ValueError("the vehicle is not known yet: find it first")
        return self.state

    @property
    def target(self) -> tuple[int, int]:
        """The vehicle's system and component, as messages begin."""
        return self.vehicle.system, self.vehicle.component

    def wait(self, until_s: float) -> Steps[Message | None]:
        """Wait for the vehicle's next message of any kind; None at ``until_s``.

        Raises ``Stopped`` or ``MissionModeEntered`` where that has come about.
        """
        self._check()
        if self.now_s >= until_s:
            return None
        message = yield until_s
        self._check()
        return message

    def answer(self, until_s: float) -> Steps[Message | None]:
        """Wait for the vehicle's next answer to us: a message of the mission or command protocols; None at the end.

        Raises ``Unreachable`` where none came for the stated time, and what ``wait`` raises.
        """
        while True:
            if self.now_s - self.last_answer_s > self.patience.timeout_s:
                raise Unreachable
            message = yield from self.wait(until_s)
            if message is None:
                return None
            if self._is_answer(message):
                self.last_answer_s = self.now_s
                return message

    def pause(self, seconds: float) -> Steps[None]:
        """Let time pass."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            yield from self.wait(until_s)

    def _is_answer(self, message: Message) -> bool:
        if message.get_type() not in _ANSWERS or message.get_srcComponent() != self.vehicle.component:
            return False
        target = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
        return target[0] in (0, self.me.system) and target[1] in (0, self.me.component)

    def _check(self) -> None:
        if self.stop_asked and self.heeds_stop:
            raise Stopped
        if self.forbids_mission_mode and self.state is not None and self.state.flies_mission:
            raise MissionModeEntered


_ANSWERS = {
    "MISSION_COUNT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_ACK",
    "COMMAND_ACK", "PARAM_VALUE",
}  # fmt: skip


def converse(talk: Talk, steps: Steps[T], link: Link) -> T:
    """Run steps over a link to their end, with our own heartbeat once a second, and return what they return."""
    talk.begin(link.now_s())
    beat_s = talk.now_s
    try:
        until_s = next(steps)
        while True:
            talk.now_s = link.now_s()
            if talk.now_s >= beat_s:
                link.send(heartbeat())
                beat_s = talk.now_s + HEARTBEAT_EVERY_S
            for message in talk.outbox:
                link.send(message)
            talk.outbox.clear()
            wait_s = max(0.0, min(until_s, beat_s) - link.now_s())
            heard = link.receive(wait_s)
            talk.now_s = link.now_s()
            if heard is not None and talk.hear(heard, talk.now_s):
                until_s = steps.send(heard)
            if talk.now_s >= until_s or (talk.stop_asked and talk.heeds_stop):
                until_s = steps.send(None)
    except StopIteration as end:
        for message in talk.outbox:
            link.send(message)
        talk.outbox.clear()
        result: T = end.value
        return result


def is_signed(packet: bytes) -> bool:
    """Whether a packet carries a signature; pymavlink tells only of those that it could check."""
    return len(packet) > 2 and packet[0] == _MAVLINK_2 and bool(packet[2] & _SIGNED)


def heartbeat() -> Message:
    """Return a ground station's heartbeat."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
