"""The engine as plain calls: JSON over loopback with the standard library alone; ``docs/protocol.md`` is the contract.

Calls wait for their answers: in QGIS they belong on threads (``engine.py``, ``processing``), never in the window's. A
client may be used by several threads at once; each call opens a connection of its own.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

API = 1
HOST = "127.0.0.1"
_TIMEOUT_S = 30.0
_STREAM_TIMEOUT_S = 60.0
"""The engine says that it is still there every 15 s."""
_LONGEST_ANSWER = 256 << 20
_RECONNECTS = 5
_RECONNECT_S = 0.3
_LOOK_S = 0.1

Document = dict[str, Any]


class EngineError(Exception):
    """The engine refused; ``message`` says what to do, ``status`` is HTTP's, ``error`` its kind."""

    def __init__(self, message: str, status: int = 0, error: str = "") -> None:
        super().__init__(message)
        self.message, self.status, self.error = message, status, error


class EngineGone(EngineError):
    """Nobody answers: the engine has ended, or was killed."""

    def __init__(self, why: str = "") -> None:
        super().__init__(
            "The photomap engine does not answer any more"
            + (f" ({why})" if why else "")
            + ". Try again: it is started anew, and a map goes on where it was stopped."
        )


class JobFailed(Exception):
    """A job ended without success; ``error`` is its document (``error``, ``message``, ``exit_code``)."""

    def __init__(self, error: Mapping[str, Any], result: Any = None) -> None:
        super().__init__(str(error.get("message") or "the job failed"))
        self.error, self.result = dict(error), result
        self.message = str(self)


class JobCancelled(Exception):
    """A job was stopped because it was asked to."""


class _NothingLeft(Exception):
    """All of a job's events were told before."""


@dataclass(frozen=True)
class Address:
    """Where an engine listens, and its token."""

    port: int
    token: str

    @staticmethod
    def of_ready_line(line: str) -> Address:
        """Return the address that an engine's first line tells; ``EngineError`` for anything else."""
        try:
            said = json.loads(line)
            if said["event"] != "ready":
                raise ValueError(said["event"])
            api, port, token = int(said["api"]), int(said["port"]), str(said["token"])
        except (ValueError, KeyError, TypeError) as error:
            raise EngineError(
                f"The engine began with {line[:200]!r}, not with its address: is the program in the settings photomap?"
            ) from error
        if api != API:
            raise EngineError(
                f"The engine speaks version {api} of the protocol, the plugin {API}: update the older one."
            )
        return Address(port, token)


@dataclass(frozen=True)
class Event:
    """One event of a job: ``name`` is state, progress, log, output or end."""

    number: int
    name: str
    data: Document


class Client:
    """Calls to one engine."""

    def __init__(self, address: Address, timeout_s: float = _TIMEOUT_S) -> None:
        self.address, self._timeout_s = address, timeout_s

    def about(self) -> Document:
        """Return who answers: ``version``, ``kinds``, ``missions``."""
        return self._call("GET", "/api")

    def commands(self) -> list[Document]:
        """Return every kind of job with its parameters."""
        return self._call("GET", "/commands")["commands"]

    def start_job(self, kind: str, arguments: Mapping[str, Any], folder: str | None = None) -> Document:
        """Start a job and return its document; ``EngineError`` with words where its arguments cannot be."""
        body: Document = {"kind": kind, "arguments": dict(arguments)}
        if folder:
            body["folder"] = folder
        return self._call("POST", "/jobs", body)

    def job(self, id: str) -> Document:
        """Return all that is known of a job."""
        return self._call("GET", f"/jobs/{quote(id)}")

    def jobs(self) -> list[Document]:
        """Return the jobs that are remembered, the newest last."""
        return self._call("GET", "/jobs")["jobs"]

    def stop_job(self, id: str, force: bool = False) -> Document:
        """Ask a job to stop; ``force`` kills it."""
        return self._call("DELETE", f"/jobs/{quote(id)}" + ("?force=1" if force else ""))

    def events(self, id: str, after: int = 0) -> Iterator[Event]:
        """Yield what happened in a job after an event's number, and what happens, up to its ``end``.

        A connection that breaks is made again where it was; ``EngineGone`` where nobody answers any more.
        """
        tries = 0
        while True:
            try:
                for event in self._stream(f"/jobs/{quote(id)}/events", after):
                    after, tries = event.number, 0
                    yield event
                    if event.name == "end":
                        return
                why = "the stream ended early"
            except _NothingLeft:
                return
            except (OSError, http.client.HTTPException) as error:
                why = str(error)
            tries += 1
            if tries > _RECONNECTS:
                raise EngineGone(why)
            self.about()  # says at once where nobody is there
            time.sleep(_RECONNECT_S * tries)

    def run_job(
        self,
        kind: str,
        arguments: Mapping[str, Any],
        folder: str | None = None,
        on_event: Callable[[Event], None] = lambda event: None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Run a job to its end and return its result; events come to ``on_event`` in the caller's thread.

        ``cancelled`` is asked ten times a second; once it is true the job is stopped. Raises ``JobFailed``,
        ``JobCancelled``, ``EngineError``.
        """
        id = self.start_job(kind, arguments, folder)["id"]
        waiting: queue.Queue = queue.Queue()

        def follow() -> None:
            try:
                for event in self.events(id):
                    waiting.put(event)
            except EngineError as error:
                waiting.put(error)

        threading.Thread(target=follow, name=f"photomap-job-{id}", daemon=True).start()
        asked = False
        while True:
            if not asked and cancelled():
                asked = True
                self.stop_job(id)
            try:
                said = waiting.get(timeout=_LOOK_S)
            except queue.Empty:
                continue
            if isinstance(said, EngineError):
                raise said
            on_event(said)
            if said.name == "end":
                return result_of(said.data)

    def open_mission(self, folder: str, before: str | None = None) -> Document:
        """Open a mission folder and return its document; ``EngineError`` where it cannot be shown."""
        return self._call("POST", "/missions", {"folder": folder, "before": before})

    def missions(self) -> list[Document]:
        """Return the missions that are open."""
        return self._call("GET", "/missions")["missions"]

    def mission(self, id: str) -> Document:
        """Return a mission as it is now."""
        return self._call("GET", f"/missions/{quote(id)}")

    def close_mission(self, id: str) -> None:
        """Close a mission; its folder stays."""
        self._call("DELETE", f"/missions/{quote(id)}")

    def geojson(self, id: str, what: str) -> Document:
        """Return ``frames``, ``track`` or ``finds`` of a mission."""
        return self._call("GET", f"/missions/{quote(id)}/{quote(what)}.geojson")

    def tiles_url(self, mission: Mapping[str, Any], layer: str = "map") -> str:
        """Return a layer's XYZ template, with the epoch that keeps caches honest and the token."""
        id, epoch, token = quote(mission["id"]), quote(mission["epoch"]), quote(self.address.token)
        base = f"http://{HOST}:{self.address.port}/missions/{id}/layers/{quote(layer)}"
        return base + "/{z}/{x}/{y}.png?epoch=" + epoch + "&token=" + token

    def stop_engine(self) -> None:
        """Ask the engine to end, with its jobs."""
        self._call("POST", "/stop")

    def _call(self, method: str, path: str, body: Document | None = None) -> Any:
        connection = http.client.HTTPConnection(HOST, self.address.port, timeout=self._timeout_s)
        try:
            text = None if body is None else json.dumps(body)
            connection.request(method, path, text, self._headers())
            answer = connection.getresponse()
            data = answer.read(_LONGEST_ANSWER)
        except TimeoutError as error:  # on Python 3.9 socket.timeout, an OSError, below
            raise EngineError("The photomap engine is too busy to answer: try again in a moment.") from error
        except (OSError, http.client.HTTPException) as error:
            raise EngineGone(str(error)) from error
        finally:
            connection.close()
        return _document(answer.status, data)

    def _stream(self, path: str, after: int) -> Iterator[Event]:
        connection = http.client.HTTPConnection(HOST, self.address.port, timeout=_STREAM_TIMEOUT_S)
        try:
            connection.request("GET", path, headers={**self._headers(), "Last-Event-ID": str(after)})
            answer = connection.getresponse()
            if answer.status == 204:
                raise _NothingLeft
            if answer.status != 200:
                _document(answer.status, answer.read(_LONGEST_ANSWER))
                return
            yield from parse_events(answer)
        finally:
            connection.close()

    def _headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.address.token}", "Content-Type": "application/json"}


def parse_events(lines: Any) -> Iterator[Event]:
    """Yield the events of a stream's lines (bytes); comments and fields that we do not know are passed over."""
    number, name, data = 0, "", ""
    for raw in lines:
        line = raw.decode("utf-8", "replace").rstrip("\r\n")
        if not line:
            if name and data:
                with contextlib.suppress(ValueError):
                    yield Event(number, name, json.loads(data))
            name = data = ""
            continue
        field, _, value = line.partition(":")
        value = value[1:] if value.startswith(" ") else value
        if field == "id" and value.isdigit():
            number = int(value)
        elif field == "event":
            name = value
        elif field == "data":
            data = value if not data else f"{data}\n{value}"


def result_of(end: Mapping[str, Any]) -> Any:
    """Return the result that an ``end`` tells; ``JobFailed`` or ``JobCancelled`` where it was none."""
    if end.get("state") == "done":
        return end.get("result")
    if end.get("state") == "cancelled":
        raise JobCancelled("stopped; what was finished is kept, and the same job goes on from there")
    raise JobFailed(end.get("error") or {}, end.get("result"))


def _document(status: int, data: bytes) -> Any:
    try:
        said = json.loads(data) if data else None
    except ValueError:
        said = None
    if status < 400:
        if data and said is None:
            raise EngineError("What answers there is not a photomap engine.", status)
        return said
    words = said if isinstance(said, dict) else {}
    message = str(words.get("message") or f"The engine refused (HTTP {status}).")
    raise EngineError(message, status, str(words.get("error") or ""))
