"""What one server process holds: its missions by name, their tiles, its listeners."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path

from photomap_gis.core.errors import PhotomapError
from photomap_gis.export.encode import TileFormat
from photomap_gis.server.events import Events
from photomap_gis.server.missions import ServedMission, Snapshot
from photomap_gis.server.tilecache import TileAddress, TileCache
from photomap_gis.server.view import OpenView


class Host:
    """The missions of a server; safe among threads."""

    def __init__(self, open_view: OpenView) -> None:
        self._open_view = open_view
        self._missions: dict[str, ServedMission] = {}
        self._count = 0
        self._lock = threading.Lock()
        self._cache = TileCache()
        self.events = Events()

    def open(self, folder: Path, before: Path | None = None) -> ServedMission:
        """Serve a mission folder; one that is served already keeps its name. ``PhotomapError`` where it cannot be."""
        folder = folder.absolute()
        with self._lock:
            if before is None and (served := self._served(folder)) is not None:
                return served
            self._count += 1
            id = str(self._count)
        mission = ServedMission(id, folder, self._open_view, before)  # not under the lock: it reads many files
        with self._lock:
            if before is None and (served := self._served(folder)) is not None:
                mission.close()  # somebody else was quicker
                return served
            self._missions[id] = mission
            return mission

    def close_mission(self, id: str) -> None:
        """Serve a mission no longer; ``KeyError`` where there is none of that name."""
        with self._lock:
            mission = self._missions.pop(id)
        mission.close()

    def get(self, id: str | None) -> ServedMission:
        """Return a mission, the first one for ``None``; ``KeyError`` where there is none."""
        with self._lock:
            if id is None:
                id = next(iter(self._missions), "")
            return self._missions[id]

    def _served(self, folder: Path) -> ServedMission | None:
        return next((m for m in self._missions.values() if m.folder == folder and m.before is None), None)

    def all(self) -> list[ServedMission]:
        """Return every mission."""
        with self._lock:
            return list(self._missions.values())

    @property
    def ids(self) -> list[str]:
        """The missions' names."""
        return [m.id for m in self.all()]

    def epochs(self) -> list[tuple[str, str]]:
        """Return each mission's name and epoch now."""
        found = []
        for mission in self.all():
            with contextlib.suppress(PhotomapError):
                found.append((mission.id, mission.current().epoch))
        return found

    def tile(
        self, mission: ServedMission, snapshot: Snapshot, layer: str, zoom: int, x: int, y: int, tile_format: TileFormat
    ) -> bytes:
        """Return a tile's bytes; ``KeyError`` for no such layer, ``UsageError`` for no such tile."""
        address = TileAddress(mission.id, snapshot.epoch, layer, zoom, x, y, tile_format)
        return self._cache.get(snapshot, address)

    def close(self) -> None:
        """Let go of all files."""
        for mission in self.all():
            mission.close()
