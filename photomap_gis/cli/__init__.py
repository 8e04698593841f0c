"""The command line: words into calls, results into words; one file a command."""

from photomap_gis.cli.app import main

__all__ = ["main"]
