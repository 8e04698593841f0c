"""``python -m photomap_gis.cli``: the command where its script is not on the path, and as a job of the engine."""

import sys

from photomap_gis.cli import main
from photomap_gis.cli.lifeline import stop_with_stdin

if __name__ == "__main__":
    stop_with_stdin()
    sys.exit(main())
