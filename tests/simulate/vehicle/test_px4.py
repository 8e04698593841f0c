"""The simulated PX4 does what its source says."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle import PX4

US = (254, 190)


class Wire:
    """Messages to a vehicle, packed and parsed as on a wire."""

    def __init__(self):
        self.vehicle = PX4()
        self.now_s = 0.0

    def send(self, message, source=US):
        packet = message.pack(mavlink.MAVLink(None, *source))
        self.vehicle.receive(mavlink.MAVLink(None).decode(bytearray(packet)), self.now_s)
        return self.heard()

    def heard(self):
        return [m for m in self.vehicle.take_outbox() if m.get_type() not in ("HEARTBEAT", "MISSION_CURRENT")]

    def count(self, n, kind=0):
        return self.send(mavlink.MAVLink_mission_count_message(1, 1, n, kind))

    def item(self, seq, command=16, frame=3, params=(0, 0, 0, 0), z=50.0, kind=0):
        return self.send(
            mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *params, 1, 1, z, kind)
        )

    def upload(self, n, **fields):
        self.count(n)
        for seq in range(n):
            last = self.item(seq, **fields)
        return last

    def ask(self, seq):
        return self.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))


@pytest.fixture
def wire():
    return Wire()


def test_it_swaps_at_the_end(wire):
    wire.upload(3, z=10.0)
    wire.count(2)
    wire.item(0, z=99.0)
    assert [i.z for i in wire.vehicle.lists[0]] == [10.0] * 3
    (ack,) = wire.item(1, z=99.0)
    assert ack.type == mavlink.MAV_MISSION_ACCEPTED and [i.z for i in wire.vehicle.lists[0]] == [99.0] * 2


def test_the_last_item_again_earns_the_ack_again(wire):
    wire.upload(2)
    (ack,) = wire.item(1)
    assert ack.type == mavlink.MAV_MISSION_ACCEPTED


def test_only_the_next_or_the_last_item_may_be_asked_for(wire):
    wire.upload(4)
    wire.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    for seq in (0, 0, 1, 2, 1):
        (answer,) = wire.ask(seq)
    assert answer.seq == 1 if answer.get_type() == "MISSION_ITEM_INT" else answer.type
    (answer,) = wire.ask(0) if wire.vehicle.does.name == "SENDS" else (answer,)
    assert answer.get_type() == "MISSION_ACK" and answer.type == mavlink.MAV_MISSION_ERROR


def test_a_new_count_in_mid_upload_is_an_error_until_cancelled(wire):
    wire.count(3)
    wire.item(0)
    assert wire.count(3)[0].type == mavlink.MAV_MISSION_ERROR
    wire.send(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0))
    assert wire.count(3)[0].get_type() == "MISSION_REQUEST_INT"


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"frame": 10}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"command": 178, "frame": 3}, mavlink.MAV_MISSION_UNSUPPORTED),
        ({"command": 9999, "frame": 2}, mavlink.MAV_MISSION_UNSUPPORTED),
    ],
)
def test_what_it_refuses(wire, fields, code):
    wire.count(1)
    assert wire.item(0, **fields)[0].type == code


def test_fence_polygons_need_three_vertices(wire):
    wire.count(2, kind=1)
    assert wire.item(0, command=5001, params=(2, 0, 0, 0), kind=1)[0].type == mavlink.MAV_MISSION_ERROR


def test_it_answers_with_int_frames_and_turned_yaw(wire):
    wire.upload(1, params=(0, 0, 0, -90.0))
    kept = wire.vehicle.lists[0][0]
    assert kept.frame == 6 and kept.params[3] == 270.0


def test_it_forgets_a_transfer_after_five_silent_seconds(wire):
    wire.count(3)
    wire.vehicle.tick(5.1)
    assert wire.vehicle.does.name == "NOTHING"
