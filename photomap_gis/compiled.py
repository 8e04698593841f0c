"""Inner loops that NumPy can only take apart into many small calls, compiled by Numba to one pass over the pixels.

A kernel is a plain function of arrays and numbers, with its types said beforehand: it is compiled where its module is
first imported, never in the middle of a flight, and the machine code is kept beside the source, or in the user's cache
folder where that cannot be written to. It runs without Python's lock: threads that work in kernels work at once.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba
from numba.core import event

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be taken in any order, which lets them be vectorised; NaN and infinity keep their meaning."""


def compiled(*signatures: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for each of these Numba signatures, such as ``"f8(f4[::1], f4[::1])"``."""

    def compile_now(function: Callable[P, R]) -> Callable[P, R]:
        try:
            made = numba.njit(list(signatures), cache=True, nogil=True, fastmath=FAST, error_model="numpy")(function)
        except RuntimeError as nowhere:  # no folder to keep machine code in: compile anew each time
            logger.debug("%s is not kept: %s", function.__qualname__, nowhere)
            made = numba.njit(list(signatures), nogil=True, fastmath=FAST, error_model="numpy")(function)
        return cast(Callable[P, R], made)

    return compile_now


class _Say(event.Listener):  # type: ignore[misc]
    """Says once in a process that there is something to wait for."""

    def on_start(self, event: event.Event) -> None:
        if not self.said:
            self.said = True
            logger.warning("compiling the inner loops for this computer, once; this takes up to a minute")

    def on_end(self, event: event.Event) -> None:
        pass

    said = False


event.register("numba:compile", _Say())
