"""What ``photomap live`` says while it flies."""

from __future__ import annotations

import socket
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from photomap_gis.cli import live_command
from photomap_gis.export.cot import CotDrone, cot_address


def test_a_tak_server_that_is_away_and_comes_back_is_told_each_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as s:
        port = s.getsockname()[1]
    monkeypatch.setattr("photomap_gis.export.cot.push._FIRST_RETRY_S", 0.05)
    monkeypatch.setattr("photomap_gis.export.cot.push._LAST_RETRY_S", 0.05)
    monkeypatch.setattr(
        "photomap_gis.cli.cot_values.cot_values", lambda pose, folder, callsign: [CotDrone("a", callsign, 51.5, 7.4)]
    )
    said: list[str] = []
    waits = threading.Event()
    flight = SimpleNamespace(folder=tmp_path, on_words=said.append, on_pose=None)

    def until(count: int) -> None:
        for _ in range(2000):
            flight.on_pose(None)
            if len(said) >= count:
                return
            waits.wait(0.01)
        raise AssertionError(said)

    with live_command._pushed(flight, cot_address(f"tcp://127.0.0.1:{port}"), "UAV7"):
        until(1)
        with socket.create_server(("127.0.0.1", port)):
            until(2)
    assert "no TAK server listens" in said[0] and "told again" in said[1] and len(said) == 2
