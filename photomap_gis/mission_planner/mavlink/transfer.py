"""MAVLink's mission protocol for one list: upload, download, clear, as steps without a socket or a clock.

Sources: the MAVLink developer guide (mission microservice) and what ArduPilot's ``MissionItemProtocol`` and PX4's
``MavlinkMissionManager`` do:

- a vehicle may ask by MISSION_REQUEST (ArduPilot always does) or MISSION_REQUEST_INT: the answer is MISSION_ITEM_INT;
- the item that was asked for last is sent again unprompted, so that a lost one does not wait for the vehicle's second;
- INVALID_SEQUENCE leaves the transfer open and means that the vehicle is one item further than we heard;
- a last item that arrives twice earns ACCEPTED from PX4 and ERROR from ArduPilot: after the last item only reading back
  tells, never an ACK;
- PX4 must be told OPERATION_CANCELLED before a transfer may begin anew.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.mission_planner.mavlink import dialect as cmd
from photomap_gis.mission_planner.mavlink.state import Message
from photomap_gis.mission_planner.mavlink.talk import Steps, Talk
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, to_wire

_OK = mavlink.MAV_MISSION_ACCEPTED
_OUT_OF_SEQUENCE = mavlink.MAV_MISSION_INVALID_SEQUENCE
_NO_SPACE, _DENIED = mavlink.MAV_MISSION_NO_SPACE, mavlink.MAV_MISSION_DENIED
_MAY_PASS = {mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_OPERATION_CANCELLED, _DENIED, _OUT_OF_SEQUENCE}
_SAME_REFUSALS = {True: 4, False: 2}  # how often the same refusal is believed: of codes that may pass, of the others
_CLEAR_REFUSALS = 4
_BUSY_PAUSE_S, _NO_SPACE_PAUSE_S, _RETRY_PAUSE_S = 1.0, 2.0, 0.3
_SLOWEST_REQUEST_S = 1.5
_SLOWEST_ITEM_S = 5.0  # over a satellite; slower ones are given up
_MOST_AHEAD = 3
_FIRST_GAP_S, _LONGEST_GAP_S = 0.1, 0.4


class End(StrEnum):
    """How a transfer ended."""

    DONE = "done"
    REFUSED = "refused"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Transfer:
    """The end of a transfer; ``seq`` is the item that was refused (-1: the list as a whole), ``code`` the ACK's."""

    end: End
    items: tuple[WireItem, ...] = ()
    code: int = _OK
    seq: int = -1

    def reason(self, first_seq: int = 0) -> str:
        """Say why it ended so; items are counted from 1 for the one that has ``first_seq`` on the wire."""
        where = f"item {self.seq - first_seq + 1}" if self.seq >= first_seq else "the list"
        if self.end is End.REFUSED:
            return f"the vehicle refused {where} with {ack_name(self.code)}"
        return "the transfer failed again and again" if self.end is End.FAILED else "done"


def ack_name(code: int) -> str:
    """Return a ``MAV_MISSION_RESULT`` as a word, ``NO_SPACE``."""
    entry = mavlink.enums["MAV_MISSION_RESULT"].get(code)
    return entry.name.removeprefix("MAV_MISSION_") if entry else f"code {code}"


def upload(talk: Talk, kind: Kind, items: Sequence[WireItem]) -> Steps[Transfer]:
    """Send a list, from MISSION_COUNT again wherever an attempt fails; DONE means that it must now be read back."""
    give_up_s = talk.now_s + 3 * talk.patience.timeout_s + _SLOWEST_ITEM_S * len(items)
    refusals: dict[tuple[int, int], int] = {}
    while talk.now_s < give_up_s:
        attempt = yield from _upload_once(talk, kind, items, give_up_s)
        if attempt.end is End.DONE:
            return attempt
        if attempt.end is End.REFUSED:
            seen = refusals[attempt.code, attempt.seq] = refusals.get((attempt.code, attempt.seq), 0) + 1
            passing = attempt.code in _MAY_PASS
            if attempt.seq < 0 and attempt.code in (_NO_SPACE, _DENIED):
                return attempt  # it waited for its time already
            if seen >= _SAME_REFUSALS[passing]:
                return attempt
        talk.say(cancelled(talk, kind))
        yield from talk.pause(_RETRY_PAUSE_S)
    return Transfer(End.FAILED)


def _upload_once(talk: Talk, kind: Kind, items: Sequence[WireItem], give_up_s: float) -> Steps[Transfer]:
    asked = -1  # the item that the vehicle asked for last
    ahead = 0  # it said that it is past that one, its request was lost: so many further items are sent too
    sent = -1  # the furthest item that was sent
    news_s = start_s = talk.now_s
    full_s: float | None = None
    talk.say(_count(talk, kind, len(items)))
    again_s = talk.now_s + talk.patience.count_s
    while True:
        message = yield from talk.answer(min(again_s, news_s + talk.patience.stall_s, give_up_s))
        if message is None:
            if talk.now_s >= min(news_s + talk.patience.stall_s, give_up_s):
                return Transfer(End.FAILED, seq=asked)
            if asked < 0:
                talk.say(_count(talk, kind, len(items)))
                again_s = talk.now_s + talk.patience.count_s
            else:
                for seq in range(asked, min(asked + ahead + 1, len(items))):
                    talk.say(_item(talk, kind, seq, items[seq]))
                    sent = max(sent, seq)
                again_s = talk.now_s + talk.patience.item_s
            continue
        if getattr(message, "mission_type", None) != kind:
            continue
        if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            if message.seq >= len(items):
                continue  # of a transfer that is no more
            if message.seq != asked:
                news_s = talk.now_s
                talk.on_progress(kind.name.lower(), message.seq, len(items))
            asked, ahead = message.seq, 0
            sent = max(sent, asked)
            talk.say(_item(talk, kind, asked, items[asked]))
            again_s = talk.now_s + talk.patience.item_s
        elif message.get_type() == "MISSION_ACK":
            code, is_last = message.type, sent == len(items) - 1
            if code == _OUT_OF_SEQUENCE:
                ahead = min(ahead + 1, _MOST_AHEAD)
            elif code == _OK:
                if is_last:
                    talk.on_progress(kind.name.lower(), len(items), len(items))
                    return Transfer(End.DONE)
            elif asked < 0:
                if code == _NO_SPACE:
                    full_s = talk.now_s if full_s is None else full_s
                    if talk.now_s - full_s >= talk.patience.no_space_s:
                        return Transfer(End.REFUSED, code=code)
                    news_s, again_s = talk.now_s, talk.now_s + _NO_SPACE_PAUSE_S
                elif code == _DENIED:
                    if talk.now_s - start_s >= talk.patience.timeout_s:
                        return Transfer(End.REFUSED, code=code)
                    news_s, again_s = talk.now_s, talk.now_s + _BUSY_PAUSE_S
                elif code in _MAY_PASS:  # of an older attempt, or PX4 believes that it still receives
                    talk.say(cancelled(talk, kind))
                    again_s = talk.now_s + _RETRY_PAUSE_S
                else:
                    return Transfer(End.REFUSED, code=code)
            elif is_last and code == mavlink.MAV_MISSION_ERROR:
                return Transfer(End.DONE)  # ArduPilot's word for a last item that came twice; or it refused: read back
            else:
                return Transfer(End.REFUSED, code=code, seq=asked)


def download(
    talk: Talk, kind: Kind, *, serving: Sequence[WireItem] = (), stage: str = "read", give_up_s: float | None = None
) -> Steps[Transfer]:
    """Read a list; ``serving`` are the items of an upload that may still be open, so that it comes to its end.

    ``give_up_s`` is when to stop trying (FAILED); by default as long as the vehicle answers, within three timeouts.
    """
    until_s = give_up_s if give_up_s is not None else talk.now_s + 3 * talk.patience.timeout_s
    pace = _Pace(talk.patience.item_s)
    while talk.now_s < until_s:
        counted = yield from _ask_count(talk, kind, serving, until_s)
        if isinstance(counted, Transfer):
            return counted
        read = yield from _ask_items(talk, kind, counted, serving, until_s + _SLOWEST_ITEM_S * counted, pace, stage)
        if read is not None:
            talk.say(_ack(talk, kind, _OK))
            return Transfer(End.DONE, items=read)
        pace.slow_down()
        yield from talk.pause(_RETRY_PAUSE_S)
    return Transfer(End.FAILED)


@dataclass(slots=True)
class _Pace:
    """How long to wait for an item before it is asked for again: twice the link's round trip, within bounds.

    PX4 breaks a download off when it is asked for an item before the last one. A link that delivers late copies of our
    requests makes it do so: each time the copies are made rarer (``least_s``) and given time to arrive (``gap_s``).
    """

    least_s: float
    round_trip_s: float = 0.0
    gap_s: float = 0.0

    @property
    def wait_s(self) -> float:
        return max(self.least_s, min(2 * self.round_trip_s, _SLOWEST_REQUEST_S))

    def slow_down(self) -> None:
        self.least_s = min(2 * self.least_s, _SLOWEST_REQUEST_S)
        self.gap_s = min(max(2 * self.gap_s, _FIRST_GAP_S), _LONGEST_GAP_S)

    def learn(self, seconds: float) -> None:
        self.round_trip_s = seconds if self.round_trip_s == 0 else 0.8 * self.round_trip_s + 0.2 * seconds


def _ask_count(talk: Talk, kind: Kind, serving: Sequence[WireItem], until_s: float) -> Steps[int | Transfer]:
    again_s = talk.now_s
    unsupported = 0
    while talk.now_s < until_s:
        if talk.now_s >= again_s:
            talk.say(mavlink.MAVLink_mission_request_list_message(*talk.target, kind))
            again_s = talk.now_s + talk.patience.count_s
        message = yield from talk.answer(min(again_s, until_s))
        if message is None or getattr(message, "mission_type", None) != kind:
            continue
        if message.get_type() == "MISSION_COUNT":
            count: int = message.count
            return count
        if message.get_type() == "MISSION_ACK":
            if message.type == mavlink.MAV_MISSION_UNSUPPORTED:
                unsupported += 1
                if unsupported >= 2:
                    return Transfer(End.REFUSED, code=message.type)
            elif message.type == _DENIED:
                again_s = max(again_s, talk.now_s + _BUSY_PAUSE_S)
        else:
            _serve(talk, kind, serving, message)
    return Transfer(End.FAILED)


def _ask_items(
    talk: Talk, kind: Kind, count: int, serving: Sequence[WireItem], until_s: float, pace: _Pace, stage: str
) -> Steps[tuple[WireItem, ...] | None]:
    """Return all items; None where the vehicle broke off or its list changed meanwhile."""
    items: list[WireItem] = []
    for seq in range(count):
        if pace.gap_s and seq:
            yield from talk.pause(pace.gap_s)
        asked_s, tries = talk.now_s, 0
        again_s = talk.now_s
        while len(items) == seq:
            if talk.now_s >= again_s:
                if talk.now_s - asked_s > talk.patience.stall_s or talk.now_s > until_s:
                    return None
                talk.say(mavlink.MAVLink_mission_request_int_message(*talk.target, seq, kind))
                tries += 1
                again_s = talk.now_s + pace.wait_s
            message = yield from talk.answer(again_s)
            if message is None or getattr(message, "mission_type", None) != kind:
                continue
            name = message.get_type()
            if name in ("MISSION_ITEM_INT", "MISSION_ITEM") and message.seq == seq:
                if tries == 1:
                    pace.learn(talk.now_s - asked_s)
                items.append(_read_item(message))
                talk.on_progress(stage, seq + 1, count)
            elif _breaks_off(message, count):
                return None
            else:
                _serve(talk, kind, serving, message)
    return tuple(items)


def _breaks_off(message: Message, count: int) -> bool:
    if message.get_type() == "MISSION_COUNT":
        return bool(message.count != count)
    return message.get_type() == "MISSION_ACK" and message.type not in (_OK, _OUT_OF_SEQUENCE)


def _serve(talk: Talk, kind: Kind, serving: Sequence[WireItem], message: Message) -> None:
    if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(serving):
        talk.say(_item(talk, kind, message.seq, serving[message.seq]))


def clear(talk: Talk, kind: Kind) -> Steps[Transfer]:
    """Clear a list; DONE means that it must now be read back."""
    again_s, refusals = talk.now_s, 0
    give_up_s = talk.now_s + 3 * talk.patience.timeout_s
    while talk.now_s < give_up_s:
        if talk.now_s >= again_s:
            talk.say(mavlink.MAVLink_mission_clear_all_message(*talk.target, kind))
            again_s = talk.now_s + talk.patience.count_s
        message = yield from talk.answer(min(again_s, give_up_s))
        if message is None or message.get_type() != "MISSION_ACK" or message.mission_type != kind:
            continue
        if message.type == _OK:
            return Transfer(End.DONE)
        refusals += 1
        again_s = talk.now_s + _BUSY_PAUSE_S
        if refusals >= _CLEAR_REFUSALS and message.type != _DENIED:
            return Transfer(End.REFUSED, code=message.type)
    return Transfer(End.FAILED)


def _count(talk: Talk, kind: Kind, count: int) -> Message:
    return mavlink.MAVLink_mission_count_message(*talk.target, count, kind)


def cancelled(talk: Talk, kind: Kind) -> Message:
    """Return the word that a transfer is given up."""
    return _ack(talk, kind, mavlink.MAV_MISSION_OPERATION_CANCELLED)


def _ack(talk: Talk, kind: Kind, code: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(*talk.target, code, kind)


def _item(talk: Talk, kind: Kind, seq: int, item: WireItem) -> Message:
    # "current" stays 0: ArduPilot reads 2 and 3 there as orders to fly there at once.
    return mavlink.MAVLink_mission_item_int_message(
        *talk.target, seq, item.frame, item.command, 0, int(item.autocontinue), *item.params, item.x, item.y, item.z,
        kind,
    )  # fmt: skip


def _read_item(message: Message) -> WireItem:
    is_float = message.get_type() == "MISSION_ITEM"
    scaled = is_float and cmd.has_place(message.command)
    x, y = (v if math.isfinite(v) else 0.0 for v in (message.x, message.y))
    return WireItem(
        command=message.command,
        frame=message.frame,
        params=(message.param1, message.param2, message.param3, message.param4),
        x=to_wire(x) if scaled else round(x),
        y=to_wire(y) if scaled else round(y),
        z=message.z,
        autocontinue=bool(message.autocontinue),
        from_float=is_float,
    )
