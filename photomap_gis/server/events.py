"""Events to whoever listens (server-sent events, WHATWG HTML 9.2): a mission changed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from photomap_gis.server.protocol import EventDocument

_WAITING = 256
_KEEP_ALIVE_S = 15.0


class Events:
    """One stream a listener; a listener that does not read loses the oldest events, never the newest.

    Used within one event loop.
    """

    def __init__(self) -> None:
        self._queues: set[asyncio.Queue[EventDocument | None]] = set()
        self._count = 0

    def send(self, event: EventDocument | None) -> None:
        """Hand an event to every listener; ``None`` ends their streams."""
        for queue in self._queues:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(event)

    async def stream(self, first: list[EventDocument]) -> AsyncIterator[bytes]:
        """Yield the bytes of a listener's stream, ``first`` before all else."""
        queue: asyncio.Queue[EventDocument | None] = asyncio.Queue(_WAITING)
        self._queues.add(queue)
        try:
            for event in first:
                yield self._lines(event)
            while True:
                try:
                    waiting = await asyncio.wait_for(queue.get(), _KEEP_ALIVE_S)
                except TimeoutError:
                    yield b": still here\n\n"  # proxies cut connections that say nothing
                    continue
                if waiting is None:
                    return
                yield self._lines(waiting)
        finally:
            self._queues.discard(queue)

    def _lines(self, event: EventDocument) -> bytes:
        self._count += 1
        return f"id: {self._count}\nevent: {event.event}\ndata: {event.model_dump_json()}\n\n".encode()
