"""A ``photomap`` command in a process of its own: how it is started, asked to stop, and killed, on every system."""

from __future__ import annotations

import contextlib
import os
import signal
import site
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import photomap_gis
from photomap_gis.core.errors import DataError, UsageError


def photomap_command() -> list[str]:
    """Return the words that run this very package, wherever a job's folder is.

    ``-P`` keeps modules that happen to lie in that folder out of it.
    """
    return [sys.executable, "-P", "-m", "photomap_gis.cli"]


def job_environment() -> dict[str, str]:
    """Return the environment of a job: ours, progress as JSON, UTF-8 on pipes, and a lifeline."""
    environment = {
        **os.environ,
        "PHOTOMAP_PROGRESS": "json",
        "PHOTOMAP_LIFELINE": "stdin",
        "PYTHONUTF8": "1",
        "PYTHONIOENCODING": "utf-8",
    }
    package = str(Path(photomap_gis.__file__).resolve().parents[1])
    if package not in (*site.getsitepackages(), site.getusersitepackages()):  # run from a checkout
        before = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = package if not before else os.pathsep.join((package, before))
    return environment


def start_process(argv: Sequence[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start ``photomap`` with these words in a folder; it leads a process group of its own.

    Raises ``UsageError`` for a folder that is none or a command line that is too long, ``DataError`` where the system
    gives no process.
    """
    if not folder.is_dir():
        raise UsageError(f"the job's folder {folder} does not exist")
    try:
        return subprocess.Popen(
            [*photomap_command(), *argv],
            cwd=folder,
            env=job_environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=os.name == "posix",
            creationflags=0 if os.name == "posix" else getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and _is_too_long(error):
            raise UsageError("the arguments are too long for a command line: put the area into a file") from error
        raise DataError(f"no process could be started for the job: {error}") from error


def wait_for_end(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process's end, end what it started and left behind, and return its exit code."""
    if hasattr(os, "waitid"):
        with contextlib.suppress(ChildProcessError):
            # Not reaped yet: until then no other process can have its number, so no other can be hit.
            os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
            kill_tree(process)
    return process.wait()


def ask_to_stop(process: subprocess.Popen[bytes]) -> None:
    """Close the process's lifeline: it stops as by ^C, at a state from which it can go on."""
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()


def kill_tree(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it started, at once."""
    if os.name == "posix":
        with contextlib.suppress(OSError):  # ended already
            os.killpg(process.pid, signal.SIGKILL)
        return
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        subprocess.run(
            ["taskkill", "/T", "/F", "/PID", str(process.pid)],
            capture_output=True,
            timeout=10,
            check=False,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    with contextlib.suppress(OSError):
        process.kill()


def _is_too_long(error: OSError) -> bool:
    import errno

    return error.errno == errno.E2BIG or getattr(error, "winerror", None) == 206  # ERROR_FILENAME_EXCED_RANGE
