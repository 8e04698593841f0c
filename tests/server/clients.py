"""The server's application over a mission, as a client sees it."""

from pathlib import Path

from starlette.testclient import TestClient

from photomap_gis.cli.serve_view import open_view
from photomap_gis.server import Access, Host, create_app


def client_of(folder: Path, before: Path | None = None, token: str | None = None, *, local: bool = True) -> TestClient:
    host = Host(open_view)
    host.open(folder, before)
    app = create_app(host, Access(token, loopback_only=local))
    return TestClient(app, base_url="http://127.0.0.1", follow_redirects=False)
