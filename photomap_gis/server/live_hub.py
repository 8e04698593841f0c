"""What happens in a session, to everybody who listens: server-sent events, and the stabilised view.

A listener has a place for the newest pose, one for the newest health, one for the ground that changed, and a short
queue for what happens seldom. So one that reads slowly gets newer poses less often, never old ones, and nobody waits
for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections import deque
from collections.abc import AsyncIterator, Callable

from photomap_gis.server.live_documents import (
    HealthDocument,
    LiveDocument,
    LiveEventDocument,
    PoseDocument,
    TilesDocument,
)
from photomap_gis.server.live_view import LivePicture

POSE_EVERY_S = 1.0 / 15.0
_TILES_EVERY_S = 0.2
_KEEP_ALIVE_S = 3.0
_WAITING = 128
_REMEMBERED = 512
_MOST_AREAS = 48
_LINGER_S = 2.0
"""A page asks again within this: between two questions the view goes on."""


class _Listener:
    """What one listener has not been sent yet."""

    def __init__(self) -> None:
        self.pose: PoseDocument | None = None
        self.health: HealthDocument | None = None
        self.tiles: TilesDocument | None = None
        self.others: deque[LiveEventDocument] = deque(maxlen=_WAITING)
        self.wake = asyncio.Event()

    def put(self, event: LiveEventDocument) -> None:
        if isinstance(event, PoseDocument):
            self.pose = event
        elif isinstance(event, HealthDocument):
            self.health = event
        elif isinstance(event, TilesDocument):
            self.tiles = event if self.tiles is None else merged(self.tiles, event)
        else:
            self.others.append(event)
        self.wake.set()


class LiveHub:
    """Hands a session's events to listeners; events come from any thread, listeners live in one event loop."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listeners: set[_Listener] = set()
        self._remembered: deque[tuple[int, LiveEventDocument]] = deque(maxlen=_REMEMBERED)
        self._count = 0
        self._closed = False
        # An id of an earlier run must not be taken for one of this.
        self._run = secrets.token_hex(3)

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Begin to hand events over, in ``loop``."""
        self._loop = loop

    def close(self) -> None:
        """End every stream; in the loop."""
        self._closed = True
        for listener in self._listeners:
            listener.wake.set()

    def finish(self) -> None:
        """End every stream once what waits was sent; from any thread."""
        loop = self._loop
        if loop is not None and not self._closed:
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(self.close)

    @property
    def listeners(self) -> int:
        """How many listen."""
        return len(self._listeners)

    def post(self, make: Callable[[], LiveEventDocument | None]) -> None:
        """Hand an event over, from any thread and at once; ``make`` runs in the loop."""
        loop = self._loop
        if loop is None or self._closed:
            return
        try:
            loop.call_soon_threadsafe(self._deliver, make)
        except RuntimeError:  # the loop has ended: so have all listeners
            self._loop = None

    def _deliver(self, make: Callable[[], LiveEventDocument | None]) -> None:
        event = make()
        if event is None:
            return
        if not isinstance(event, PoseDocument | HealthDocument):
            self._count += 1
            self._remembered.append((self._count, event))
        for listener in self._listeners:
            listener.put(event)

    async def stream(self, first: Callable[[], LiveDocument], last_id: str | None) -> AsyncIterator[bytes]:
        """Yield a listener's bytes: ``first`` (the state), what it missed since ``last_id``, then what happens."""
        listener = _Listener()
        missed = self._missed(last_id)
        self._listeners.add(listener)
        try:
            state = first()
            yield self._lines(state.model_copy(update={"missed": missed is None}), listener)
            for event in missed or ():
                listener.put(event)
            tiles_due = 0.0
            clock = asyncio.get_running_loop().time
            while not self._closed:
                try:
                    await asyncio.wait_for(listener.wake.wait(), _KEEP_ALIVE_S)
                except TimeoutError:
                    # Proxies cut connections that say nothing, and a page cannot tell silence from a lost server.
                    yield b"event: alive\ndata: {}\n\n"
                    continue
                listener.wake.clear()
                while listener.others:
                    yield self._lines(listener.others.popleft(), listener)
                if listener.tiles is not None and clock() >= tiles_due:
                    tiles, listener.tiles = listener.tiles, None
                    tiles_due = clock() + _TILES_EVERY_S
                    yield self._lines(tiles, listener)
                if listener.health is not None:
                    health, listener.health = listener.health, None
                    yield self._lines(health, listener)
                if listener.pose is not None:
                    pose, listener.pose = listener.pose, None
                    yield self._lines(pose, listener)
                if listener.tiles is not None:
                    listener.wake.set()
                await asyncio.sleep(POSE_EVERY_S)
            while listener.others:
                yield self._lines(listener.others.popleft(), listener)
        finally:
            self._listeners.discard(listener)

    def _missed(self, last_id: str | None) -> list[LiveEventDocument] | None:
        """Return what came after an id; ``None`` where that is not known any more, nothing for a new listener."""
        if last_id is None:
            return []
        run, _, number = last_id.partition("-")
        known = self._remembered[0][0] - 1 if self._remembered else self._count
        if run != self._run or not (number.isascii() and number.isdigit() and len(number) < 12):
            return None
        return [e for n, e in self._remembered if n > int(number)] if known <= int(number) <= self._count else None

    def _lines(self, event: LiveEventDocument, listener: _Listener) -> bytes:
        # An id says that all up to it was sent: none where something still waits.
        whole = not listener.others and listener.tiles is None
        id = f"id: {self._run}-{self._count}\n" if whole else ""
        return f"{id}event: {event.event}\ndata: {event.model_dump_json()}\n\n".encode()


def merged(a: TilesDocument, b: TilesDocument) -> TilesDocument:
    """Return two events as one; beyond some number of areas as the box around all."""
    areas = [*a.areas, *b.areas]
    if len(areas) > _MOST_AREAS:
        west, south, east, north = zip(*areas, strict=True)
        areas = [(min(west), min(south), max(east), max(north))]
    return TilesDocument(version=max(a.version, b.version), areas=areas, all=a.all or b.all)


class Views:
    """The stabilised view for everybody who watches; made only while somebody does."""

    def __init__(self, watch: Callable[[Callable[[LivePicture], None]], Callable[[], None]]) -> None:
        self._watch = watch
        self._stop: Callable[[], None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._newest: LivePicture | None = None
        self._changed = asyncio.Event()
        self._watchers = 0
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether there is nothing more to see."""
        return self._closed

    async def after(self, sequence: int, timeout_s: float) -> LivePicture | None:
        """Return the newest picture once it is newer than ``sequence``; ``None`` where none comes in time."""
        self._watchers += 1
        try:
            self._begin()
            loop = asyncio.get_running_loop()
            until = loop.time() + timeout_s
            while (left := until - loop.time()) > 0 and not self._closed:
                if self._newest is not None and self._newest.sequence > sequence:
                    return self._newest
                try:
                    await asyncio.wait_for(self._changed.wait(), left)
                except TimeoutError:
                    break
            return None
        finally:
            self._watchers -= 1
            asyncio.get_running_loop().call_later(_LINGER_S, self._end_if_alone)

    def close(self) -> None:
        """Stop watching, and let nobody wait any more; in the loop."""
        self._closed = True
        self._changed.set()
        self._watchers = 0
        self._end_if_alone()

    def _begin(self) -> None:
        self._loop = asyncio.get_running_loop()
        if self._stop is None and not self._closed:
            self._newest = None
            self._stop = self._watch(self._came)

    def _came(self, picture: LivePicture) -> None:
        loop = self._loop
        if loop is None:
            return
        try:
            loop.call_soon_threadsafe(self._take, picture)
        except RuntimeError:
            self._loop = None

    def _take(self, picture: LivePicture) -> None:
        if self._closed:
            return
        self._newest = picture
        self._changed.set()  # wakes all who wait; then the next picture is waited for
        self._changed.clear()

    def _end_if_alone(self) -> None:
        if self._watchers <= 0 and self._stop is not None:
            self._stop()
            self._stop = None
            self._newest = None
