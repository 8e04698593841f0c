"""A real engine in a process of its own, and plain requests to it: a twin of the plugin's client."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2

ROOT = Path(__file__).resolve().parents[2]


class EngineUnderTest:
    """``photomap engine`` as a program starts it."""

    def __init__(self, *options: str, **environment: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "photomap_gis.cli", "engine", *options],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env={**os.environ, **environment},
        )  # fmt: skip
        self.ready = json.loads(self.process.stdout.readline())
        self.http = httpx2.Client(
            base_url=f"http://127.0.0.1:{self.ready['port']}",
            headers={"Authorization": f"Bearer {self.ready['token']}"},
            timeout=60.0,
        )

    def get(self, path: str) -> Any:
        answer = self.http.get(path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def start(self, kind: str, folder: Path | None = None, **arguments: Any) -> dict[str, Any]:
        body: dict[str, Any] = {"kind": kind, "arguments": arguments}
        if folder is not None:
            body["folder"] = str(folder)
        answer = self.http.post("/jobs", json=body)
        assert answer.status_code == 201, answer.text
        return answer.json()

    def events(self, id: str, after: int = 0) -> Iterator[tuple[int, str, Any]]:
        with self.http.stream("GET", f"/jobs/{id}/events", headers={"Last-Event-ID": str(after)}) as answer:
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith("text/event-stream")
            fields: dict[str, str] = {}
            for line in answer.iter_lines():
                if line.startswith(":"):
                    continue
                if line:
                    name, _, value = line.partition(": ")
                    fields[name] = value
                elif fields:
                    yield int(fields["id"]), fields["event"], json.loads(fields["data"])
                    fields = {}

    def end_of(self, id: str) -> dict[str, Any]:
        *_, (_, name, data) = self.events(id)
        assert name == "end"
        return data

    def close(self) -> int:
        self.http.close()
        with contextlib.suppress(OSError, ValueError):
            self.process.stdin.close()
        code = self.process.wait(timeout=60)
        self.process.stdout.close()
        return code
