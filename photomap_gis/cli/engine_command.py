"""``photomap engine``: the server behind the QGIS plugin and scripts; it begins without a mission and runs jobs."""

from __future__ import annotations

import importlib

import click


@click.command(name="engine", short_help="Run jobs and show missions for the QGIS plugin and scripts.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port; 0 takes any.  [default: 0]")
@click.option("--stay", is_flag=True, help="Go on when stdin closes; else whoever started it ends it by going.")
def command(port: int, stay: bool) -> None:
    """Serve jobs (map, export, plan, upload ...) and missions over HTTP on this machine, until stdin closes.

    \b
    photomap engine                                  what the QGIS plugin starts
    photomap engine --stay --port 8799 </dev/null    for scripts: until ^C

    The first and only line on stdout is {"event": "ready", "api": 1, "port": ..., "token": ...}; every request shows
    that token (Authorization: Bearer ..., or ?token=...). docs/protocol.md has the rest:

    \b
    curl -H "Authorization: Bearer $TOKEN" http://127.0.0.1:$PORT/commands
    curl -H "Authorization: Bearer $TOKEN" http://127.0.0.1:$PORT/jobs \\
         -d '{"kind": "map", "arguments": {"sources": ["DCIM"], "output": "flight-1"}}'
    """
    import contextlib

    from photomap_gis.cli.lifeline import call_at_end_of_stdin
    from photomap_gis.cli.serve_view import open_view
    from photomap_gis.engine import EngineReadyDocument, Jobs, create_engine
    from photomap_gis.server import Access, BoundServer, Host, new_token

    token = new_token()
    server = BoundServer("127.0.0.1", port)
    access = Access(token, loopback_only=True, cookie=f"photomap-{server.port}")
    app = create_engine(Host(open_view), Jobs(job_command), access, on_stop=server.stop)

    def ready() -> None:
        click.echo(EngineReadyDocument(port=server.port, token=token).model_dump_json())
        if not stay:
            call_at_end_of_stdin(server.stop)

    with contextlib.suppress(KeyboardInterrupt):  # ^C is how it ends
        server.serve(app, ready)


def job_command(kind: str) -> click.Command:
    """Return the command of a job's kind."""
    module = importlib.import_module(f"photomap_gis.cli.{kind}_command")
    command: click.Command = module.command
    return command
