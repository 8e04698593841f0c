"""A server of ``photomap live`` (or ``serve``) as plain calls: standard library alone, no Qt; ``docs/protocol.md``."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import parse_qs, quote, urlencode, urlsplit

API = 1
_TIMEOUT_S = 15.0
_SILENCE_S = 40.0
"""The stream says that it is still there every 15 s; a link that is dead says nothing."""
_LONGEST_ANSWER = 64 << 20
_LONGEST_LINE = 4 << 20


class LiveError(Exception):
    """The server refused or cannot be reached, in words that say what to do. ``gone``: nobody answers."""

    def __init__(self, message: str, *, gone: bool = False) -> None:
        super().__init__(message)
        self.gone = gone


@dataclass(frozen=True)
class LiveAddress:
    """Where a session is served, by ``http`` as photomap's servers speak; ``token`` is empty where none is needed."""

    host: str
    port: int
    token: str = ""

    @staticmethod
    def parse(text: str) -> LiveAddress:
        """Return what ``photomap live`` prints, ``http://HOST:PORT/?token=...``; ``LiveError`` for anything else."""
        said = text.strip()
        try:
            parts = urlsplit(said if "//" in said else f"http://{said}")
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port, parts = None, None, urlsplit("")
        if parts.scheme != "http" or not host:
            raise LiveError(
                f"{said or 'nothing'} is no address: give what photomap live prints, as http://127.0.0.1:8765/?token=..."
            )
        return LiveAddress(host, port or 80, (parse_qs(parts.query).get("token") or [""])[0])

    @property
    def origin(self) -> str:
        """Return ``http://host:port``."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}"

    def url(self, path: str, **query: object) -> str:
        """Return the full address of a path of the server, with the token where there is one."""
        words = {k: str(v) for k, v in query.items()}
        if self.token:
            words["token"] = self.token
        joint = "&" if "?" in path else "?"
        return f"{self.origin}/{path.lstrip('/')}" + (joint + urlencode(words) if words else "")

    @property
    def page(self) -> str:
        """Return the address of the page for a browser."""
        return self.url("")


@dataclass(frozen=True)
class LiveEvent:
    """One event of a flight: ``id`` is the server's word for it, to go on from."""

    id: str
    name: str
    data: dict


class LiveConnection:
    """Calls to one server; they wait, so they belong on threads. Each opens a connection of its own."""

    def __init__(self, address: LiveAddress) -> None:
        self.address = address

    def mission(self) -> dict:
        """Return the document of mission 1; ``LiveError`` where what answers is no photomap of ours."""
        about = self.get("api")
        if not isinstance(about, dict) or about.get("product") != "photomap":
            raise LiveError(f"What answers at {self.address.origin} is no photomap: is the address right?")
        if about.get("api") != API:
            raise LiveError(f"That photomap speaks version {about.get('api')} of the protocol, this plugin {API}.")
        return self.get("missions/1")

    def get(self, path: str) -> dict:
        """Return a JSON document."""
        return self._call("GET", path)

    def mark(self, kind: str, lon_lat: tuple[float, float], note: str = "") -> dict:
        """Mark a find and return it."""
        body = {"kind": kind, "place": list(lon_lat), **({"note": note} if note else {})}
        return self._call("POST", "missions/1/finds", body)

    def finalise(self) -> None:
        """End the flight as the operator's q does."""
        self._call("POST", "missions/1/live/finalise", {})

    def accuracy(self, lon_lat: tuple[float, float]) -> dict | None:
        """Return the error ellipse of the map at a place, ``None`` where nothing was seen."""
        lon, lat = lon_lat
        return self.get(f"missions/1/live/accuracy?x={lon!r}&y={lat!r}").get("ellipse")

    def events(self, path: str, after: str = "") -> Iterator[LiveEvent]:
        """Yield events until the connection ends; ``LiveError`` (gone) where there is none."""
        connection = http.client.HTTPConnection(self.address.host, self.address.port, timeout=_SILENCE_S)
        try:
            headers = self._headers() | ({"Last-Event-ID": after} if after else {})
            connection.request("GET", f"/{path.lstrip('/')}", headers=headers)
            answer = connection.getresponse()
            if answer.status != 200:
                _document(answer.status, answer.read(_LONGEST_ANSWER))
                return
            yield from parse_stream(answer)
        except (OSError, http.client.HTTPException) as error:
            raise LiveError(_lost_words(self.address, error), gone=True) from error
        finally:
            connection.close()

    def _call(self, method: str, path: str, body: dict | None = None) -> dict:
        connection = http.client.HTTPConnection(self.address.host, self.address.port, timeout=_TIMEOUT_S)
        try:
            text = None if body is None else json.dumps(body)
            connection.request(method, f"/{quote(path.lstrip('/'), safe='/?=&.,-%')}", text, self._headers())
            answer = connection.getresponse()
            data = answer.read(_LONGEST_ANSWER)
        except (OSError, http.client.HTTPException) as error:
            raise LiveError(_lost_words(self.address, error), gone=True) from error
        finally:
            connection.close()
        return _document(answer.status, data)

    def _headers(self) -> dict[str, str]:
        found = {"Content-Type": "application/json", "Origin": self.address.origin}
        if self.address.token:
            found["Authorization"] = f"Bearer {self.address.token}"
        return found


def parse_stream(stream) -> Iterator[LiveEvent]:
    """Yield the events of a stream of server-sent events; what is not JSON is passed over."""
    id, name, data = "", "", []
    while True:
        raw = stream.readline(_LONGEST_LINE)
        if not raw:
            return
        line = raw.decode("utf-8", "replace").rstrip("\r\n")
        if not line:
            if name and data:
                try:
                    said = json.loads("\n".join(data))
                except ValueError:
                    said = None
                if isinstance(said, dict):
                    yield LiveEvent(id, name, said)
            name, data = "", []
            continue
        field, _, value = line.partition(":")
        value = value[1:] if value.startswith(" ") else value
        if field == "id":
            id = value
        elif field == "event":
            name = value
        elif field == "data":
            data.append(value)


def _document(status: int, data: bytes) -> dict:
    try:
        said = json.loads(data) if data else {}
    except ValueError:
        said = None
    if status < 400 and said is not None:
        return said
    if status == 401:
        raise LiveError("The server wants its token: give the whole address that photomap live printed.")
    words = said if isinstance(said, dict) else {}
    raise LiveError(str(words.get("message") or f"The server refused (HTTP {status})."))


def _lost_words(address: LiveAddress, error: Exception) -> str:
    return f"Nobody answers at {address.origin} ({error}): is photomap live running there?"
