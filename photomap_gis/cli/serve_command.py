"""``photomap serve``: a mission's map in a browser, and its tiles for QGIS and ArcGIS."""

from __future__ import annotations

import contextlib
import webbrowser
from pathlib import Path

import click

from photomap_gis.core.errors import UsageError


@click.command(name="serve", short_help="Show a mission's map in a browser; tiles and WMTS for QGIS and ArcGIS.")
@click.argument("mission", type=click.Path(path_type=Path), default=Path(), required=False)
@click.option("--before", type=click.Path(path_type=Path), metavar="FILE",
              help="An older GeoTIFF, or another mission, to swipe against.")  # fmt: skip
@click.option("--port", type=int, metavar="N", help="Port; 0 takes any.  [default: 8765, or a free one]")
@click.option("--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
              help="Where to listen; 0.0.0.0 lets other machines in, with a token.")  # fmt: skip
@click.option(
    "--token", metavar="TEXT", help="The token that must be shown; default: a new one where --host asks for it."
)
@click.option("--open", "open_browser", is_flag=True, help="Open the page in this machine's browser.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON line on stdout when ready.")
def command(
    mission: Path,
    before: Path | None,
    port: int | None,
    host: str,
    token: str | None,
    open_browser: bool,
    as_json: bool,
) -> None:
    """Show MISSION's map (default: the current folder) on a page, until ^C.

    \b
    photomap serve flight-1                          then open the address it prints
    photomap serve flight-2 --before flight-1        swipe between two missions
    photomap serve flight-1 --before ortho-2019.tif
    photomap serve flight-1 --host 0.0.0.0           for phones in the same network; prints a token
    """
    from photomap_gis.cli.serve_view import open_view
    from photomap_gis.server import Access, BoundServer, Host, create_app, is_loopback, new_token
    from photomap_gis.server.page import HOW_TO_GET, is_built
    from photomap_gis.server.protocol import ReadyDocument

    if token is not None and not (token.isascii() and token.isprintable() and len(token) >= 8 and " " not in token):
        raise UsageError("--token must be 8 or more ASCII characters without spaces")
    served = Host(open_view)
    shown = served.open(mission, before)
    local = is_loopback(host)
    if not local and token is None:
        token = new_token()
    server = BoundServer(host, port)
    url = server.url + ("" if token is None else f"?token={token}")
    app = create_app(served, Access(token, loopback_only=local, cookie=f"photomap-{server.port}"))

    def ready() -> None:
        if as_json:
            click.echo(ReadyDocument(port=server.port, token=token, url=url).model_dump_json())
        else:
            click.echo(url)
            _teach(server.url, token, georeferenced=shown.current().view.georeferenced)
            if not is_built():
                click.echo(f"the map page is not installed: {HOW_TO_GET}; tiles and WMTS work", err=True)
        if open_browser:
            webbrowser.open(url)

    with contextlib.suppress(KeyboardInterrupt):  # ^C is how it ends
        server.serve(app, ready)


def _teach(root: str, token: str | None, *, georeferenced: bool) -> None:
    key = "" if token is None else f"?token={token}"
    if georeferenced:
        click.echo(f"QGIS, XYZ tiles:  {root}tiles/{{z}}/{{x}}/{{y}}.png{key}", err=True)
        click.echo(f"QGIS, WMTS:       {root}wmts.xml{key}", err=True)
        click.echo(f"TileJSON:         {root}tiles.json{key}", err=True)
    else:
        click.echo("not georeferenced: the page shows pixels of the first frame; there are no web tiles", err=True)
    if token is not None:
        click.echo(
            "whoever has this address can see the map: give it to nobody else (the link is not encrypted)", err=True
        )
    click.echo("^C ends it", err=True)
