"""Addresses, sockets, signing, telemetry logs: over real loopback sockets."""

import os
import socket
import threading

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.errors import DataError, LinkError, OutputError, UsageError
from photomap_gis.mission_planner.mavlink.link import MavlinkLink, read_signing_key
from photomap_gis.mission_planner.mavlink.talk import Address, heartbeat
from photomap_gis.vehicle_link import TcpClient, TcpServer, Udp, Url, open_transport, parse_url

ME, VEHICLE = Address(254, 190), Address(1, 1)


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpin:0.0.0.0:14550", Url("udpin", "0.0.0.0", 14550)),
        ("udp:127.0.0.1:14551", Url("udp", "127.0.0.1", 14551)),
        ("udp://:14540", Url("udp", "0.0.0.0", 14540)),
        ("udpout:10.0.0.2:14550", Url("udpout", "10.0.0.2", 14550)),
        ("TCP:localhost", Url("tcp", "localhost", 5760)),
        ("tcp://127.0.0.1:5762", Url("tcp", "127.0.0.1", 5762)),
        ("tcpin:0.0.0.0:5760", Url("tcpin", "0.0.0.0", 5760)),
        ("127.0.0.1:14550", Url("udp", "127.0.0.1", 14550)),
        ("serial:/dev/ttyUSB0:115200", Url("serial", "/dev/ttyUSB0", 115_200)),
        ("serial:///dev/ttyUSB0:57600", Url("serial", "/dev/ttyUSB0", 57_600)),
        ("/dev/ttyACM0", Url("serial", "/dev/ttyACM0", 57_600)),
        ("/dev/ttyACM0,115200", Url("serial", "/dev/ttyACM0", 115_200)),
        ("COM3:57600", Url("serial", "COM3", 57_600)),
    ],
)
def test_addresses(text, url):
    assert parse_url(text) == url


@pytest.mark.parametrize("text", ["", "vehicle", "tcp:127.0.0.1:x", "udp:127.0.0.1:99999", "serial:", "http://a:80"])
def test_what_is_no_address_is_told_with_examples(text):
    with pytest.raises(UsageError, match="udpin"):
        parse_url(text)


def test_a_serial_port_that_is_not_there():
    with pytest.raises(LinkError, match="cannot be opened"):
        open_transport(parse_url("serial:/dev/no-such-port"))


def test_a_port_that_is_taken():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(LinkError, match="in use"):
            open_transport(Url("udpin", "127.0.0.1", port))
        open_transport(Url("udp", "127.0.0.1", port)).close()  # then it is the vehicle's port


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _pair(kind, port):
    if kind == "udp":
        listening = Udp(listens_at=("127.0.0.1", port), sends_to=None)
        return listening, Udp(listens_at=None, sends_to=("127.0.0.1", port))
    return TcpServer("127.0.0.1", port), TcpClient("127.0.0.1", port)


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_messages_both_ways(kind, port):
    ours, theirs = _pair(kind, port)
    with MavlinkLink(ours, ME) as a, MavlinkLink(theirs, VEHICLE) as b:

        def relay():
            while (heard := b.receive(5.0)) is not None:
                if heard.get_type() == "MISSION_REQUEST_LIST":
                    b.send(mavlink.MAVLink_mission_count_message(254, 190, 7, 0))
                    return

        b.receive(0.3)  # a TCP client connects when it first reads
        b.send(heartbeat())
        thread = threading.Thread(target=relay)
        thread.start()
        first = a.receive(5.0)
        assert first.get_type() == "HEARTBEAT" and first.get_srcSystem() == 1
        a.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        answer = a.receive(5.0)
        thread.join()
        assert (answer.get_type(), answer.count) == ("MISSION_COUNT", 7)


def test_noise_between_messages_is_stepped_over(port):
    ours, theirs = _pair("udp", port)
    with MavlinkLink(ours, ME) as a:
        packet = heartbeat().pack(mavlink.MAVLink(None, 1, 1))
        theirs.write(b"\x00\x55 garbage \xff" + bytes(packet) + bytes(packet), 0)
        theirs.write(bytes(packet), 0)
        assert a.receive(2.0).get_type() == "HEARTBEAT"
        theirs.close()


def test_a_tlog_is_read_by_pymavlink_and_by_our_own_reader(port, tmp_path):
    ours, theirs = _pair("udp", port)
    log = tmp_path / "said.tlog"
    with MavlinkLink(ours, ME, tlog=log) as a, MavlinkLink(theirs, VEHICLE) as b:
        for n in range(5):
            b.send(mavlink.MAVLink_global_position_int_message(n * 200, 515_000_000, 74_000_000, 1, 1, 0, 0, 0, 0))
            assert a.receive(2.0) is not None
        a.send(heartbeat())
    reader = mavutil.mavlink_connection(str(log))
    kinds = []
    while (message := reader.recv_msg()) is not None:
        kinds.append((message.get_type(), message.get_srcSystem()))
    reader.close()
    assert kinds == [("GLOBAL_POSITION_INT", 1)] * 5 + [("HEARTBEAT", 254)]
    from photomap_gis.ingest.telemetry.tlog import read_tlog

    assert len(read_tlog(log).points) >= 1


def test_a_tlog_that_cannot_be_written(port, tmp_path):
    with pytest.raises(OutputError, match="--tlog"):
        MavlinkLink(Udp(listens_at=("127.0.0.1", port), sends_to=None), ME, tlog=tmp_path / "no" / "a.tlog")


def test_signed_messages_are_heard_and_unsigned_are_not(port):
    key = bytes(range(32))
    ours, theirs = _pair("udp", port)
    with MavlinkLink(ours, ME, key=key) as a:
        with MavlinkLink(theirs, VEHICLE, key=key) as b:
            b.send(heartbeat())
            heard = a.receive(2.0)
            assert heard.get_type() == "HEARTBEAT" and heard.get_signed()
        stranger = Udp(listens_at=None, sends_to=("127.0.0.1", port))
        with MavlinkLink(stranger, VEHICLE) as c:
            c.send(heartbeat())
            assert a.receive(0.2) is None


def test_signing_keys(tmp_path):
    raw, text, word, none = (tmp_path / n for n in ("raw", "hex", "word", "none"))
    key = os.urandom(31) + b"\xff"
    raw.write_bytes(key)
    text.write_text(key.hex() + "\n")
    word.write_text("a passphrase\n")
    none.write_text("\n")
    assert read_signing_key(raw) == key == read_signing_key(text)
    assert len(read_signing_key(word)) == 32
    for bad in (none, tmp_path / "absent"):
        with pytest.raises(DataError):
            read_signing_key(bad)
