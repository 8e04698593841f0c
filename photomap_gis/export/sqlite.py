"""A new SQLite file, for the formats that are databases (MBTiles, GeoPackage)."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from photomap_gis.core.errors import OutputError


@contextlib.contextmanager
def new_database(temporary: Path, path: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection to a new database at ``temporary``; its failures are told as those of ``path``."""
    db = sqlite3.connect(temporary)
    try:
        # The file is new and moved into place when whole: a journal would only write everything twice.
        db.execute("PRAGMA journal_mode = OFF")
        db.execute("PRAGMA synchronous = OFF")
        yield db
        db.commit()
    except sqlite3.Error as error:
        advice = "free some space or choose another place" if "full" in str(error) else "check the disk"
        raise OutputError(f"{path} cannot be written: {error}; {advice}") from error
    finally:
        db.close()


def check_tiles(temporary: Path, path: Path, table: str, count: int) -> None:
    """Raise ``OutputError`` where a file that becomes ``path`` does not hold ``count`` tiles in a sound ``table``."""
    db = sqlite3.connect(temporary)
    try:
        (found,) = db.execute(f'SELECT count(*) FROM "{table}"').fetchone()
        (state,) = db.execute("PRAGMA quick_check").fetchone()
    except sqlite3.Error as error:
        raise OutputError(f"{path} is damaged after writing ({error}); check the disk") from error
    finally:
        db.close()
    if found != count or state != "ok":
        raise OutputError(f"{path} is damaged after writing ({found} of {count} tiles, {state}); check the disk")
