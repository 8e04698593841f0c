"""The engine of Processing: started by the first algorithm, kept for the next (batches, models), ended with QGIS.

It is not the plugin's own (``engine.py``): algorithms run on threads, and in ``qgis_process`` without a window.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from ..client import Client, EngineError
from ..process import EngineProcess

_lock = threading.Lock()
_held: list[tuple[tuple[str, ...], EngineProcess, Client]] = []


def engine_for(command: Sequence[str]) -> Client:
    """Return an engine that runs by this command and answers; ``EngineError`` where none can be started."""
    with _lock:
        for words, process, client in list(_held):
            try:
                if words != tuple(command):
                    raise EngineError("another one is wanted")
                client.about()
                return client
            except EngineError:
                _held.clear()
                process.__exit__()
        process = EngineProcess(command)
        client = process.__enter__()
        _held.append((tuple(command), process, client))
        return client


def release() -> None:
    """End it, without waiting for that."""
    with _lock:
        held = list(_held)
        _held.clear()
    for _, process, _ in held:
        threading.Thread(target=process.__exit__, name="photomap-goodbye").start()
