"""A real engine over real HTTP: jobs to their ends, who may ask, what is refused, and what is left behind."""

import http.client
import json
import math
import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.engine.engines import ROOT, EngineUnderTest

LONG = {"ground": "procedural", "frames": 4000, "width": 640, "frame_height": 480}
"""A flight that no test waits for."""


def children_of(pid: int) -> list[int]:
    """The processes that any thread of a process has started and that still run."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(p) for task in tasks for p in task.read_text().split()]


def wait_for_end(pid: int) -> None:
    """Wait until a process that is not our child has ended."""
    try:
        fd = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    assert select.select([fd], [], [], 60)[0], f"process {pid} still runs"
    os.close(fd)


needs_proc = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="looks at processes through Linux's /proc")


def test_a_flight_is_simulated_mapped_and_shown(engine, tmp_path):
    flight = {"ground": "procedural", "frames": 6, "width": 480, "frame_height": 360, "altitude": 80}
    job = engine.start("simulate", output=str(tmp_path / "f"), gps_bias=[0.5, -0.5], **flight)
    assert job["state"] == "running"
    assert job["command"][:2] == ["photomap", "simulate"]
    assert engine.end_of(job["id"])["state"] == "done"
    job = engine.start("map", tmp_path, sources=["f/photos"], output="m", layers=True)  # relative to the job's folder
    assert f"--output={tmp_path / 'm'}" in job["command"]
    events = list(engine.events(job["id"]))
    numbers = [number for number, *_ in events]
    assert numbers == sorted(set(numbers))
    stages = {data["stage"] for _, name, data in events if name == "progress"}
    assert {"read", "render"} <= stages
    result = events[-1][2]["result"]
    assert all((tmp_path / path).exists() for path in result["outputs"])
    # A listener who comes late, or again, misses nothing of what counts and hears nothing twice.
    again = list(engine.events(job["id"]))
    assert again[-1] == events[-1]
    assert [e for e in again if e[0] > numbers[-3]] == list(engine.events(job["id"], after=numbers[-3]))
    over = engine.http.get(f"/jobs/{job['id']}/events", headers={"Last-Event-ID": str(numbers[-1])})
    assert over.status_code == 204  # tells an EventSource not to come again

    opened = engine.http.post("/missions", json={"folder": str(tmp_path / "m")})
    assert opened.status_code == 201
    mission = opened.json()
    assert mission["georeferenced"]
    assert engine.http.post("/missions", json={"folder": str(tmp_path / "m")}).json()["id"] == mission["id"]
    assert engine.get(f"/missions/{mission['id']}/frames.geojson")["features"]
    zoom = mission["layers"][0]["scheme"]["max_zoom"]
    tile_json = engine.get(f"/missions/{mission['id']}/layers/map/tiles.json")
    assert f"token={engine.ready['token']}" in tile_json["tiles"][0]
    west, south, east, north = tile_json["bounds"]
    n = 1 << zoom
    x = int(((west + east) / 2 / 360 + 0.5) * n)
    y = int((0.5 - math.asinh(math.tan(math.radians((south + north) / 2))) / (2 * math.pi)) * n)
    url = tile_json["tiles"][0].format(z=zoom, x=x, y=y)
    tile = engine.http.get(url, headers={"Authorization": ""})  # the token is in the address
    assert tile.status_code == 200
    assert tile.content.startswith(b"\x89PNG")
    assert engine.http.delete(f"/missions/{mission['id']}").status_code == 204
    assert engine.http.get(f"/missions/{mission['id']}").status_code == 404
    assert engine.http.delete(f"/missions/{mission['id']}").status_code == 404


def test_a_plan_becomes_a_job_even_in_the_south_west(engine, tmp_path):
    job = engine.start("plan", area="-35.363,-70.165;-35.363,-70.163;-35.361,-70.163", output=str(tmp_path / "a.plan"),
                       gsd="3cm", wind="5,270", home="-35.363,-70.165")  # fmt: skip
    end = engine.end_of(job["id"])
    assert end["state"] == "done", end
    assert end["result"]["covered_share"] > 0.999
    assert str(tmp_path / "a.plan") in end["result"]["outputs"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"kind": "fly"}, "there is no job 'fly'"),
        ({"kind": "serve"}, "there is no job 'serve'"),
        ({"kind": "map"}, "SOURCE"),
        ({"kind": "map", "arguments": {"sources": []}}, "SOURCE"),
        ({"kind": "map", "arguments": {"sources": ["a"], "nonsense": 1}}, "no argument 'nonsense'"),
        ({"kind": "map", "arguments": {"sources": ["a"], "as_json": True}}, "no argument 'as_json'"),
        ({"kind": "map", "arguments": {"sources": ["a"], "gsd": "fine"}}, "gsd takes a number"),
        ({"kind": "map", "arguments": {"sources": ["a"], "gsd": True}}, "gsd takes a number"),
        ({"kind": "map", "arguments": {"sources": ["a"], "workers": 1.5}}, "whole number"),
        ({"kind": "map", "arguments": {"sources": ["a"], "workers": 0}}, "workers"),
        ({"kind": "map", "arguments": {"sources": [{"a": 1}]}}, "sources takes"),
        ({"kind": "map", "arguments": {"sources": ["a\0b"], "output": "m"}}, "NUL"),
        ({"kind": "map", "arguments": {"sources": ["a"], "gcp_crs": "x", "gcp-crs": "y"}}, "twice"),
        ({"kind": "export", "arguments": {"geotiff": "yes"}}, "geotiff is a switch"),
        ({"kind": "simulate", "arguments": {"ground": "procedural", "output": "o", "gps_bias": [1]}}, "2 values"),
        ({"kind": "info", "arguments": {"sources": ["a"]}, "folder": "/no/such/folder"}, "/no/such/folder"),
        ({"kind": "info", "extra": 1}, "extra"),
        ({"arguments": {}}, "kind"),
        ([], "object"),
        ("map", "object"),
    ],
)
def test_what_cannot_be_a_job_is_refused_with_words(engine, body, words):
    before = len(engine.get("/jobs")["jobs"])
    answer = engine.http.post("/jobs", json=body)
    assert answer.status_code == 400, answer.text
    assert words in answer.json()["message"]
    assert len(engine.get("/jobs")["jobs"]) == before


def test_hostile_bodies_are_refused(engine):
    for body, status in ((b"", 400), (b"{", 400), (b"[" * 100_000, 400), (b"\xff\xfe", 400), (b" " * 2_000_000, 413)):
        answer = engine.http.post("/jobs", content=body)
        assert answer.status_code == status, body[:10]
        assert set(answer.json()) == {"error", "message"}
    assert engine.get("/api")["api"] == 1


def test_words_that_look_like_options_stay_values(engine, tmp_path):
    """No argument can smuggle an option in: a source called --help is a file that is not there."""
    for name in ("--help", "--output=/tmp/x", "-q"):
        end = engine.end_of(engine.start("info", tmp_path, sources=[name])["id"])
        assert end["state"] == "failed"
        assert end["error"]["error"] == "data"
        assert name in end["error"]["message"]


def test_every_request_shows_the_token_and_names_this_machine(engine):
    port, token = engine.ready["port"], engine.ready["token"]

    def status(method: str, path: str, **headers: str) -> int:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer.status

    bearer = {"Authorization": f"Bearer {token}"}
    for method, path in (("GET", "/api"), ("GET", "/commands"), ("GET", "/jobs"), ("POST", "/jobs"), ("GET", "/jobs/1"),
                         ("DELETE", "/jobs/1"), ("GET", "/jobs/1/events"), ("GET", "/missions"), ("POST", "/missions"),
                         ("POST", "/stop"), ("GET", "/events"), ("GET", "/missions/1")):  # fmt: skip
        assert status(method, path) == 401, path
        assert status(method, path, Authorization="Bearer nonsense") == 401, path
        assert status(method, path, Host="evil.example", **bearer) == 403, path
    assert status("GET", "/api", **bearer) == 200
    assert status("GET", f"/api?token={token}") == 200
    assert status("POST", "/jobs", Cookie=f"photomap-{port}={token}") in (401, 403)  # no page elsewhere


def test_unknown_jobs_and_missions_are_404(engine):
    assert engine.http.get("/jobs/999").status_code == 404
    assert engine.http.delete("/jobs/999").status_code == 404
    assert engine.http.get("/jobs/999/events").status_code == 404
    assert engine.http.get("/jobs/1/events", headers={"Last-Event-ID": "x"}).status_code in (400, 404)
    answer = engine.http.post("/missions", json={"folder": "/nowhere"})
    assert answer.status_code == 422
    assert "/nowhere" in answer.json()["message"]


def test_the_commands_are_click_s_own(engine):
    from photomap_gis.cli.engine_command import job_command

    for document in engine.get("/commands")["commands"]:
        names = {p["name"] for p in document["parameters"]}
        options = {o.removeprefix("--").replace("-", "_") for p in job_command(document["kind"]).params for o in p.opts}
        assert all(p["name"] in options | {q.name for q in job_command(document["kind"]).params} for p in
                   document["parameters"])  # fmt: skip
        assert not names & {"json", "quiet", "as_json"}
        assert document["help"]
    plan = next(c for c in engine.get("/commands")["commands"] if c["kind"] == "plan")
    trigger = next(p for p in plan["parameters"] if p["name"] == "trigger")
    assert trigger["type"] == "choice"
    assert trigger["choices"] == ["distance", "time", "hover"]
    assert trigger["default"] == "distance"


def test_a_job_is_stopped_and_a_map_goes_on_from_there(engine, tmp_path):
    job = engine.start("simulate", output=str(tmp_path / "f"), **LONG)
    assert engine.http.delete(f"/jobs/{job['id']}").status_code == 202
    end = engine.end_of(job["id"])
    assert end["state"] == "cancelled"
    assert end["error"]["error"] == "stopped"
    assert engine.http.delete(f"/jobs/{job['id']}").json()["state"] == "cancelled"  # once more does no harm


def test_a_job_that_does_not_hear_is_killed(engine, tmp_path):
    job = engine.start("simulate", output=str(tmp_path / "f"), **LONG)
    engine.http.delete(f"/jobs/{job['id']}?force=1")
    assert engine.end_of(job["id"])["state"] == "cancelled"


def test_too_many_jobs_at_once_are_refused(engine, tmp_path):
    started = [engine.start("simulate", output=str(tmp_path / str(n)), **LONG)["id"] for n in range(8)]
    answer = engine.http.post("/jobs", json={"kind": "info", "arguments": {"sources": ["x"]}})
    assert answer.status_code == 429
    assert "jobs are running" in answer.json()["message"]
    for id in started:
        engine.http.delete(f"/jobs/{id}?force=1")
    assert {engine.end_of(id)["state"] for id in started} == {"cancelled"}


@needs_proc
def test_a_crash_of_a_job_leaves_the_engine_alive(engine, tmp_path):
    job = engine.start("simulate", output=str(tmp_path / "f"), **LONG)
    for pid in children_of(engine.process.pid):
        os.kill(pid, signal.SIGSEGV)
    end = engine.end_of(job["id"])
    assert end["state"] == "failed"
    assert end["error"]["error"] == "crashed"
    assert "signal 11" in end["error"]["message"]
    assert engine.get("/api")["product"] == "photomap"


@needs_proc
@pytest.mark.parametrize("how", ["stdin", "stop", "sigterm", "sigkill"])
def test_the_end_of_the_engine_is_the_end_of_its_jobs(how, tmp_path):
    engine = EngineUnderTest()
    job = engine.start("simulate", output=str(tmp_path / "f"), **LONG)
    next(iter(engine.events(job["id"])))
    children = children_of(engine.process.pid)
    assert len(children) == 1
    if how == "stop":
        assert engine.http.post("/stop").status_code == 202
    elif how == "stdin":
        engine.process.stdin.close()
    else:
        engine.process.send_signal(signal.SIGTERM if how == "sigterm" else signal.SIGKILL)
    code = engine.process.wait(60)
    for pid in children:
        wait_for_end(pid)
    engine.close()
    assert code == {"sigkill": -signal.SIGKILL, "sigterm": -signal.SIGTERM}.get(how, 0)


def test_an_engine_that_stays_outlives_its_stdin():
    ran = subprocess.Popen(
        [sys.executable, "-m", "photomap_gis.cli", "engine", "--stay"],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, cwd=ROOT,
    )  # fmt: skip
    lines = [ran.stdout.readline()]
    ready = json.loads(lines[0])
    assert ready == {"event": "ready", "api": 1, "port": ready["port"], "token": ready["token"]}
    connection = http.client.HTTPConnection("127.0.0.1", ready["port"], timeout=30)
    connection.request("POST", "/stop", headers={"Authorization": f"Bearer {ready['token']}"})
    assert connection.getresponse().status == 202
    connection.close()
    assert ran.wait(60) == 0
    assert ran.stdout.read() == b""  # nothing but the first line, ever
    ran.stdout.close()
