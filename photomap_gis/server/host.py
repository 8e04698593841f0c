"""What one server process holds: its missions by name, their tiles, their finds, its listeners."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from pathlib import Path

from photomap_gis.core.errors import PhotomapError
from photomap_gis.export.encode import TileFormat
from photomap_gis.find_store import FindStore
from photomap_gis.server.events import Events
from photomap_gis.server.find_desk import FindDesk
from photomap_gis.server.find_grounds import FinishedGround, LiveGround
from photomap_gis.server.live_coverage import Coverage
from photomap_gis.server.live_documents import FindsDocument
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.live_view import LiveSession
from photomap_gis.server.missions import ServedMission, Snapshot
from photomap_gis.server.protocol import EventDocument
from photomap_gis.server.tilecache import TileAddress, TileCache
from photomap_gis.server.view import OpenView

AnyMission = ServedMission | LiveMission


class Host:
    """The missions of a server, finished ones and those being flown; safe among threads."""

    def __init__(self, open_view: OpenView) -> None:
        self._open_view = open_view
        self._missions: dict[str, AnyMission] = {}
        self._desks: dict[AnyMission, FindDesk] = {}
        self._coverages: dict[LiveMission, Coverage] = {}
        self._count = 0
        self._lock = threading.Lock()
        self._cache = TileCache()
        self._loop: asyncio.AbstractEventLoop | None = None
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

    def open_live(self, session: LiveSession) -> LiveMission:
        """Serve a flight; once it has ended its folder is served under the same name."""
        with self._lock:
            self._count += 1
            id = str(self._count)
            self._missions[id] = mission = LiveMission(id, session, self._moved)
            if self._loop is not None:
                mission.hub.attach(self._loop)
            return mission

    def close_mission(self, id: str) -> None:
        """Serve a mission no longer; ``KeyError`` where there is none of that name."""
        with self._lock:
            mission = self._missions.pop(id)
            self._desks.pop(mission, None)
        mission.close()

    def get(self, id: str | None) -> AnyMission:
        """Return a mission, the first one for ``None``; ``KeyError`` where there is none."""
        with self._lock:
            if id is None:
                id = next(iter(self._missions), "")
            return self._missions[id]

    def all(self) -> list[AnyMission]:
        """Return every mission."""
        with self._lock:
            return list(self._missions.values())

    @property
    def ids(self) -> list[str]:
        """The missions' names."""
        return [m.id for m in self.all()]

    def epochs(self) -> list[tuple[str, str]]:
        """Return each mission's name and epoch now; a flight that has ended becomes a mission like any other."""
        found = []
        for mission in self.all():
            with contextlib.suppress(PhotomapError, OSError, ValueError, LookupError):  # half written: the next look
                if isinstance(mission, LiveMission):
                    if mission.ended:
                        self._land(mission)
                    found.append((mission.id, mission.session.state.epoch))
                else:
                    found.append((mission.id, mission.current().epoch))
        return found

    def desk_of(self, mission: AnyMission) -> FindDesk:
        """Return the desk that keeps a mission's finds."""
        with self._lock:
            if mission not in self._desks:
                if isinstance(mission, LiveMission):
                    desk = FindDesk(FindStore(mission.session.state.folder), LiveGround(mission))
                else:
                    desk = FindDesk(FindStore(mission.folder), FinishedGround(mission))
                self._desks[mission] = desk
            return self._desks[mission]

    def coverage_of(self, mission: LiveMission) -> Coverage:
        """Return what works a flight's coverage out."""
        with self._lock:
            return self._coverages.setdefault(mission, Coverage(mission))

    def tell_finds(self, mission: AnyMission, id: str | None) -> None:
        """Tell listeners that finds have changed; finished missions tell it by their epoch."""
        if isinstance(mission, LiveMission):
            count = len(self.desk_of(mission).store.all())
            mission.hub.post(lambda: FindsDocument(id=id, count=count))

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to hand events to listeners, in ``loop``."""
        with self._lock:
            self._loop = loop
            for mission in self._missions.values():
                if isinstance(mission, LiveMission):
                    mission.hub.attach(loop)

    def close_streams(self) -> None:
        """End what listeners wait for; in the loop."""
        self.events.send(None)
        for mission in self.all():
            if isinstance(mission, LiveMission):
                mission.hub.close()
                mission.views.close()

    def tile(
        self, mission: ServedMission, snapshot: Snapshot, layer: str, zoom: int, x: int, y: int, tile_format: TileFormat
    ) -> bytes:
        """Return a tile's bytes; ``KeyError`` for no such layer, ``UsageError`` for no such tile."""
        address = TileAddress(mission.id, snapshot.pictures, layer, zoom, x, y, tile_format)
        return self._cache.get(snapshot, address)

    def close(self) -> None:
        """Let go of all files."""
        for mission in self.all():
            mission.close()

    def _served(self, folder: Path) -> ServedMission | None:
        found = (m for m in self._missions.values() if isinstance(m, ServedMission))
        return next((m for m in found if m.folder == folder and m.before is None), None)

    def _moved(self, mission: LiveMission) -> None:
        """The map has moved: so do its finds. Runs in a thread of its own."""
        with contextlib.suppress(PhotomapError):
            if self.desk_of(mission).replace_all():
                self.tell_finds(mission, None)

    def _land(self, mission: LiveMission) -> None:
        landed = ServedMission(mission.id, mission.session.state.folder.absolute(), self._open_view)
        with self._lock:
            self._missions[mission.id] = landed
            self._desks.pop(mission, None)
            self._coverages.pop(mission, None)
        mission.hub.post(lambda: EventDocument(event="mission", mission=mission.id, epoch=landed.current().epoch))
        mission.hub.finish()
        mission.close()
