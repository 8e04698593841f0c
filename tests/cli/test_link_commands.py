"""The commands of the link against a vehicle in a process of its own, by real UDP and TCP."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink import mavutil

from photomap_gis.cli.app import main
from photomap_gis.core.mission import Autopilot, FenceCircle, FencePolygon, Home, Mission, MissionItem, RallyPoint
from photomap_gis.mission_planner.files import read_mission, write_mission

NAN = math.nan
ROOT = Path(__file__).resolve().parents[2]


class Vehicle:
    """A simulated vehicle's process."""

    def __init__(self, *options: str, link: str = "tcp", port: int = 0) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "photomap_gis.simulate.vehicle", "--link", link, "--port", str(port), *options],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        self.port = json.loads(self.process.stdout.readline())["port"]
        self.url = {"tcp": f"tcp:127.0.0.1:{self.port}", "udp": f"udpout:127.0.0.1:{self.port}",
                    "udpout": f"udpin:127.0.0.1:{self.port}"}[link]  # fmt: skip

    @property
    def at(self) -> tuple[str, ...]:
        """Where it is; with its number nobody else is waited for."""
        return ("--connect", self.url, "--system", "1")

    def order(self, **words: object) -> None:
        self.process.stdin.write(json.dumps(words) + "\n")
        self.process.stdin.flush()

    def truth(self) -> dict:
        self.order(dump=True)
        return json.loads(self.process.stdout.readline())

    def commands(self, kind: int = 0) -> list[int]:
        return [item["command"] for item in self.truth()["lists"][str(kind)]]

    def close(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self.process.stdin.close()
        self.process.wait(timeout=10)
        self.process.stdout.close()


@pytest.fixture
def vehicle():
    started = []

    def start(*options: str, **kwargs) -> Vehicle:
        started.append(Vehicle(*options, **kwargs))
        return started[-1]

    yield start
    for one in started:
        one.close()


@pytest.fixture
def plan(tmp_path):
    def write(name: str = "area.plan", autopilot: Autopilot = Autopilot.ARDUPILOT, lines: int = 4) -> Path:
        items = [MissionItem(22, 3, (0, 0, 0, NAN), 51.5, 7.4, 40.0), MissionItem(178, 2, (1, 8.0, -1, 0))]
        for n in range(lines):
            lat = 51.5 + n * 2e-4
            items += [
                MissionItem(16, 3, (0, 0, 0, NAN), lat, 7.401, 50.5),
                MissionItem(206, 2, (12.5, 0, 1, 0)),
                MissionItem(16, 3, (0, 0, 0, NAN), lat, 7.405, 50.5),
                MissionItem(206, 2),
            ]
        mission = Mission(
            items=(*items, MissionItem(20, 2)),
            fence_polygons=(FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.51, 7.41), (51.51, 7.39))),),
            fence_circles=(FenceCircle(51.509, 7.392, 20.0, inclusion=False),),
            rally=(RallyPoint(51.5001, 7.4001, 30.0),),
            home=Home(51.5, 7.4, 100.0),
            autopilot=autopilot,
        )
        path = tmp_path / name
        write_mission(path, mission)
        return path

    return write


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    code = main([str(a) for a in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def start(*arguments: object) -> subprocess.Popen:
    program = "import sys; from photomap_gis.cli import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip


def test_upload_download_clear_restore(vehicle, plan, capsys, tmp_path):
    there, path = vehicle(), plan()
    code, out, _ = run(capsys, "upload", path, *there.at, "--json", "--tlog", tmp_path / "a.tlog")
    result = json.loads(out)
    assert code == 0 and result["outcome"] == "verified" and result["items"] == 19 and result["differences"] == []
    assert Path(result["saved_previous"]).parent == tmp_path and result["seconds"] > 0
    truth = there.truth()
    assert [len(truth["lists"][k]) for k in "012"] == [20, 5, 1] and not truth["armed"]

    back = tmp_path / "back.plan"
    code, out, _ = run(capsys, "download", *there.at, "-o", back, "--json")
    assert code == 0 and json.loads(out)["items"] == 19
    sent, read = read_mission(path), read_mission(back)
    assert [(i.command, i.x, i.y) for i in read.items] == [(i.command, i.x, i.y) for i in sent.items]
    assert (read.fence_polygons, read.fence_circles, read.rally) == (
        sent.fence_polygons,
        sent.fence_circles,
        sent.rally,
    )

    kept = tmp_path / "kept.json"
    code, out, _ = run(capsys, "clear", *there.at, "--save-previous", kept)
    assert code == 0 and "cleared" in out
    assert [len(items) for items in there.truth()["lists"].values()] == [0, 0, 0]

    code, out, _ = run(capsys, "upload", "--restore", kept, *there.at, "--save-previous", tmp_path / "x.json")
    assert code == 0 and out.startswith("verified")
    assert there.truth()["lists"] == truth["lists"]

    log = mavutil.mavlink_connection(str(tmp_path / "a.tlog"))
    kinds = set()
    while (message := log.recv_msg()) is not None:
        kinds.add(message.get_type())
    log.close()
    assert {"HEARTBEAT", "MISSION_COUNT", "MISSION_REQUEST", "MISSION_ITEM_INT", "MISSION_ACK"} <= kinds
    assert not kinds & {"SET_MODE", "MISSION_WRITE_PARTIAL_LIST", "PARAM_SET"}


@pytest.mark.parametrize(("link", "autopilot"), [("udp", Autopilot.ARDUPILOT), ("udpout", Autopilot.PX4)])
def test_by_udp_with_loss(vehicle, plan, capsys, link, autopilot):
    port = 0
    if link == "udpout":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
    there = vehicle(f"--autopilot={autopilot}", "--loss=0.1", "--duplicate=0.1", link=link, port=port)
    code, out, _ = run(capsys, "upload", plan(autopilot=autopilot, lines=1), *there.at, "--json", "-q")
    assert code == 0 and json.loads(out)["outcome"] == "verified"
    expected = [22, 178, 16, 206, 16, 206, 20]
    assert there.commands() == ([16, *expected] if autopilot is Autopilot.ARDUPILOT else expected)


def test_a_reboot_closes_tcp_and_the_upload_goes_on(vehicle, plan, capsys):
    there = vehicle("--reboot-at-item=7", "--no-space-after-boot=1")
    code, out, _ = run(capsys, "upload", plan(), *there.at, "--json", "-q")
    assert code == 0 and json.loads(out)["outcome"] == "verified" and len(there.commands()) == 20


def test_a_refused_item_is_restored_with_exit_code_4(vehicle, plan, capsys):
    there = vehicle("--refuses-command=206")
    code, out, _ = run(capsys, "upload", plan(), *there.at, "--json", "-q")
    result = json.loads(out)
    assert code == 4 and result["outcome"] == "restored" and result["holds"] == "previous"
    assert there.commands() == []


def test_auto_is_refused_and_waited_for(vehicle, plan, capsys):
    there, path = vehicle("--mode=AUTO", "--armed", "--height=50"), plan()
    code, out, _ = run(capsys, "upload", path, *there.at, "--json", "-q")
    assert code == 4 and json.loads(out)["outcome"] == "refused" and there.commands() == []
    process = start("upload", path, *there.at, "--json", "--wait-mode", "--start-at", "nearest")
    for line in process.stderr:
        if "waiting" in line:
            there.order(mode="LOITER")
            break
    out, _ = process.communicate(timeout=60)
    result = json.loads(out)
    assert process.returncode == 0 and result["outcome"] == "verified" and result["start_item"] == 3
    truth = there.truth()
    assert truth["current"] == 3 and truth["armed"] and truth["mode"] == 5  # as the pilot left it


def test_mission_mode_in_mid_upload(vehicle, plan, capsys):
    there = vehicle("--mission-mode-at-item=9")
    code, out, _ = run(capsys, "upload", plan(), *there.at, "--json", "-q", "--timeout", "6")
    result = json.loads(out)
    assert code == 4 and result["outcome"] == "refused" and result["holds"] == "mixed"
    assert f"the first {len(there.commands()) - 1} " in result["message"]


def test_silence_is_unknown_and_restore_finishes_the_job(vehicle, plan, capsys, tmp_path):
    there = vehicle("--silent-at-item=9", link="udp")
    code, out, _ = run(capsys, "upload", plan(), *there.at, "--json", "-q", "--timeout", "5")
    result = json.loads(out)
    assert code == 4 and result["outcome"] == "unknown" and "may hold" in result["message"]
    other = vehicle(link="udp")
    code, out, _ = run(capsys, "upload", "--restore", result["saved_previous"], *other.at, "--json", "-q")
    assert code == 0 and json.loads(out)["outcome"] == "verified" and other.commands() == []


def test_nobody_there(capsys, plan):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    code, out, _ = run(
        capsys, "upload", plan(), "--connect", f"udpin:127.0.0.1:{port}", "--json", "-q", "--timeout", "1"
    )
    assert code == 4 and json.loads(out)["outcome"] == "unknown"
    code, _, err = run(capsys, "vehicle", "--connect", f"tcp:127.0.0.1:{port}", "--timeout", "1")
    assert code == 4 and "no vehicle" in err
    code, _, err = run(capsys, "download", "--connect", f"tcp:127.0.0.1:{port}", "-o", "a.plan", "--timeout", "1")
    assert code == 4 and "no vehicle" in err


def test_ctrl_c_brings_it_to_a_known_state(vehicle, plan, tmp_path):
    there, path = vehicle("--delay=0.02"), plan(lines=6)
    process = start("upload", path, *there.at, "--json")
    for line in process.stderr:
        if line.startswith("check rally"):  # the mission is under way next
            break
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    result = json.loads(out)
    assert process.returncode == 130 and result["outcome"] == "restored" and "stopping" in err
    assert there.commands() == [] and there.commands(1) == []


def test_vehicle_tells_who_is_there(vehicle, capsys):
    there = vehicle("--height=30", "--armed")
    code, out, _ = run(capsys, "vehicle", *there.at)
    assert code == 0 and "ardupilot 4.7.0" in out and "LOITER, armed" in out and "30.0 m above home" in out
    code, out, _ = run(capsys, "vehicle", *there.at, "--watch", "--times", "3", "--every", "0.2")
    lines = [json.loads(line) for line in out.splitlines()]
    assert code == 0 and len(lines) == 3
    assert {"autopilot", "type", "version", "mode", "armed", "lat_deg", "battery_percent", "mission"} <= set(lines[0])


def test_signing(vehicle, capsys, tmp_path):
    key = tmp_path / "key"
    key.write_bytes(os.urandom(32))
    there = vehicle(f"--signing-key={key}")
    code, out, _ = run(capsys, "vehicle", *there.at, "--signing-key", key, "--json")
    assert code == 0 and json.loads(out)["version"] == "4.7.0-dev"
    code, _, err = run(capsys, "download", *there.at, "-o", tmp_path / "a.plan", "--timeout", "2")
    assert code == 4 and "--signing-key" in err


def test_several_vehicles_must_be_named(vehicle, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    first = vehicle("--system=1", link="udpout", port=port)
    vehicle("--system=2", "--autopilot=px4", link="udpout", port=port)
    code, _, err = run(capsys, "vehicle", "--connect", first.url)
    assert code == 4 and "1, 2" in err and "--system" in err
    code, out, _ = run(capsys, "vehicle", "--connect", first.url, "--system", "2", "--json")
    assert code == 0 and json.loads(out)["autopilot"] == "px4"


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["upload", "--connect", "tcp:127.0.0.1:1"], 2, "PLAN"),
        (["upload", "no.plan", "--connect", "tcp:127.0.0.1:1"], 3, "no.plan"),
        (["upload", "no.plan", "--restore", "x", "--connect", "tcp:127.0.0.1:1"], 2, "either"),
        (["upload", "no.plan"], 2, "--connect"),
        (["vehicle", "--connect", "nonsense"], 2, "udpin"),
        (["upload", "a.plan", "--connect", "tcp:127.0.0.1:1", "--start-at", "0"], 2, "nearest"),
        (["download", "--connect", "tcp:127.0.0.1:1", "-o", "a.gpx"], 2, ".plan"),
    ],
)
def test_wrong_words(capsys, arguments, code, word):
    got, _, err = run(capsys, *arguments)
    assert got == code and word in err


def test_a_saved_file_is_no_plan_and_an_empty_plan_is_nothing(capsys, tmp_path):
    saved = tmp_path / "saved.json"
    saved.write_text('{"fileType": "photomap vehicle lists"}')
    code, _, err = run(capsys, "upload", saved, "--connect", "tcp:127.0.0.1:1")
    assert code == 2 and "--restore" in err
    empty = tmp_path / "empty.plan"
    write_mission(empty, Mission(autopilot=Autopilot.PX4))
    code, _, err = run(capsys, "upload", empty, "--connect", "tcp:127.0.0.1:1")
    assert code == 2 and "clear" in err
