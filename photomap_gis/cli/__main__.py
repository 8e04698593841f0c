"""``python -m photomap_gis.cli``: the command where its script is not on the path."""

import sys

from photomap_gis.cli import main

sys.exit(main())
