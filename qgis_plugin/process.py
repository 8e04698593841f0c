"""An engine of one's own for as long as a block lasts: for Processing algorithms, which run on threads and headless."""

from __future__ import annotations

import os
import queue
import subprocess
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

from .client import Address, Client, EngineError
from .environment import clean_environment, qgis_roots

_READY_S = 60.0
_GOODBYE_S = 20.0


class EngineProcess:
    """Starts an engine on entering, ends it on leaving; use as a context manager that gives a ``Client``."""

    def __init__(self, command: Sequence[str], environ: Mapping[str, str] | None = None) -> None:
        self._command = [*command, "engine"]
        source = os.environ if environ is None else environ
        self._environment = clean_environment(source, qgis_roots(source))
        self._process: subprocess.Popen | None = None

    def __enter__(self) -> Client:
        """Start it; ``EngineError`` where it cannot be, with its own last words."""
        words = tempfile.TemporaryFile()
        try:
            self._process = subprocess.Popen(
                self._command,
                env=self._environment,
                cwd=Path.home(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=words,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            words.close()
            raise EngineError(f"The engine {self._command[0]} cannot be started: {error.strerror or error}.") from error
        lines: queue.Queue = queue.Queue()
        pipe = self._process.stdout
        threading.Thread(target=lambda: lines.put(pipe.readline()), name="photomap-ready", daemon=True).start()
        try:
            line = lines.get(timeout=_READY_S).decode("utf-8", "replace")
            if not line:
                words.seek(0)
                said = words.read()[-2000:].decode("utf-8", "replace").strip()
                raise EngineError(f"The engine {self._command[0]} ended at once. It said: {said or 'nothing'}")
            return Client(Address.of_ready_line(line))
        except queue.Empty:
            self.__exit__()
            raise EngineError(f"The engine {self._command[0]} did not get ready within {_READY_S:.0f} s.") from None
        except EngineError:
            self.__exit__()
            raise
        finally:
            words.close()

    def __exit__(self, *_: object) -> None:
        """Close its stdin, which ends it and its jobs."""
        process = self._process
        if process is None:
            return
        try:
            process.stdin.close()
            process.wait(_GOODBYE_S)
        except (OSError, subprocess.TimeoutExpired):
            process.kill()
            process.wait()
        finally:
            process.stdout.close()
            self._process = None
