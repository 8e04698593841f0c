"""``photomap cot`` over loopback."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from photomap_gis.cli.app import main


def test_finds_and_a_try_arrive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    feature = {
        "type": "Feature",
        "properties": {"name": "hazard <1>", "ce90_m": 3.0, "time": "2026-05-01T10:00:00Z"},
        "geometry": {"type": "Point", "coordinates": [7.4, 51.5]},
    }
    (tmp_path / "finds.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20.0)
        url = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        assert main(["cot", url, str(tmp_path), "--at", "51.5,7.4", "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == {"receiver": url, "sent": 2}
        documents = [receiver.recv(65_536) for _ in range(2)]
    assert b"a-f-A-M-H-Q" in documents[0] and b"hazard &lt;1&gt;" in documents[1] and b'ce="3.00"' in documents[1]


@pytest.mark.parametrize(
    "arguments, code",
    [
        (["udp://127.0.0.1:1"], 2), (["ftp://x", "--at", "1,2"], 2), (["udp://127.0.0.1:1", "--at", "1"], 2),
        (["udp://127.0.0.1:1", "--at", "91,2"], 2), (["udp://127.0.0.1:1", "none.geojson"], 3),
        (["tls://127.0.0.1:1", "--at", "1,2", "--cot-cert", "none.pem"], 3),
    ],
)  # fmt: skip
def test_what_makes_no_sense_has_its_exit_code(arguments: list[str], code: int) -> None:
    assert main(["cot", *arguments]) == code


def test_a_server_that_is_not_there_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as s:
        port = s.getsockname()[1]
    assert main(["cot", f"tcp://127.0.0.1:{port}", "--at", "1,2"]) == 4
