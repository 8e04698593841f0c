"""MAVSDK, which shares no code with us, reads what was uploaded and finds the same."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.mavlink.compare import compare
from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, upload_mission
from photomap_gis.mission_planner.mavlink.session import Connection, run
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, lists_of

ROOT = Path(__file__).resolve().parents[3]

# In a process of its own: its native library has threads and a log on stdout.
_READ = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
mavsdk.add_any_connection(sys.argv[1])
end = time.monotonic() + 20
systems = []
while not systems and time.monotonic() < end:
    systems = [s for s in mavsdk.get_systems() if s.has_autopilot()]
    time.sleep(0.05)
raw = MissionRaw(systems[0])
lists = [raw.download_mission(), raw.download_geofence(), raw.download_rallypoints()]
fields = ("command", "frame", "param1", "param2", "param3", "param4", "x", "y", "z")
with open(sys.argv[2], "w") as out:
    json.dump([[[getattr(i, f) for f in fields] for i in items] for items in lists], out)
"""


@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_mavsdk_downloads_what_was_uploaded(autopilot, make_survey, tmp_path):
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("the peer MAVSDK is not installed (pip install mavsdk)")
    mission = make_survey(40)
    vehicle = subprocess.Popen(
        [sys.executable, "-m", "photomap_gis.simulate.vehicle", "--port=0", f"--autopilot={autopilot}"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        port = json.loads(vehicle.stdout.readline())["port"]
        report = run(
            Connection(f"tcp:127.0.0.1:{port}"),
            lambda talk: upload_mission(
                talk, mission, UploadOptions(), save=lambda state, lists: "", say=lambda w: None
            ),
        )
        assert report.outcome == "verified"
        read = tmp_path / "read.json"
        done = subprocess.run(
            [sys.executable, "-c", _READ, f"tcpout://127.0.0.1:{port}", str(read)], capture_output=True, timeout=60
        )
        assert done.returncode == 0, done.stderr.decode()
    finally:
        vehicle.stdin.close()
        vehicle.wait(timeout=10)
        vehicle.stdout.close()
    sent = lists_of(mission, autopilot)
    for kind, items in zip(Kind, json.loads(read.read_text()), strict=True):
        theirs = [WireItem(c, f, (p1, p2, p3, p4), x, y, z) for c, f, p1, p2, p3, p4, x, y, z in items]
        assert compare(kind, sent[kind], theirs, autopilot).is_same
