"""The ``photomap`` command: finds the subcommand, loads only its module, and turns errors into exit codes."""

from __future__ import annotations

import importlib
import logging
import os
import sys
import traceback

import click

from photomap_gis import __version__
from photomap_gis.core.errors import PhotomapError

COMMANDS = {
    "map": "Make a georeferenced photo map from photos or a video.",
    "live": "Grow the map while the drone flies: on a page, in QGIS, exportable at any moment.",
    "replay": "Fly a recorded live session again and compare: the same poses, the same pixels.",
    "solve": "Solve a mission again, with ground control or without.",
    "georeference": "Give a map its place by picked points, or nudge it.",
    "export": "Write a mission's map as GeoTIFF, KMZ, tiles, GeoPackage, ATAK, PDF ...",
    "graph": "Draw a mission's pose graph, or write it as GeoJSON or g2o.",
    "serve": "Show a mission's map in a browser; tiles and WMTS for QGIS and ArcGIS.",
    "finds": "List a mission's finds, or write them as GeoJSON, KML, GPX, CoT.",
    "reference": "Lay a mission's map on existing imagery.",
    "compare": "Say what has changed between old imagery and a new map.",
    "package": "Pack a mission into one file for the incident commander.",
    "plan": "Plan a coverage flight over an area, with proof of what it sees.",
    "cameras": "List the cameras that plans can name.",
    "convert": "Convert a mission: .plan to .waypoints and back.",
    "upload": "Upload a plan to an autopilot, verify it, restore on failure.",
    "download": "Download an autopilot's mission, fence and rally points.",
    "clear": "Clear an autopilot's mission, fence and rally points.",
    "vehicle": "Say who is on a link: mode, position, battery, mission progress.",
    "cot": "Push finds (or a try) to ATAK devices as Cursor on Target.",
    "engine": "Run jobs and show missions for the QGIS plugin and scripts.",
    "info": "Say what is in a source before anyone waits for a map.",
    "simulate": "Simulate a flight with known truth over any picture.",
    "demo": "Simulate a flight, map it and compare with the truth.",
}

EXIT_STOPPED = 130
EXIT_INTERNAL = 1

EPILOG = """\b
Exit codes: 0 done; 2 usage; 3 data (an input or output cannot be used);
4 link or vehicle failed; 5 an optional extra is missing; 130 stopped;
1 a fault of photomap itself.
Results are printed on stdout, progress and words on stderr."""


class LazyGroup(click.Group):
    """Knows its commands' names and one-line helps; imports a command's module when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order in which a user meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return a command."""
        if name not in COMMANDS:
            return None
        module = importlib.import_module(f"photomap_gis.cli.{name}_command")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.command(cls=LazyGroup, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="photomap")
@click.option("-v", "--verbose", is_flag=True, help="Say more on stderr.")
def cli(verbose: bool) -> None:
    """From a drone's video or photos to an up-to-date, georeferenced photo map in your GIS.

    \b
    Start here:   photomap map PHOTOS_FOLDER -o MISSION
    Try it:       photomap demo
    """
    logging.basicConfig(
        level=logging.INFO if verbose else logging.ERROR, stream=sys.stderr, format="%(name)s: %(message)s"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code; a user never sees a traceback unless PHOTOMAP_DEBUG is set."""
    try:
        result = cli.main(args=arguments, prog_name="photomap", standalone_mode=False)
        return result if isinstance(result, int) else 0
    except click.exceptions.Exit as error:
        return error.exit_code
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("photomap: stopped; what was finished is kept, the same command resumes", err=True)
        return EXIT_STOPPED
    except PhotomapError as error:
        _debug()
        click.echo(f"photomap: {error}", err=True)
        return error.exit_code
    except BrokenPipeError:  # the reader of our stdout went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        click.echo("photomap: out of memory: use a coarser --gsd or fewer frames", err=True)
        return PhotomapError.exit_code
    except Exception as error:
        _debug()
        where = traceback.extract_tb(error.__traceback__)[-1]
        click.echo(
            f"photomap: internal fault ({type(error).__name__}: {error}, {where.name} line {where.lineno}); "
            "set PHOTOMAP_DEBUG=1 for the traceback and report it",
            err=True,
        )
        return EXIT_INTERNAL


def _debug() -> None:
    if os.environ.get("PHOTOMAP_DEBUG"):
        traceback.print_exc()
