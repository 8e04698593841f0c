"""ArduPilot's side of the mission protocol, after its ``MissionItemProtocol``.

It replaces items in place and asks for them by MISSION_REQUEST.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle.airframe import Airframe, Message, Partner
from photomap_gis.simulate.vehicle.stored import FENCE, MISSION, OK, Stored, ardupilot_keeps, taken_from

COPTER_AUTO, COPTER_LOITER, COPTER_STABILIZE = 3, 5, 0
_ASK_AGAIN_S, _CANCEL_S = 1.0, 8.0
_DO_JUMP = 177


@dataclass(slots=True)
class _Receiving:
    """An upload under way."""

    kind: int
    partner: Partner
    count: int
    next: int
    heard_s: float
    asked_s: float
    fence: list[Stored] = field(default_factory=list)


@dataclass(slots=True)
class ArduPilot(Airframe):
    """A simulated ArduPilot Copter; its mission's item 0 is home and cannot be written."""

    receiving: dict[int, _Receiving] = field(default_factory=dict)

    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    mission_mode = COPTER_AUTO
    version = 0x04070000

    def handle_mission(self, name: str, message: Message, partner: Partner) -> None:
        """Take a message of the mission protocol."""
        kind = getattr(message, "mission_type", -1)
        if kind not in self.lists:
            if name != "MISSION_ACK":
                self.ack(partner, mavlink.MAV_MISSION_UNSUPPORTED, kind if kind >= 0 else MISSION)
            return
        if name == "MISSION_COUNT":
            self._begin(message, partner, kind)
        elif name in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._item(message, partner, kind)
        elif name == "MISSION_CLEAR_ALL":
            self._clear(partner, kind)
        elif name in ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_REQUEST"):
            if kind in self.receiving:
                self.ack(partner, mavlink.MAV_MISSION_DENIED, kind)
            elif name == "MISSION_REQUEST_LIST":
                self.say(mavlink.MAVLink_mission_count_message(*partner, self.count_for(kind), kind))
            else:
                self._give(message.seq, partner, kind, as_int=name == "MISSION_REQUEST_INT")

    def keep_time(self) -> None:
        """Ask again after a second, cancel after eight."""
        for kind, upload in list(self.receiving.items()):
            if self.now_s - upload.heard_s > _CANCEL_S:
                del self.receiving[kind]
                self.ack(upload.partner, mavlink.MAV_MISSION_OPERATION_CANCELLED, kind)
            elif self.now_s - upload.asked_s > _ASK_AGAIN_S:
                self._ask(upload)

    def forget_transfers(self) -> None:
        """Lose the uploads under way."""
        self.receiving.clear()

    def mission_total(self) -> int:
        """Return the number of items without home."""
        return max(0, self.count_for(MISSION) - 1)

    def _begin(self, message: Message, partner: Partner, kind: int) -> None:
        upload = self.receiving.get(kind)
        if upload is not None and upload.partner != partner:
            self.ack(partner, mavlink.MAV_MISSION_DENIED, kind)
            return
        if message.count > self.max_items or self.is_full:
            self.ack(partner, mavlink.MAV_MISSION_NO_SPACE, kind)
            return
        if kind != FENCE:
            del self.lists[kind][message.count :]  # at once, before any item has come
        if message.count == 0:
            self.lists[kind] = []
            self.receiving.pop(kind, None)
            self.ack(partner, OK, kind)
            return
        self.receiving[kind] = _Receiving(kind, partner, message.count, 0, self.now_s, self.now_s)
        self._ask(self.receiving[kind])

    def _item(self, message: Message, partner: Partner, kind: int) -> None:
        upload = self.receiving.get(kind)
        if upload is None:
            self.ack(partner, mavlink.MAV_MISSION_ERROR, kind)
            return
        if message.seq != upload.next:
            self.ack(partner, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)
            return
        if partner != upload.partner:
            self.ack(partner, mavlink.MAV_MISSION_DENIED, kind)
            return
        if self.meet_fate(message.seq):
            return
        verdict = self._store(message, upload)
        if verdict != OK:
            self.ack(partner, verdict, kind)
            del self.receiving[kind]
            return
        upload.heard_s = self.now_s
        upload.next += 1
        if upload.next < upload.count:
            self._ask(upload)
            return
        if kind == FENCE:
            self.lists[FENCE] = upload.fence
        del self.receiving[kind]
        self.faults.keeps_wrong = max(0, self.faults.keeps_wrong - 1)
        self.ack(partner, OK, kind)

    def _store(self, message: Message, upload: _Receiving) -> int:
        verdict, item = ardupilot_keeps(upload.kind, taken_from(message))
        if message.command == self.faults.refuses_command:
            verdict = mavlink.MAV_MISSION_UNSUPPORTED
        if verdict != OK:
            return verdict
        if upload.kind == MISSION and item.command == _DO_JUMP and not 0 < item.params[0] < upload.count:
            return mavlink.MAV_MISSION_ERROR
        if self.faults.keeps_wrong and message.seq == 2:
            item = replace(item, x=item.x + 1000)
        if upload.kind == FENCE:
            upload.fence.append(item)
            return OK
        if upload.kind == MISSION and message.seq == 0:
            item = self._home_item()
        stored = self.lists[upload.kind]
        if message.seq < len(stored):
            stored[message.seq] = item
        elif message.seq == len(stored):
            stored.append(item)
        else:
            return mavlink.MAV_MISSION_ERROR
        return OK

    def _home_item(self) -> Stored:
        lat, lon, alt_m = self.home or (0.0, 0.0, 0.0)
        return Stored(16, 0, (0.0,) * 4, round(lat * 1e7), round(lon * 1e7), alt_m)

    def _give(self, seq: int, partner: Partner, kind: int, *, as_int: bool) -> None:
        if seq < self.count_for(kind):
            self.send_item(partner, kind, seq, as_int=as_int)
            return
        if kind == MISSION:
            self.say(mavlink.MAVLink_mission_count_message(*partner, self.count_for(kind), kind))
        self.ack(partner, mavlink.MAV_MISSION_ERROR, kind)

    def _clear(self, partner: Partner, kind: int) -> None:
        if kind in self.receiving or (kind == MISSION and self.mode == COPTER_AUTO and self.armed):
            self.ack(partner, mavlink.MAV_MISSION_ERROR, kind)
            return
        self.lists[kind] = []
        self.ack(partner, OK, kind)

    def _ask(self, upload: _Receiving) -> None:
        upload.asked_s = self.now_s
        self.say(mavlink.MAVLink_mission_request_message(*upload.partner, upload.next, upload.kind))
