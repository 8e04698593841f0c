"""Giving freed memory back: the C library keeps it, and a solver's many large arrays leave holes that only grow."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import cast


@cache
def _trim() -> Callable[[int], int] | None:
    try:
        return cast(Callable[[int], int], ctypes.CDLL(None).malloc_trim)
    except (OSError, AttributeError, TypeError):  # not glibc: its allocator has ways of its own
        return None


def give_back() -> bool:
    """Hand memory that is free to the operating system (a few milliseconds); whether there was a way to."""
    trim = _trim()
    return trim is not None and trim(0) >= 0
