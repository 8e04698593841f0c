"""A simulated vehicle as a process of its own, over real UDP or TCP on the loopback interface.

It is steered by lines of JSON on stdin (``{"mode": "AUTO"}``, ``{"fly": true}``, ``{"reboot": true}``,
``{"dump": true}``) and answers on stdout, first with ``{"event": "ready", "port": ...}``. A dump is the vehicle's true
content, which no protocol has touched.
"""

from __future__ import annotations

import heapq
import json
import select
import socket
import sys
import time
from dataclasses import asdict
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.simulate.vehicle.airframe import Airframe
from photomap_gis.simulate.vehicle.ardupilot import COPTER_AUTO, COPTER_LOITER, ArduPilot
from photomap_gis.simulate.vehicle.channel import Weather, arrivals
from photomap_gis.simulate.vehicle.flying import Flier
from photomap_gis.simulate.vehicle.px4 import PX4_HOLD, PX4_MISSION

_TICK_S = 0.02
_LOOPBACK = "127.0.0.1"
_READ_BYTES = 65_536


class Server:
    """The sockets of one vehicle: TCP (a client at a time, as a simulator's serial port) or UDP."""

    def __init__(
        self,
        vehicle: Airframe,
        *,
        scheme: str,
        port: int,
        weather: Weather,
        seed: int,
        key: bytes | None = None,
        flier: Flier | None = None,
    ) -> None:
        self._vehicle, self._flier = vehicle, flier
        self._weather = weather
        self._rng = np.random.default_rng(seed)
        self._is_tcp = scheme == "tcp"
        self._client: socket.socket | None = None
        self._peers: set[tuple[str, int]] = set()
        self._out = mavlink.MAVLink(self, srcSystem=vehicle.system, srcComponent=1)
        self._out.robust_parsing = True
        if key is not None:
            self._out.signing.secret_key = key
            self._out.signing.sign_outgoing = True
            self._out.signing.timestamp = 1
        self._late: list[tuple[float, int, bool, bytes]] = []
        self._number = 0
        self._open = True
        self._stdin_open = True
        if self._is_tcp:
            self._socket = socket.create_server((_LOOPBACK, port))
        else:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            if scheme == "udpout":  # to a ground station that listens
                self._peers.add((_LOOPBACK, port))
            else:
                self._socket.bind((_LOOPBACK, port))
        self._socket.setblocking(False)
        self._say({"event": "ready", "port": self._socket.getsockname()[1] if scheme != "udpout" else port})

    def run(self) -> None:
        """Serve until stdin says quit or closes."""
        while self._open:
            sources: list[Any] = [self._socket, *([self._client] if self._client else [])]
            if self._stdin_open:
                sources.append(sys.stdin)
            wait_s = min(_TICK_S, max(0.0, self._late[0][0] - time.monotonic())) if self._late else _TICK_S
            for source in select.select(sources, [], [], wait_s)[0]:
                if source is sys.stdin:
                    self._order(sys.stdin.readline())
                elif source is self._socket and self._is_tcp:
                    self._hang_up()
                    self._client = self._socket.accept()[0]
                else:
                    self._take(source)
            self._deliver()
            self._vehicle.tick(time.monotonic())
            if self._flier is not None:
                self._flier.tick(time.monotonic())
            self._answer()

    def write(self, packet: bytes) -> None:
        """Take a packed message from pymavlink; it leaves when the weather lets it."""
        self._throw(bytes(packet), upwards=False)

    def _take(self, source: socket.socket) -> None:
        try:
            data, address = source.recvfrom(_READ_BYTES)
        except OSError:
            data, address = b"", None
        if self._is_tcp and not data:
            self._hang_up()
        if data and not self._is_tcp:
            self._peers.add(address)
        for message in self._out.parse_buffer(data) or ():
            if message.get_type() != "BAD_DATA":
                self._throw(bytes(message.get_msgbuf()), upwards=True)

    def _throw(self, packet: bytes, *, upwards: bool) -> None:
        for arrival_s in arrivals(self._weather, time.monotonic(), self._rng):
            self._number += 1
            heapq.heappush(self._late, (arrival_s, self._number, upwards, packet))

    def _deliver(self) -> None:
        while self._late and self._late[0][0] <= time.monotonic():
            _, _, upwards, packet = heapq.heappop(self._late)
            if upwards:
                reader = mavlink.MAVLink(None)
                boots = self._vehicle.boots
                self._vehicle.receive(reader.decode(bytearray(packet)), time.monotonic())
                if self._vehicle.boots != boots:
                    self._hang_up()
                self._answer()
            elif self._is_tcp:
                if self._client is not None:
                    try:
                        self._client.sendall(packet)
                    except OSError:
                        self._hang_up()
            else:
                for peer in self._peers:
                    self._socket.sendto(packet, peer)

    def _answer(self) -> None:
        for message in self._vehicle.take_outbox():
            self._out.send(message)

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def _order(self, line: str) -> None:
        if not line:
            self._open = False
            return
        order = json.loads(line)
        vehicle = self._vehicle
        if "mode" in order:
            is_ardupilot = isinstance(vehicle, ArduPilot)
            modes = (
                {"AUTO": COPTER_AUTO, "LOITER": COPTER_LOITER}
                if is_ardupilot
                else {"AUTO": PX4_MISSION, "LOITER": PX4_HOLD}
            )
            vehicle.set_mode(modes[order["mode"]])
        if order.get("fly") and self._flier is not None:
            self._flier.start(time.monotonic())
        if order.get("reboot"):
            vehicle.reboot()
            self._hang_up()
        if order.get("dump"):
            self._say({"lists": {str(k): [asdict(i) for i in items] for k, items in vehicle.lists.items()},
                       "current": vehicle.current, "mode": vehicle.mode, "armed": vehicle.armed})  # fmt: skip
        if order.get("quit"):
            self._open = False

    def _say(self, document: dict[str, Any]) -> None:
        sys.stdout.write(json.dumps(document) + "\n")
        sys.stdout.flush()
