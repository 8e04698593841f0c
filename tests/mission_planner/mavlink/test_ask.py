"""Who is on a link, and what is made of what it says."""

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import LinkError
from photomap_gis.core.mission import Autopilot, Home
from photomap_gis.mission_planner.mavlink.ask import Wanted, ask_params, ask_state, find_vehicle, set_current
from photomap_gis.mission_planner.mavlink.state import distance_m, first_state, is_vehicle, mode_name, updated
from photomap_gis.mission_planner.mavlink.talk import HEARTBEAT_EVERY_S, Address, Patience, Talk, converse
from photomap_gis.mission_planner.mavlink.watch import watch
from photomap_gis.simulate.vehicle import PX4, ArduPilot, Misbehaviour, VirtualLink, Weather


def beat(system=1, component=1, autopilot=3, kind=2, custom=5, base=0, status=4):
    message = mavlink.MAVLink_heartbeat_message(kind, autopilot, base, custom, status, 3)
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, system, component))))


def said(message, component=1):
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 1, component))))


@pytest.fixture
def talk() -> Talk:
    return Talk(Address(254, 190), Patience())


class Crowd:
    """A link on which several components speak."""

    def __init__(self, *beats):
        self.beats = list(beats)
        self.time_s = 0.0
        self.heard = []

    def now_s(self):
        return self.time_s

    def send(self, message):
        self.heard.append((self.time_s, message.get_type()))

    def receive(self, timeout_s):
        if self.beats:
            self.time_s += 0.1
            return self.beats.pop(0)
        self.time_s += timeout_s
        return None


def test_only_autopilots_are_vehicles():
    assert is_vehicle(beat())
    assert not is_vehicle(beat(autopilot=mavlink.MAV_AUTOPILOT_INVALID, kind=mavlink.MAV_TYPE_GCS))
    assert not is_vehicle(beat(component=154, autopilot=mavlink.MAV_AUTOPILOT_INVALID, kind=mavlink.MAV_TYPE_GIMBAL))
    assert not is_vehicle(beat(kind=mavlink.MAV_TYPE_ONBOARD_CONTROLLER))


def test_a_vehicle_is_found_among_stations_gimbals_and_cameras(talk):
    station = beat(255, 190, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GCS)
    gimbal = beat(7, 154, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GIMBAL)
    state = converse(talk, find_vehicle(talk, Wanted(), 10.0), Crowd(station, gimbal, beat(7), station))
    assert (state.system, state.autopilot, state.mode) == (7, Autopilot.ARDUPILOT, "LOITER")


def test_several_vehicles_are_not_guessed_between(talk):
    with pytest.raises(LinkError, match=r"1, 9.*--system"):
        converse(talk, find_vehicle(talk, Wanted(), 10.0), Crowd(beat(9), beat(1)))
    talk = Talk(Address(254, 190), Patience())
    assert converse(talk, find_vehicle(talk, Wanted(9), 10.0), Crowd(beat(1), beat(9))).system == 9


def test_nobody_is_none_after_the_whole_time(talk):
    crowd = Crowd()
    assert converse(talk, find_vehicle(talk, Wanted(), 10.0), crowd) is None
    assert crowd.time_s >= 10.0


def test_our_heartbeat_goes_out_once_a_second(talk):
    crowd = Crowd()
    converse(talk, find_vehicle(talk, Wanted(), 10.0), crowd)
    times = [t for t, kind in crowd.heard if kind == "HEARTBEAT"]
    assert times[0] == 0.0 and all(b - a == pytest.approx(HEARTBEAT_EVERY_S) for a, b in pairwise(times))


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_vehicle_that_streams_nothing_is_asked(talk, loss):
    link = VirtualLink(ArduPilot(home=(51.0, 7.0, 90.0)), Weather(loss=loss))

    def steps():
        yield from find_vehicle(talk, Wanted(), 10.0)
        yield from ask_state(talk, 10.0)

    converse(talk, steps(), link)
    state = talk.vehicle
    assert state.home == Home(51.0, 7.0, 90.0) and state.version == "4.7.0-dev" and state.landed
    assert (state.battery_v, state.battery_percent, state.satellites) == (15.9, 87, 14)


def test_parameters_that_are_not_there_are_left_out(talk):
    link = VirtualLink(ArduPilot(params={"FENCE_ENABLE": 1.0}), Weather(loss=0.2))

    def steps():
        yield from find_vehicle(talk, Wanted(), 10.0)
        return (yield from ask_params(talk, ["FENCE_ENABLE", "NO_SUCH"], 5.0))

    assert converse(talk, steps(), link) == {"FENCE_ENABLE": 1.0}


def test_a_current_item_that_cannot_be_set_is_told(talk):
    def steps():
        yield from find_vehicle(talk, Wanted(), 10.0)
        return (yield from set_current(talk, 5, 5, 5.0))

    assert converse(talk, steps(), VirtualLink(ArduPilot())) is False


def test_watching_tells_again_and_again_and_ends_with_the_link(talk):
    told = []
    vehicle = PX4()
    converse(talk, watch(talk, Wanted(), every_s=1.0, times=5, tell=told.append), VirtualLink(vehicle))
    assert len(told) == 5 and all(s.lat_deg == 51.5 for s in told)
    silent = PX4(faults=Misbehaviour(boot_s=1e9))
    talk = Talk(Address(254, 190), Patience(timeout_s=10.0))

    def at(now_s, link):
        if now_s > 8 and not silent.boots:
            silent.reboot()

    with pytest.raises(LinkError, match="silent"):
        converse(talk, watch(talk, Wanted(), every_s=1.0, times=None, tell=told.append), VirtualLink(silent, at=at))


@pytest.mark.parametrize(
    ("autopilot", "kind", "custom", "name"),
    [
        (Autopilot.ARDUPILOT, 2, 3, "AUTO"),
        (Autopilot.ARDUPILOT, 13, 3, "AUTO"),
        (Autopilot.ARDUPILOT, 1, 10, "AUTO"),
        (Autopilot.ARDUPILOT, 22, 10, "AUTO"),
        (Autopilot.ARDUPILOT, 47, 10, "AUTO"),
        (Autopilot.ARDUPILOT, 10, 10, "AUTO"),
        (Autopilot.ARDUPILOT, 43, 3, "AUTO"),
        (Autopilot.ARDUPILOT, 2, 27, "AUTO_RTL"),
        (Autopilot.ARDUPILOT, 2, 199, "mode 199"),
        (Autopilot.PX4, 2, 4 << 16 | 4 << 24, "MISSION"),
        (Autopilot.PX4, 2, 4 << 16 | 3 << 24, "LOITER"),
    ],
)
def test_modes(autopilot, kind, custom, name):
    assert mode_name(autopilot, kind, custom) == name


def test_who_flies_its_mission():
    auto = first_state(beat(custom=3), 0.0)
    assert auto.flies_mission and not auto.is_in_air and not auto.armed
    px4 = first_state(beat(autopilot=12, custom=4 << 16 | 4 << 24), 0.0)
    assert not px4.flies_mission  # it rests in this mode on the ground
    assert updated(px4, beat(autopilot=12, custom=4 << 16 | 4 << 24, base=128), 1.0).flies_mission


def test_a_gimbals_heartbeat_does_not_change_the_mode():
    state = first_state(beat(custom=3), 0.0)
    other = beat(component=154, autopilot=mavlink.MAV_AUTOPILOT_INVALID, kind=mavlink.MAV_TYPE_GIMBAL, custom=0)
    assert updated(state, other, 1.0).mode == "AUTO"


def test_what_is_not_known_is_none():
    state = first_state(beat(), 0.0)
    state = updated(state, said(mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 65535)), 1.0)
    state = updated(state, said(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0)), 1.0)
    assert (state.lat_deg, state.battery_v, state.battery_percent) == (None, None, None)


def test_a_vehicles_text_cannot_reach_the_terminal():
    state = updated(first_state(beat(), 0.0), said(mavlink.MAVLink_statustext_message(4, b"\x1b[2Jhello\x07")), 1.0)
    assert state.text == "[2Jhello"


def test_items_are_counted_from_1_for_people():
    current = said(mavlink.MAVLink_mission_current_message(3, 10))
    ardupilot = updated(first_state(beat(), 0.0), current, 1.0)
    px4 = updated(first_state(beat(autopilot=12), 0.0), current, 1.0)
    assert ardupilot.as_json()["mission"] == {"current": 3, "total": 10}
    assert px4.as_json()["mission"] == {"current": 4, "total": 10}


def test_distances():
    assert distance_m(51.5, 7.4, 51.5, 7.4) == 0.0
    assert distance_m(0.0, 179.999, 0.0, -179.999) == pytest.approx(222.39, abs=0.01)
