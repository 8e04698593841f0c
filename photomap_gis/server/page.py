"""The page: our sources built into one script and one style by ``photomap_gis/server/web/build.py`` at set-up."""

from __future__ import annotations

from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response

WEB = Path(__file__).parent / "web"
BUILT = WEB / "dist"
_KINDS = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".txt": "text/plain"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
NOT_BUILT = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>photomap</title>
<body style="font:16px/1.5 system-ui;max-width:40em;margin:3em auto;padding:0 1em">
<h1>The page was not built</h1>
<p>This version has no map page yet; tiles, WMTS and GeoJSON work.</p>
<p>Meanwhile: <a href="missions">missions</a>, <a href="wmts.xml">WMTS capabilities</a>,
<a href="tiles.json">TileJSON</a>.</p>"""


def is_built() -> bool:
    """Whether the page's script is there."""
    return (BUILT / "page.js").is_file()


class PageAssets:
    """Answers with the page and its two files, and with nothing else of the disk."""

    def index(self, request: Request) -> Response:
        """The page; where it was not built, one that says how to."""
        if not is_built():
            return HTMLResponse(NOT_BUILT, status_code=503)
        return FileResponse(
            WEB / "index.html",
            media_type="text/html",
            headers={"content-security-policy": _POLICY, "cache-control": "no-cache"},
        )

    def asset(self, request: Request) -> Response:
        """A built file by its plain name."""
        name = request.path_params["name"]
        kind = _KINDS.get(Path(name).suffix)
        # Names are compared with what the folder holds: no path that a client makes up is ever opened.
        if kind is None or not BUILT.is_dir() or name not in {p.name for p in BUILT.iterdir() if p.is_file()}:
            raise HTTPException(404, "no such file")
        return FileResponse(BUILT / name, media_type=kind, headers={"cache-control": "no-cache"})
