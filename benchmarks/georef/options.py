"""What a run is to do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Options:
    """The seeds of the flights, the folder for them, and where words of progress go."""

    seeds: tuple[int, ...]
    folder: Path
    tell: Callable[[str], None] = lambda word: None
