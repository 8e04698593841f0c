"""Inner loops that NumPy can only take apart into many small calls, compiled by Numba to one pass over the pixels.

A kernel is a plain function of arrays and numbers, with its types said beforehand: it is compiled where its module is
first imported, never in the middle of a flight, and the machine code is kept beside the source, or in the user's cache
folder where that cannot be written to. It runs without Python's lock: threads that work in kernels work at once.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import logging
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import event

logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be taken in any order, which lets them be vectorised; NaN and infinity keep their meaning."""


def compiled(*signatures: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for each of these Numba signatures, such as ``"f8(f4[::1], f4[::1])"``.

    It may call other kernels, and use numbers, of its own room only: what is kept is made anew when a file of the room
    has changed.
    """

    def compile_now(function: Callable[P, R]) -> Callable[P, R]:
        try:
            made = numba.njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")(function)
            _drop_what_changed(Path(inspect.getfile(function)).parent, Path(made.stats.cache_path))
            _compile(made, signatures)
        except RuntimeError as nowhere:  # no folder to keep machine code in: compile anew each time
            logger.debug("%s is not kept: %s", function.__qualname__, nowhere)
            made = numba.njit(nogil=True, fastmath=FAST, error_model="numpy")(function)
            _compile(made, signatures)
        return cast(Callable[P, R], made)

    return compile_now


def _compile(made: Any, signatures: tuple[str, ...]) -> None:
    for signature in signatures:
        made.compile(signature)
    made.disable_compile()


@lru_cache
def _drop_what_changed(room: Path, kept: Path) -> None:
    """Remove the machine code of a room if any file of it is not what it was made from.

    Numba looks at a kernel's own file alone, but kernels and numbers of its neighbours are part of the machine code.
    """
    digest = hashlib.sha256()
    sources = sorted(room.glob("*.py"))
    for source in sources:
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    mark = kept / f"{room.name}.digest"
    with contextlib.suppress(OSError):
        if mark.read_text(encoding="ascii") == digest.hexdigest():
            return
    try:
        for source in sources:
            for index in kept.glob(f"{source.stem}.*.nbi"):
                index.unlink(missing_ok=True)
        kept.mkdir(parents=True, exist_ok=True)
        mark.write_text(digest.hexdigest(), encoding="ascii")
    except OSError as error:
        raise RuntimeError(f"{kept} cannot be written ({error.strerror})") from error


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
