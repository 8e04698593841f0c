"""What the user has chosen: a frozen value, read from and written to QGIS's settings."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from qgis.core import QgsSettings

GROUP = "photomap"
MOST_RECENT = 12


@dataclass(frozen=True)
class Settings:
    """Choices of the options page.

    ``engine_path`` is the ``photomap`` program, ``environment`` the Python or the folder of the environment that it is
    installed in; empty: it is looked for. ``stay`` leaves the engine running when QGIS closes. ``memory_mb`` of 0 is
    the engine's own default. ``folder`` is where missions are made.
    """

    engine_path: str = ""
    environment: str = ""
    stay: bool = False
    memory_mb: int = 0
    folder: str = ""


def load_settings() -> Settings:
    """Return what the user has chosen; what cannot be read is as if it had never been chosen."""
    store, found = QgsSettings(), {}
    for field in fields(Settings):
        kind = type(field.default)
        try:
            found[field.name] = store.value(f"{GROUP}/{field.name}", field.default, type=kind)
        except TypeError:
            found[field.name] = field.default
    return Settings(**found)


def save_settings(settings: Settings) -> None:
    """Keep what the user has chosen."""
    store = QgsSettings()
    for name, value in asdict(settings).items():
        store.setValue(f"{GROUP}/{name}", value)


def default_folder(settings: Settings) -> Path:
    """Return the folder in which new missions are made."""
    return Path(settings.folder).expanduser() if settings.folder else Path.home() / "photomap"


def recent_missions() -> list[str]:
    """Return the folders of the missions that were open last, newest first; folders that are gone are left out."""
    try:
        kept = json.loads(QgsSettings().value(f"{GROUP}/recent", "[]", type=str))
    except (ValueError, TypeError):
        return []
    return [path for path in kept if isinstance(path, str) and Path(path).is_dir()] if isinstance(kept, list) else []


def remember_mission(folder: str) -> list[str]:
    """Put a mission at the head of the recent ones, and return them."""
    folder = str(Path(folder).absolute())
    recent = [folder, *(path for path in recent_missions() if path != folder)][:MOST_RECENT]
    QgsSettings().setValue(f"{GROUP}/recent", json.dumps(recent))
    return recent


def forget_mission(folder: str) -> list[str]:
    """Take a mission off the list (its folder stays), and return the others."""
    recent = [path for path in recent_missions() if path != folder]
    QgsSettings().setValue(f"{GROUP}/recent", json.dumps(recent))
    return recent
