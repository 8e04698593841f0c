"""The page: our sources in ``server/web``, and OpenLayers, which ``hatch_build.py`` puts beside them when installed."""

from __future__ import annotations

from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response

WEB = Path(__file__).parent / "web"
BUILT = WEB / "dist"
_OURS = {
    "page.js": "text/javascript",
    "overlays.js": "text/javascript",
    "coordinates.js": "text/javascript",
    "finds.js": "text/javascript",
    "layers.js": "text/javascript",
    "live.js": "text/javascript",
    "liveoverlays.js": "text/javascript",
    "livetiles.js": "text/javascript",
    "liveview.js": "text/javascript",
    "page.css": "text/css",
    "openlayers-license.txt": "text/plain",
}
_BUILT = {"ol.js": "text/javascript", "ol.css": "text/css"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
HOW_TO_GET = "install photomap again where pip or npm reaches its registry (in a checkout: python hatch_build.py)"
WITHOUT_OPENLAYERS = f"""<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>photomap</title>
<body style="font:16px/1.5 system-ui;max-width:40em;margin:3em auto;padding:0 1em">
<h1>The map page is not installed</h1>
<p>Its map library, OpenLayers, could not be had when photomap was installed. To have the page, {HOW_TO_GET}.</p>
<p>Everything else works: <a href="wmts.xml">WMTS capabilities</a> and <a href="tiles.json">TileJSON</a> for a GIS,
<a href="missions">the mission</a> for scripts.</p>"""


def is_built() -> bool:
    """Whether OpenLayers is there."""
    return all((BUILT / name).is_file() for name in _BUILT)


class PageAssets:
    """Answers with the page and its files, and with nothing else of the disk."""

    def index(self, request: Request) -> Response:
        """The page; where OpenLayers is absent, one that says how to get it."""
        if not is_built():
            return HTMLResponse(WITHOUT_OPENLAYERS, status_code=503)
        return FileResponse(
            WEB / "index.html",
            media_type="text/html",
            headers={"content-security-policy": _POLICY, "cache-control": "no-cache"},
        )

    def asset(self, request: Request) -> Response:
        """A file of the page by its plain name."""
        name = request.path_params["name"]
        # Names are looked up in what is known: no path that a client makes up is ever opened.
        kind = _OURS.get(name) or _BUILT.get(name)
        path = (WEB if name in _OURS else BUILT) / name if kind else None
        if path is None or not path.is_file():
            raise HTTPException(404, "no such file")
        return FileResponse(path, media_type=kind, headers={"cache-control": "no-cache"})
