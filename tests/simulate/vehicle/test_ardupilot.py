"""The simulated ArduPilot does what was measured on the real one."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle import ArduPilot, Misbehaviour
from photomap_gis.simulate.vehicle.ardupilot import COPTER_AUTO

US, OTHER = (254, 190), (255, 190)


class Wire:
    """Messages to a vehicle, packed and parsed as on a wire."""

    def __init__(self, vehicle):
        self.vehicle = vehicle
        self.now_s = 0.0

    def send(self, message, source=US):
        packet = message.pack(mavlink.MAVLink(None, *source))
        self.vehicle.receive(mavlink.MAVLink(None).decode(bytearray(packet)), self.now_s)
        return self.heard()

    def heard(self):
        return [m for m in self.vehicle.take_outbox() if m.get_type() not in ("HEARTBEAT", "MISSION_CURRENT")]

    def after(self, seconds):
        self.now_s += seconds
        self.vehicle.tick(self.now_s)
        return self.heard()

    def count(self, n, kind=0, source=US):
        return self.send(mavlink.MAVLink_mission_count_message(1, 1, n, kind), source)

    def item(self, seq, command=16, frame=3, params=(0, 0, 0, 0), x=1, y=1, z=50.0, kind=0, source=US):
        return self.send(
            mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *params, x, y, z, kind), source
        )

    def upload(self, n, kind=0, **fields):
        self.count(n, kind)
        for seq in range(n):
            last = self.item(seq, kind=kind, **fields)
        return last


@pytest.fixture
def wire():
    return Wire(ArduPilot())


def kinds(messages):
    return [m.get_type() for m in messages]


def test_it_asks_by_the_float_request_and_acks_at_the_end(wire):
    assert kinds(wire.count(2)) == ["MISSION_REQUEST"]
    assert kinds(wire.item(0)) == ["MISSION_REQUEST"]
    (ack,) = wire.item(1)
    assert ack.type == mavlink.MAV_MISSION_ACCEPTED and ack.target_system == 254


def test_count_cuts_the_mission_at_once(wire):
    wire.upload(5)
    wire.count(3)
    assert wire.vehicle.count_for(0) == 3


def test_a_wrong_seq_leaves_the_transfer_open(wire):
    wire.count(3)
    wire.item(0)
    (ack,) = wire.item(0)
    assert ack.type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    assert kinds(wire.item(1)) == ["MISSION_REQUEST"]


def test_a_refused_item_ends_it_with_new_items_and_the_old_tail(wire):
    wire.upload(5, z=10.0)
    wire.count(5)
    wire.item(0)
    wire.item(1, z=99.0)
    (ack,) = wire.item(2, params=(math.nan, 0, 0, 0))
    assert ack.type == mavlink.MAV_MISSION_INVALID_PARAM1
    assert [i.z for i in wire.vehicle.lists[0][1:]] == [99.0, 10.0, 10.0, 10.0]
    (ack,) = wire.item(2)
    assert ack.type == mavlink.MAV_MISSION_ERROR  # it is over


def test_it_asks_again_after_a_second_and_cancels_after_eight(wire):
    wire.count(3)
    wire.item(0)
    assert kinds(wire.after(0.9)) == []
    assert kinds(wire.after(0.2)) == ["MISSION_REQUEST"]
    for _ in range(6):
        wire.after(1.0)
    last = wire.after(1.1)
    assert last[-1].get_type() == "MISSION_ACK" and last[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED


def test_another_station_and_a_download_are_denied_meanwhile(wire):
    wire.count(3)
    (ack,) = wire.count(2, source=OTHER)
    assert ack.type == mavlink.MAV_MISSION_DENIED and ack.target_system == 255
    (ack,) = wire.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert ack.type == mavlink.MAV_MISSION_DENIED


def test_without_a_home_item_the_first_item_is_lost(wire):
    wire.upload(2, z=42.0)
    assert [i.z for i in wire.vehicle.lists[0]] == [100.0, 42.0]


def test_it_gives_back_less_than_it_got(wire):
    wire.count(3)
    wire.item(0)
    wire.item(1, frame=6, params=(1.9, 2, 0, math.nan), z=50.129)
    wire.item(2, command=206, frame=2, params=(12.5, 0, 1, 0))
    waypoint, trigger = wire.vehicle.lists[0][1:]
    assert (waypoint.frame, waypoint.params, waypoint.z) == (3, (1.0, 0, 0, 0), 50.12)
    assert (trigger.frame, trigger.params) == (0, (12.5, 0, 1, 0))


def test_rally_in_whole_metres_fence_without_autocontinue(wire):
    wire.upload(1, kind=2, command=5100, z=30.9)
    wire.upload(3, kind=1, command=5001, params=(3, 0, 0, 0))
    assert wire.vehicle.lists[2][0].z == 30.0 and wire.vehicle.lists[1][0].autocontinue == 0


@pytest.mark.parametrize(
    "fields",
    [
        {"z": math.nan},
        {"frame": 1},
        {"command": 214},
        {"command": 260},
        {"command": 206, "params": (9, math.nan, 0, 0)},
    ],
)
def test_what_it_refuses(wire, fields):
    wire.count(2)
    wire.item(0)
    (ack,) = wire.item(1, **fields)
    assert ack.type not in (mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_INVALID_SEQUENCE)


def test_clearing_in_auto_is_an_error(wire):
    wire.upload(3)
    wire.vehicle.armed, wire.vehicle.mode = True, COPTER_AUTO
    (ack,) = wire.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert ack.type == mavlink.MAV_MISSION_ERROR and wire.vehicle.count_for(0) == 3


def test_too_many_and_just_after_boot_there_is_no_space(wire):
    assert wire.count(651)[0].type == mavlink.MAV_MISSION_NO_SPACE
    wire.vehicle.faults = Misbehaviour(no_space_after_boot_s=5)
    assert wire.count(2)[0].type == mavlink.MAV_MISSION_NO_SPACE
    wire.after(6)
    assert kinds(wire.count(2)) == ["MISSION_REQUEST"]


def test_float_items_are_off_by_less_than_a_metre(wire):
    wire.upload(2, x=515_000_013, y=-1_491_650_017)
    wire.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    (item,) = wire.send(mavlink.MAVLink_mission_request_message(1, 1, 1, 0))
    packed = mavlink.MAVLink(None).decode(bytearray(item.pack(mavlink.MAVLink(None, 1, 1))))
    assert item.get_type() == "MISSION_ITEM" and 0 < abs(packed.y * 1e7 + 1_491_650_017) < 90


def test_mission_current_counts_without_home(wire):
    wire.upload(4)
    assert wire.vehicle.mission_total() == 3
