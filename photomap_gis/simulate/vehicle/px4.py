"""PX4's side of the mission protocol, after its ``MavlinkMissionManager``: one transfer at a time, swapped in whole."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle.airframe import Airframe, Message, Partner
from photomap_gis.simulate.vehicle.stored import MISSION, OK, Stored, px4_keeps, taken_from

PX4_MISSION, PX4_HOLD = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24
_ASK_AGAIN_S, _GIVE_UP_S = 0.25, 5.0
_NO_TOTAL = 0xFFFF


class _Does(Enum):
    NOTHING = 0
    RECEIVES = 1
    SENDS = 2


@dataclass(slots=True)
class PX4(Airframe):
    """A simulated PX4 multicopter; it has no home item."""

    does: _Does = _Does.NOTHING
    partner: Partner = (0, 0)
    kind: int = MISSION
    seq: int = 0
    total: int = 0
    slot: list[Stored] = field(default_factory=list)
    asks_int: bool = True
    heard_s: float = 0.0
    sent_s: float = 0.0

    autopilot = mavlink.MAV_AUTOPILOT_PX4
    mission_mode = PX4_MISSION
    version = 0x010F0000

    def handle_mission(self, name: str, message: Message, partner: Partner) -> None:
        """Take a message of the mission protocol."""
        kind = getattr(message, "mission_type", -1)
        if kind not in self.lists:
            return
        if name == "MISSION_COUNT":
            self._begin(message, partner, kind)
        elif name in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._item(message, partner, kind)
        elif name == "MISSION_CLEAR_ALL":
            if self.does is _Does.NOTHING:
                self.lists[kind] = []
                self.ack(partner, OK, kind)
        elif name == "MISSION_REQUEST_LIST":
            self._list(partner, kind)
        elif name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self.asks_int = name == "MISSION_REQUEST_INT"
            self._give(message.seq, partner, kind)
        elif name == "MISSION_ACK" and partner == self.partner:
            is_cancel = message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
            if (self.does is _Does.SENDS and kind == self.kind) or (self.does is _Does.RECEIVES and is_cancel):
                self.does = _Does.NOTHING

    def keep_time(self) -> None:
        """Ask again after a quarter second, give up after five without a word."""
        if self.does is not _Does.NOTHING and self.now_s - self.heard_s > _GIVE_UP_S:
            self.does = _Does.NOTHING
        elif self.does is _Does.RECEIVES and self.now_s - self.sent_s > _ASK_AGAIN_S:
            self._ask()

    def forget_transfers(self) -> None:
        """Lose the transfer under way."""
        self.does, self.seq, self.slot = _Does.NOTHING, 0, []

    def mission_total(self) -> int:
        """Return the number of items, or the mark of an empty mission."""
        return self.count_for(MISSION) or _NO_TOTAL

    def _begin(self, message: Message, partner: Partner, kind: int) -> None:
        if self.does is _Does.RECEIVES:
            self.heard_s = self.now_s
            if partner != self.partner or self.seq > 0:
                self.ack(partner, mavlink.MAV_MISSION_ERROR, self.kind)
                return
            self._ask()
            return
        if self.does is _Does.SENDS:
            self.ack(partner, mavlink.MAV_MISSION_ERROR, self.kind)
            return
        self.partner, self.kind, self.heard_s = partner, kind, self.now_s
        if message.count > self.max_items or self.is_full:
            self.ack(partner, mavlink.MAV_MISSION_NO_SPACE, kind)
            return
        if message.count == 0:
            self.lists[kind] = []
            self.ack(partner, OK, kind)
            return
        self.does, self.seq, self.total, self.slot = _Does.RECEIVES, 0, message.count, []
        self._ask()

    def _item(self, message: Message, partner: Partner, kind: int) -> None:
        if partner != self.partner:
            return
        if kind != self.kind or self.does is _Does.SENDS:
            self.ack(partner, mavlink.MAV_MISSION_ERROR, self.kind)
            return
        if self.does is _Does.NOTHING:
            last_again = self.seq == message.seq + 1
            self.ack(partner, OK if last_again else mavlink.MAV_MISSION_ERROR, self.kind)
            return
        self.heard_s = self.now_s
        if message.seq != self.seq:
            return
        if self.meet_fate(message.seq):
            return
        verdict, item = px4_keeps(kind, taken_from(message))
        if message.command == self.faults.refuses_command:
            verdict = mavlink.MAV_MISSION_UNSUPPORTED
        if verdict != OK:
            self.ack(partner, verdict, kind)
            self.does = _Does.NOTHING
            return
        if self.faults.keeps_wrong and message.seq == 2:
            item = replace(item, x=item.x + 1000)
        self.slot.append(item)
        self.seq += 1
        if self.seq < self.total:
            self._ask()
            return
        self.does = _Does.NOTHING
        self.lists[kind], self.slot = self.slot, []
        self.faults.keeps_wrong = max(0, self.faults.keeps_wrong - 1)
        self.ack(partner, OK, kind)

    def _list(self, partner: Partner, kind: int) -> None:
        if self.does is _Does.SENDS and self.seq == self.total:
            self.does = _Does.NOTHING
        same = self.does is _Does.SENDS and kind == self.kind and partner == self.partner
        if self.does is not _Does.NOTHING and not same:
            return
        self.does, self.kind, self.partner, self.heard_s = _Does.SENDS, kind, partner, self.now_s
        self.seq, self.total = 0, self.count_for(kind)
        self.say(mavlink.MAVLink_mission_count_message(*partner, self.total, kind))

    def _give(self, seq: int, partner: Partner, kind: int) -> None:
        if partner != self.partner or self.does is not _Does.SENDS or kind != self.kind:
            return
        self.heard_s = self.now_s
        if seq == self.seq and self.seq < self.total:
            self.seq += 1
        elif seq != self.seq - 1:  # only the next item or the last one may be asked for
            self.does = _Does.NOTHING
            self.ack(partner, mavlink.MAV_MISSION_ERROR, kind)
            return
        self.send_item(partner, kind, seq, as_int=self.asks_int)

    def _ask(self) -> None:
        self.sent_s = self.now_s
        make = mavlink.MAVLink_mission_request_int_message if self.asks_int else mavlink.MAVLink_mission_request_message
        self.say(make(*self.partner, self.seq, self.kind))
