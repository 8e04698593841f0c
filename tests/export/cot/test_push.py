"""Pushing over loopback: datagrams, streams, TLS with a throw-away authority, links that fail."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
import trustme
from defusedxml import ElementTree

from photomap_gis.core.errors import DataError, UsageError
from photomap_gis.export.cot import CotDrone, CotFind, CotPusher, Tls, cot_address

LONG_S = 20.0


def drone(lat: float = 51.5) -> CotDrone:
    return CotDrone("drone-1", "photomap", lat, 7.4)


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        s.settimeout(LONG_S)
        yield s


class Server:
    """Takes one stream after the other and gathers the documents in it."""

    def __init__(self, context: ssl.SSLContext | None = None, hang_up_first: bool = False) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.documents: list[str] = []
        self.changed = threading.Condition()
        self._context, self._hang_up = context, hang_up_first
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            if self._hang_up:
                self._hang_up = False
                connection.close()
                continue
            try:
                if self._context is not None:
                    connection = self._context.wrap_socket(connection, server_side=True)
                connection.sendall(b"<event/>" * 5000)  # what it says of others must not stop us
                self._read(connection)
            except OSError:
                pass
            finally:
                connection.close()

    def _read(self, connection: socket.socket) -> None:
        buffer = b""
        while data := connection.recv(4096):
            buffer += data
            *whole, buffer = buffer.split(b"</event>")
            with self.changed:
                self.documents += [(w + b"</event>").decode() for w in whole]
                self.changed.notify_all()

    def wait_for(self, count: int) -> list[str]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.documents) >= count, LONG_S)
            return list(self.documents)


def lat_of(document: str | bytes) -> float:
    return float(ElementTree.fromstring(document)[0].attrib["lat"])


def test_datagrams_arrive_one_event_each(receiver: socket.socket) -> None:
    with CotPusher(cot_address(f"udp://127.0.0.1:{receiver.getsockname()[1]}"), every_s=0.01) as push:
        push.put(drone())
        first = receiver.recv(65_536)
        push.put(CotFind("find-1", "victim", 51.6, 7.4))
        second = receiver.recv(65_536)
        push.remove("find-1")
        third = receiver.recv(65_536)
    assert (lat_of(first), lat_of(second)) == (51.5, 51.6)
    assert b"t-x-d-d" in third and b'uid="find-1"' in third


def test_of_many_values_the_newest_is_sent(receiver: socket.socket) -> None:
    with CotPusher(cot_address(f"udp://127.0.0.1:{receiver.getsockname()[1]}"), every_s=3600.0) as push:
        push.put(drone(10.0))
        assert lat_of(receiver.recv(65_536)) == 10.0
        for n in range(100):
            push.put(drone(20.0 + n / 10))
    # an hour has not gone by: nothing of these went out but what waits at the end
    assert lat_of(receiver.recv(65_536)) == pytest.approx(29.9)
    assert push.state().sent == 2 and push.state().dropped == 99


def test_multicast_reaches_the_group() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as group:
        group.bind(("", 0))
        group.settimeout(LONG_S)
        member = socket.inet_aton("239.2.3.1") + socket.inet_aton("127.0.0.1")
        try:
            group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            pytest.skip(f"this machine has no multicast on loopback: {error}")
        address = cot_address(f"udp://239.2.3.1:{group.getsockname()[1]}?interface=127.0.0.1&ttl=0")
        with CotPusher(address, every_s=0.01) as push:
            push.put(drone())
            assert lat_of(group.recv(65_536)) == 51.5


def test_a_stream_that_breaks_is_made_again() -> None:
    server = Server(hang_up_first=True)
    with CotPusher(cot_address(f"tcp://127.0.0.1:{server.port}"), every_s=0.01) as push:
        n = 0
        while not server.documents and n < 10_000:
            push.put(drone())
            n += 1
            with server.changed:
                server.changed.wait(0.01)
        assert lat_of(server.wait_for(1)[0]) == 51.5
        push.put(CotFind("f", "x", 1.0, 2.0))
        server.wait_for(2)
        assert push.state().is_connected and push.state().problem is None
    server.listener.close()


def test_nobody_there_is_told_and_nobody_waits() -> None:
    with socket.create_server(("127.0.0.1", 0)) as s:
        port = s.getsockname()[1]
    push = CotPusher(cot_address(f"tcp://127.0.0.1:{port}"), every_s=0.0)
    for n in range(3000):
        push.put(CotFind(f"f{n}", "x", 1.0, 2.0))
    state = push.state()
    while state.problem is None:
        push.put(drone())
        state = push.state()
    assert "refused" in state.problem and state.sent == 0 and state.dropped >= 2000
    push.close()


def test_tls_with_certificates_on_both_sides(tmp_path: Path) -> None:
    authority = trustme.CA()
    theirs, ours = authority.issue_cert("takserver"), authority.issue_cert("photomap")
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    theirs.configure_cert(context)
    authority.configure_trust(context)
    context.verify_mode = ssl.CERT_REQUIRED
    server = Server(context)
    authority.cert_pem.write_to_path(str(tmp_path / "ca.pem"))
    ours.private_key_and_cert_chain_pem.write_to_path(str(tmp_path / "me.pem"))
    tls = Tls(tmp_path / "me.pem", authorities=tmp_path / "ca.pem", server_name="takserver")
    with CotPusher(cot_address(f"tls://127.0.0.1:{server.port}", tls), every_s=0.01) as push:
        push.put(drone())
        assert lat_of(server.wait_for(1)[0]) == 51.5
    # another authority, or another name: not spoken to
    trustme.CA().cert_pem.write_to_path(str(tmp_path / "other.pem"))
    for wrong in (
        Tls(tmp_path / "me.pem", authorities=tmp_path / "other.pem", server_name="takserver"),
        Tls(tmp_path / "me.pem", authorities=tmp_path / "ca.pem"),
    ):
        push = CotPusher(cot_address(f"tls://127.0.0.1:{server.port}", wrong), every_s=0.01)
        while (problem := push.state().problem) is None:
            push.put(drone())
        push.close()
        assert "certificate is not accepted" in problem
    assert len(server.documents) == 1
    server.listener.close()


@pytest.mark.parametrize(
    "text", ["", "239.2.3.1:6969", "http://x:1", "udp://", "tcp://h:99999", "tcp://239.2.3.1:6969", "udp://h:1?ttl=900"]
)
def test_what_is_no_receiver_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--cot"):
        cot_address(text)


def test_certificates_that_cannot_be_used_are_told_before_the_flight(tmp_path: Path) -> None:
    (tmp_path / "bad.pem").write_text("no certificate")
    (tmp_path / "client.p12").write_bytes(b"x")
    for name, words in [("bad.pem", "cannot be used"), ("client.p12", "openssl pkcs12"), ("none.pem", "no such file")]:
        with pytest.raises(DataError, match=words):
            cot_address("tls://h:8089", Tls(certificate=tmp_path / name))
    with pytest.raises(UsageError, match="for tls"):
        cot_address("tcp://h:8087", Tls(certificate=tmp_path / "bad.pem"))


def test_the_clock_is_given(receiver: socket.socket) -> None:
    address = cot_address(f"udp://127.0.0.1:{receiver.getsockname()[1]}")
    with CotPusher(address, now_utc=lambda: datetime(2026, 1, 2, tzinfo=UTC)) as push:
        push.put(drone())
        assert b'time="2026-01-02T00:00:00.000Z"' in receiver.recv(65_536)
