"""The clock of this machine, as live sources see it."""

from __future__ import annotations

import time


class SystemClock:
    """Monotonic seconds, Unix seconds that never jump against them, and real waiting."""

    def __init__(self) -> None:
        self._monotonic_to_utc_s = time.time() - time.monotonic()

    def now_s(self) -> float:
        """Return monotonic seconds."""
        return time.monotonic()

    def utc_s(self) -> float:
        """Return Unix seconds, as the system's clock had them when this one was made."""
        return self._monotonic_to_utc_s + time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(max(0.0, seconds))
