"""What happened in a job, in order: bounded, replayed to whoever comes late, and told at once to whoever listens."""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from pydantic import BaseModel

from photomap_gis.engine.documents import EventName

_KEPT = 1500
_KEEP_ALIVE_S = 15.0


@dataclass(frozen=True, slots=True)
class Event:
    """One event; ``number`` counts from 1 within a job and is its SSE id."""

    number: int
    name: EventName
    data: str

    def as_sse(self) -> bytes:
        """Return its lines of a stream (WHATWG HTML 9.2); ``data`` is JSON and holds no line breaks."""
        return f"id: {self.number}\nevent: {self.name}\ndata: {self.data}\n\n".encode()


class History:
    """The events of one job; safe among threads.

    Of each stage's progress only the newest is kept, and of everything the newest 1500: a late listener sees where
    things stand. The ``end`` closes it.
    """

    def __init__(self) -> None:
        self._events: OrderedDict[tuple[str, str], Event] = OrderedDict()
        self._count = 0
        self._closed = False
        self._lock = threading.Lock()
        self._listeners: set[Callable[[], None]] = set()

    def add(self, name: EventName, document: BaseModel, key: str | None = None) -> None:
        """Append an event; one of the same name and ``key`` before it is forgotten. Nothing comes after ``end``."""
        data = document.model_dump_json()
        with self._lock:
            if self._closed:
                return
            self._count += 1
            place = (name, f"#{self._count}" if key is None else key)
            self._events.pop(place, None)
            self._events[place] = Event(self._count, name, data)
            if len(self._events) > _KEPT:
                self._events.popitem(last=False)
            self._closed = name == "end"
            listeners = list(self._listeners)
        for wake in listeners:
            wake()

    def after(self, number: int) -> tuple[list[Event], bool]:
        """Return the events with higher numbers, and whether none will follow them."""
        with self._lock:
            return [e for e in self._events.values() if e.number > number], self._closed

    async def stream(self, after: int) -> AsyncIterator[bytes]:
        """Yield the bytes of a listener's stream, until the end was told."""
        loop, woken = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            loop.call_soon_threadsafe(woken.set)

        with self._lock:
            self._listeners.add(wake)
        try:
            while True:
                woken.clear()
                events, closed = self.after(after)
                for event in events:
                    after = event.number
                    yield event.as_sse()
                if closed:
                    return
                try:
                    await asyncio.wait_for(woken.wait(), _KEEP_ALIVE_S)
                except TimeoutError:
                    yield b": still here\n\n"  # proxies cut connections that say nothing
        finally:
            with self._lock:
                self._listeners.discard(wake)
