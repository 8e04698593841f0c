"""The weather of a link is as bad as it is said to be."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle import ArduPilot, VirtualLink, Weather
from photomap_gis.simulate.vehicle.channel import arrivals


def test_shares_of_loss_and_duplicates(rng: np.random.Generator):
    counts = np.array([len(arrivals(Weather(loss=0.3, duplicate=0.2), 0.0, rng)) for _ in range(20_000)])
    assert abs(np.mean(counts == 0) - 0.3) < 0.015
    assert abs(np.mean(counts[counts > 0] == 2) - 0.2) < 0.015


def test_delay_and_order(rng):
    steady = [arrivals(Weather(delay_s=0.1), n * 0.01, rng)[0] for n in range(100)]
    assert steady == sorted(steady) and steady[0] == 0.1
    mixed = [arrivals(Weather(delay_s=0.1, reorder=0.5), n * 0.01, rng)[0] for n in range(100)]
    assert mixed != sorted(mixed)


def test_the_clock_of_a_virtual_link_stops_where_it_is_told():
    link = VirtualLink(ArduPilot())
    heard = []
    while link.now_s() < 10.0:
        message = link.receive(10.0 - link.now_s())
        if message is not None:
            heard.append(message.get_type())
    assert link.now_s() == 10.0 and heard.count("HEARTBEAT") in (10, 11)


def test_two_runs_are_the_same():
    def run():
        link = VirtualLink(ArduPilot(), Weather(loss=0.3, reorder=0.2), seed=7)
        times = []
        while link.now_s() < 20.0:
            if link.receive(1.0) is not None:
                times.append(link.now_s())
            link.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        return times

    assert run() == run()
