"""The plugin's client against the golden documents of the protocol, and against a real engine; no QGIS needed."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qgis_plugin.client import (
    Address,
    Client,
    EngineError,
    EngineGone,
    Event,
    JobCancelled,
    JobFailed,
    parse_events,
    result_of,
)
from qgis_plugin.process import EngineProcess
from tests.engine import golden

TOKEN = "TOKEN"


class Recorded(BaseHTTPRequestHandler):
    """An engine that says the golden documents, and cuts the stream of events once if it is told to."""

    cuts_at: int | None = None
    asked: list[tuple[str, str, Any]] = []  # noqa: RUF012  (one server, one list)

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        self._answer()

    def do_POST(self) -> None:
        self._answer()

    def do_DELETE(self) -> None:
        self._answer()

    def _answer(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        body = json.loads(self.rfile.read(length)) if length else None
        self.asked.append((self.command, self.path, body))
        if self.headers["Authorization"] != f"Bearer {TOKEN}":
            self._say(401, golden.read("no-token"))
        elif self.path.endswith("/events"):
            self._stream("events-done" if "/1/" in self.path else "events-failed")
        elif (self.command, self.path) == ("POST", "/jobs"):
            refuses = "colour" in body["arguments"]
            self._say(400, golden.read("refused")) if refuses else self._say(201, golden.read("job-started"))
        elif (self.command, self.path) == ("POST", "/missions"):
            self._say(422, golden.read("no-mission"))
        else:
            name = {"/api": "api", "/jobs": "jobs", "/jobs/1": "job-done", "/jobs/2": "job-failed"}.get(self.path)
            if self.path == "/commands":
                self._say(200, {"commands": [golden.read("command-convert")]})
            elif name is None:
                self._say(404, {"error": "not_found", "message": "no such job"})
            else:
                self._say(200, golden.read(name))

    def _say(self, status: int, document: Any) -> None:
        data = json.dumps(document).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _stream(self, name: str) -> None:
        after = int(self.headers["Last-Event-ID"])
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        self.wfile.write(b": still here\n\n")
        for event in golden.read(name):
            if event["id"] <= after:
                continue
            lines = f"id: {event['id']}\nevent: {event['event']}\ndata: {json.dumps(event['data'])}\n\n"
            self.wfile.write(lines.encode())
            if event["id"] == Recorded.cuts_at:
                Recorded.cuts_at = None
                return


@pytest.fixture
def recorded() -> Iterator[Client]:
    Recorded.asked.clear()
    server = ThreadingHTTPServer(("127.0.0.1", 0), Recorded)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield Client(Address(server.server_port, TOKEN))
    server.shutdown()
    thread.join()
    server.server_close()


def test_the_ready_line_is_an_address():
    ready = golden.read("ready")
    assert Address.of_ready_line(json.dumps(ready) + "\n") == Address(ready["port"], ready["token"])


@pytest.mark.parametrize(
    "line", ["", "hello", "{}", "[]", "null", '{"event": "other", "api": 1}', '{"event": "ready"}']
)
def test_any_other_line_is_refused(line):
    with pytest.raises(EngineError, match="is the program in the settings photomap"):
        Address.of_ready_line(line)


def test_a_newer_protocol_is_told():
    with pytest.raises(EngineError, match="version 2 of the protocol"):
        Address.of_ready_line('{"event": "ready", "api": 2, "port": 1, "token": "t"}')


def test_it_reads_what_the_protocol_says(recorded):
    assert recorded.about() == golden.read("api")
    assert recorded.commands() == [golden.read("command-convert")]
    assert recorded.jobs() == golden.read("jobs")["jobs"]
    assert recorded.job("1") == golden.read("job-done")
    started = recorded.start_job("simulate", {"ground": "procedural"}, "/somewhere")
    assert started == golden.read("job-started")
    assert Recorded.asked[-1] == (
        "POST", "/jobs", {"kind": "simulate", "arguments": {"ground": "procedural"}, "folder": "/somewhere"},
    )  # fmt: skip
    said = [{"id": e.number, "event": e.name, "data": e.data} for e in recorded.events("1")]
    assert said == golden.read("events-done")
    assert recorded.run_job("simulate", {}) == golden.read("job-done")["result"]


def test_a_cut_stream_goes_on_where_it_was(recorded):
    for cut in (1, 2):
        Recorded.cuts_at = cut
        assert [e.number for e in recorded.events("1")] == [1, 2, 3]


def test_refusals_are_the_engine_s_own_words(recorded):
    with pytest.raises(EngineError) as refused:
        recorded.start_job("convert", {"colour": 1})
    assert (refused.value.message, refused.value.status) == (golden.read("refused")["message"], 400)
    with pytest.raises(EngineError, match="no mission folder"):
        recorded.open_mission("nothing")
    with pytest.raises(EngineError, match="no such job"):
        recorded.job("7")
    with pytest.raises(EngineError, match="a token is needed"):
        Client(Address(recorded.address.port, "wrong")).about()


def test_how_a_job_ended_is_a_result_or_an_exception():
    *_, end = golden.read("events-failed")
    with pytest.raises(JobFailed) as failed:
        result_of(end["data"])
    assert failed.value.message == golden.read("job-failed")["error"]["message"]
    assert failed.value.error["exit_code"] == 3
    with pytest.raises(JobCancelled):
        result_of({"state": "cancelled", "result": None, "error": {"message": "stopped"}})


def test_nobody_there_is_told():
    server = ThreadingHTTPServer(("127.0.0.1", 0), Recorded)
    port = server.server_port
    server.server_close()
    with pytest.raises(EngineGone, match="does not answer"):
        Client(Address(port, TOKEN)).about()
    with pytest.raises(EngineGone):
        list(Client(Address(port, TOKEN)).events("1"))


events = st.lists(
    st.builds(
        Event,
        st.integers(1, 10**9),
        st.sampled_from(["state", "progress", "log", "output", "end"]),
        st.dictionaries(st.text(max_size=5), st.text() | st.integers(), min_size=1, max_size=3),
    ),
    max_size=5,
)


@given(events, st.sampled_from([b"\n", b"\r\n"]))
def test_a_stream_is_read_as_it_was_written(written, end):
    lines = []
    for e in written:
        lines += [
            f"id: {e.number}".encode(),
            f"event: {e.name}".encode(),
            f"data: {json.dumps(e.data)}".encode(),
            b"",
            b": c",
            b"",
        ]
    assert list(parse_events(line + end for line in lines)) == written


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_a_stream_of_anything_is_no_fault(lines):
    for event in parse_events(lines):
        assert isinstance(event, Event)


def test_with_a_real_engine_it_runs_stops_and_is_told(tmp_path):
    program = tmp_path / "photomap"
    root = Path(__file__).resolve().parents[2]
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{root}" exec "{sys.executable}" -m photomap_gis.cli "$@"\n')
    program.chmod(0o755)
    heard: list[str] = []
    with EngineProcess([str(program)]) as client:
        size = {"frames": 3, "width": 320, "frame_height": 240}
        result = client.run_job(
            "simulate",
            {"ground": "procedural", "output": str(tmp_path / "f"), **size},
            on_event=lambda event: heard.append(event.name),
        )
        assert result["frames"] == 3
        assert list(client.events("1", after=10**6)) == []  # all was told: no waiting, no error
        assert heard[0] == "state" and heard[-1] == "end" and "progress" in heard
        with pytest.raises(JobFailed, match="check the name"):
            client.run_job("info", {"sources": [str(tmp_path / "nothing")]})
        with pytest.raises(JobCancelled):
            client.run_job(
                "simulate",
                {"ground": "procedural", "output": str(tmp_path / "g"), "frames": 2000},
                cancelled=lambda: True,
            )
        mission_refused = pytest.raises(EngineError, match="no mission folder")
        with mission_refused:
            client.open_mission(str(tmp_path))
    with pytest.raises(EngineGone):
        client.about()


def test_an_engine_that_cannot_start_says_why(tmp_path):
    with pytest.raises(EngineError, match="cannot be started"), EngineProcess([str(tmp_path / "none")]):
        pass
    broken = tmp_path / "photomap"
    broken.write_text("#!/bin/sh\necho 'no module named photomap' >&2\nexit 1\n")
    broken.chmod(0o755)
    with pytest.raises(EngineError, match="no module named photomap"), EngineProcess([str(broken)]):
        pass
