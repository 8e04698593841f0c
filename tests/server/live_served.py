"""A fake flight behind a real server in this process, so that a test drives the one and looks at the other."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from photomap_gis.cli.serve_view import open_view
from photomap_gis.server import Access, BoundServer, Host, create_app
from tests.server.live_fake import FakeSession


@dataclass
class Served:
    session: FakeSession
    host: Host
    url: str
    stop: object


@contextmanager
def live_server(
    session: FakeSession, *, port: int = 0, token: str | None = None, watch_s: float = 0.1
) -> Iterator[Served]:
    session.folder.mkdir(parents=True, exist_ok=True)
    host = Host(open_view)
    host.open_live(session)
    server = BoundServer("127.0.0.1", port)
    ready = threading.Event()
    app = create_app(host, Access(token, loopback_only=True), watch_s=watch_s)
    thread = threading.Thread(target=server.serve, args=(app, ready.set), daemon=True)
    thread.start()
    assert ready.wait(20)
    try:
        yield Served(session, host, server.url, server.stop)
    finally:
        server.stop()
        thread.join(20)
        assert not thread.is_alive()


def session_in(folder: Path, **options: bool) -> FakeSession:
    return FakeSession(folder / "flight", **options)
