"""The golden documents of the protocol: what a real engine says, with what differs from run to run named instead.

    python -m tests.engine.golden        # writes tests/protocol/*.json anew; read the difference before it is committed

The engine's tests hold the engine to them, and ``tests/qgis_plugin/test_client.py`` the plugin's client.
"""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Any

from photomap_gis import __version__
from photomap_gis.core.mission import Autopilot, Home, Mission, MissionItem
from photomap_gis.mission_planner.files import write_mission
from tests.engine.engines import EngineUnderTest

PROTOCOL = Path(__file__).resolve().parents[1] / "protocol"
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")
_VOLATILE = {"port": 0, "pid": 0, "token": "TOKEN", "rate": 1.0, "eta_s": 0.0}


def read(name: str) -> Any:
    return json.loads((PROTOCOL / f"{name}.json").read_text(encoding="utf-8"))


def named(document: Any, folder: Path) -> Any:
    """Return a document with times, tokens, speeds, the version and the run's folder named instead of told."""
    if isinstance(document, dict):
        if "kinds" in document:  # kinds are added as commands are
            document = {**document, "kinds": [kind for kind in document["kinds"] if kind in ("map", "export", "plan")]}
        return {
            key: _VOLATILE[key] if key in _VOLATILE and value is not None else named(value, folder)
            for key, value in document.items()
        }
    if isinstance(document, list):
        return [named(value, folder) for value in document]
    if isinstance(document, float):
        return round(document, 3)
    if isinstance(document, str):
        return _TIME.sub("TIME", document.replace(str(folder), "FOLDER")).replace(__version__, "VERSION")
    return document


def said_by_an_engine(folder: Path) -> dict[str, Any]:
    """Return what an engine says in a short life, by the names of the golden files."""
    items = (MissionItem(22, 3, x=47.0, y=8.0, z=30.0), MissionItem(16, 3, x=47.001, y=8.0, z=30.0))
    source = folder / "field.waypoints"
    write_mission(source, Mission(items=items, home=Home(47.0, 8.0, 400.0), autopilot=Autopilot.ARDUPILOT))
    engine = EngineUnderTest()
    try:
        said: dict[str, Any] = {"ready": engine.ready, "api": engine.get("/api")}
        said["command-convert"] = next(c for c in engine.get("/commands")["commands"] if c["kind"] == "convert")
        flight = {
            "ground": "procedural",
            "output": str(folder / "flight"),
            "frames": 4,
            "width": 320,
            "frame_height": 240,
        }
        said["job-started"] = engine.start("simulate", **flight)
        engine.end_of("1")
        said["events-done"] = _renumbered(engine, "1")
        said["job-done"] = engine.get("/jobs/1")
        engine.start("info", sources=[str(folder / "nothing")])
        engine.end_of("2")
        said["events-failed"] = _renumbered(engine, "2")
        said["job-failed"] = engine.get("/jobs/2")
        engine.start("convert", source=str(source), output=str(folder / "field.plan"))
        engine.end_of("3")
        said["job-converted"] = engine.get("/jobs/3")
        said["jobs"] = engine.get("/jobs")
        refused = engine.http.post("/jobs", json={"kind": "convert", "arguments": {"source": str(source), "colour": 1}})
        said["refused"] = refused.json()
        said["no-token"] = engine.http.get("/jobs", headers={"Authorization": ""}).json()
        said["no-mission"] = engine.http.post("/missions", json={"folder": str(folder / "nothing")}).json()
    finally:
        engine.close()
    return {name: named(document, folder) for name, document in said.items()}


def _renumbered(engine: EngineUnderTest, id: str) -> list[dict[str, Any]]:
    """The events of a job that has ended; how many progress lines came in between depends on the machine's speed."""
    return [{"id": n, "event": name, "data": data} for n, (_, name, data) in enumerate(engine.events(id), start=1)]


def main() -> None:
    """Write the golden files."""
    PROTOCOL.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, document in said_by_an_engine(Path(folder)).items():
            text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
            (PROTOCOL / f"{name}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
