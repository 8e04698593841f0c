"""Whatever a link or a vehicle says, a run ends with a report that claims nothing."""

import json
import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.mission_planner.mavlink.link import MavlinkLink
from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, upload_mission
from photomap_gis.mission_planner.mavlink.state import first_state, is_vehicle, updated
from photomap_gis.mission_planner.mavlink.talk import Address, Patience, Talk, converse

ME, VEHICLE = Address(254, 190), mavlink.MAVLink(None, 1, 1)


def parsed(message):
    return mavlink.MAVLink(None).decode(bytearray(message.pack(VEHICLE)))


HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 5, 4, 3)


class Noise:
    """A transport that reads random bytes, and messages of every kind with random payloads."""

    def __init__(self, rng):
        self.rng = rng

    def write(self, packet, system):
        pass

    def close(self):
        pass

    def read(self, timeout_s):
        if self.rng.random() < 0.3:
            return self.rng.randbytes(self.rng.randrange(1, 300))
        kind = self.rng.choice(list(mavlink.mavlink_map.values()))
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        packet = bytearray(message._pack(VEHICLE, kind.crc_extra, self.rng.randbytes(kind.unpacker.size)))
        if self.rng.random() < 0.2:
            packet[self.rng.randrange(len(packet))] ^= 1 << self.rng.randrange(8)
        return bytes(packet)


@pytest.mark.parametrize("key", [None, bytes(32)])
def test_noise_is_parsed_and_any_message_is_taken_note_of(key):
    rng = random.Random(20261125)
    link = MavlinkLink(Noise(rng), ME, key=key)
    state = first_state(parsed(HEARTBEAT), 0.0)
    kinds = set()
    for _ in range(4000):
        message = link.receive(0.0)
        if message is not None:
            kinds.add(message.get_type())
            is_vehicle(message)
            state = updated(state, message, 1.0)
            json.dumps(state.as_json(), allow_nan=False)
    assert len(kinds) > 100 if key is None else kinds <= {"RADIO_STATUS", "RADIO"}, kinds


class Liar:
    """A vehicle that answers anything with anything, in simulated time."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.time_s = 0.0
        self.beat_s = 0.0

    def now_s(self):
        return self.time_s

    def send(self, message):
        pass

    def receive(self, timeout_s):
        step_s = self.rng.uniform(0.0, 0.3)
        if step_s > timeout_s:
            self.time_s += timeout_s
            return None
        self.time_s += step_s
        if self.time_s >= self.beat_s:
            self.beat_s = self.time_s + 1.0
            return parsed(HEARTBEAT)
        us, kind = (254, 190), self.rng.randrange(3)
        number = self.rng.choice([0, 1, 2, 3, 5, 65535])
        real = self.rng.choice([0.0, 1.0, float("nan"), float("inf"), -1e30])
        place = self.rng.choice([0, 515_000_000, -(2**31), 2**31 - 1])
        params = [real] * 4
        return parsed(
            self.rng.choice(
                [
                    mavlink.MAVLink_mission_count_message(*us, number, kind),
                    mavlink.MAVLink_mission_request_message(*us, number, kind),
                    mavlink.MAVLink_mission_request_int_message(*us, number, kind),
                    mavlink.MAVLink_mission_ack_message(*us, self.rng.randrange(20), kind),
                    mavlink.MAVLink_mission_item_int_message(
                        *us, number, 3, 16, 0, 1, *params, place, place, real, kind
                    ),
                    mavlink.MAVLink_mission_item_message(*us, number, 3, 16, 0, 1, *params, real, real, real, kind),
                    mavlink.MAVLink_mission_current_message(number),
                    mavlink.MAVLink_command_ack_message(512, number % 5, 0, 0, *us),
                ]
            )
        )


@pytest.mark.parametrize("seed", range(25))
def test_a_vehicle_that_answers_anything_is_never_believed(seed, make_survey):
    talk = Talk(ME, Patience(timeout_s=5.0))
    link = Liar(seed)
    report = converse(
        talk,
        upload_mission(talk, make_survey(6), UploadOptions(), save=lambda s, lists: "", say=lambda words: None),
        link,
    )
    assert report.outcome in ("refused", "unknown", "restored") and report.holds != "new"
    json.dumps(report.as_json(), allow_nan=False)
    assert link.time_s < 3600
