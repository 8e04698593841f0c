"""Compiled kernels: right, kept, and free of Python's lock."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

KERNEL = """
import logging, sys
logging.basicConfig(level=logging.WARNING)
from photomap_gis.compiled import compiled

@compiled("f8(f4[::1], f4[::1])")
def dot(a, b):
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total

import numpy as np
print(dot(np.full(7, 2, np.float32), np.full(7, 3, np.float32)))
"""


def _run(script: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).parents[1])
    return subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": root, **environment},
    )  # fmt: skip


def test_a_kernel_is_compiled_once_and_kept(tmp_path: Path) -> None:
    script = tmp_path / "kernel.py"
    script.write_text(KERNEL, encoding="utf-8")
    first, second = _run(script), _run(script)
    assert first.stdout == second.stdout == "42.0\n"
    assert "compiling" in first.stderr
    assert "compiling" not in second.stderr


def test_a_kernel_is_made_anew_when_its_neighbour_changes(tmp_path: Path) -> None:
    """What is taken from another file of the room is part of the machine code."""
    script, neighbour = tmp_path / "kernel.py", tmp_path / "neighbour.py"
    neighbour.write_text("FACTOR = 1.0\n", encoding="utf-8")
    text = "from neighbour import FACTOR\n" + KERNEL.replace("return total", "return total * FACTOR")
    script.write_text(text, encoding="utf-8")
    assert _run(script).stdout == "42.0\n"
    neighbour.write_text("FACTOR = 2.0\n", encoding="utf-8")
    assert _run(script).stdout == "84.0\n"
    assert "compiling" not in _run(script).stderr


def test_where_nothing_can_be_kept_it_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from photomap_gis import compiled

    real = compiled.numba.njit

    def homeless(*args: object, **options: object) -> object:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return real(*args, **options)

    monkeypatch.setattr(compiled.numba, "njit", homeless)

    @compiled.compiled("i8(i8[::1])")
    def total(numbers: np.ndarray) -> int:
        found = 0
        for k in range(numbers.size):
            found += numbers[k]
        return found

    assert total(np.arange(5)) == 10
