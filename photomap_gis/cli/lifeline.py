"""The lifeline of a process that works for another: its standard input.

Whoever started it holds the other end. When that closes, on purpose or because its holder died in any way, the process
is told to stop as by ^C. Unlike signals this works alike on every system, and no child outlives a killed parent.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable

LIFELINE_VARIABLE = "PHOTOMAP_LIFELINE"
_CHUNK_BYTES = 4096


def stop_with_stdin() -> None:
    """Where ``PHOTOMAP_LIFELINE=stdin`` is set, raise ``KeyboardInterrupt`` in the main thread when stdin ends."""
    # Taken out, so that processes which this one starts do not watch a stdin that is not theirs.
    if os.environ.pop(LIFELINE_VARIABLE, None) != "stdin":
        return
    # A parent in the background of a shell bequeaths ^C as ignored, and a job must hear it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    call_at_end_of_stdin(interrupt_main_thread)


def call_at_end_of_stdin(then: Callable[[], None]) -> None:
    """Call ``then`` from a thread of its own when standard input ends; what comes in before is read and forgotten."""

    def wait() -> None:
        with contextlib.suppress(OSError, ValueError):
            while sys.stdin is not None and os.read(sys.stdin.fileno(), _CHUNK_BYTES):
                pass  # no stdin at all is one that has ended
        then()

    threading.Thread(target=wait, name="lifeline", daemon=True).start()


def interrupt_main_thread() -> None:
    """Do to the main thread what ^C does, also where it waits in a system call."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        import _thread

        _thread.interrupt_main()
