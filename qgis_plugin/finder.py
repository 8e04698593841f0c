"""Where the engine is: in the settings, on PATH, or in an environment of its own; never in QGIS's own Python."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .environment import clean_environment, is_in, qgis_roots

MODULE = "photomap_gis.cli"
USUAL_ENVIRONMENT = "photomap-env"
"""The folder in the user's home that the install command makes: found without any setting."""


class EngineNotFound(Exception):
    """There is no engine; the message says how to get one."""


@dataclass(frozen=True)
class Found:
    """The words that run ``photomap``, and how they were found, for people."""

    command: tuple[str, ...]
    how: str


def install_words(windows: bool | None = None) -> str:
    """Return how to install the engine, once, in an environment of its own."""
    if os.name == "nt" if windows is None else windows:
        make = f"py -3 -m venv %USERPROFILE%\\{USUAL_ENVIRONMENT}"
        fill = f"%USERPROFILE%\\{USUAL_ENVIRONMENT}\\Scripts\\pip install photomap-gis"
    else:
        make, fill = f"python3 -m venv ~/{USUAL_ENVIRONMENT}", f"~/{USUAL_ENVIRONMENT}/bin/pip install photomap-gis"
    return f"{make} && {fill}"


def not_found_words() -> str:
    """Return the one message for a machine without an engine."""
    return (
        f"The photomap engine is not installed. Run this once in a terminal (Python 3.11 or newer): {install_words()} "
        "An engine that is elsewhere is named in Settings > Options > photomap."
    )


def find_engine(
    program: str = "",
    environment: str = "",
    environ: Mapping[str, str] | None = None,
    roots: Sequence[str] | None = None,
    home: Path | None = None,
) -> Found:
    """Return the engine's command: the setting ``program``, PATH, the Python of ``environment``, the usual environment.

    ``environment`` is a folder (venv or conda) or a Python in one. Raises ``EngineNotFound`` where there is none, and
    where a setting names something that is not there: a wrong setting is told, not passed over.
    """
    environ = os.environ if environ is None else environ
    roots = qgis_roots(environ) if roots is None else roots
    if program.strip():
        return Found((_program(program.strip(), roots),), "as the settings say")
    search = clean_environment(environ, roots).get("PATH", "")
    on_path = shutil.which("photomap", path=search) if search else None
    if on_path is not None:
        return Found((on_path,), "on the search path")
    if environment.strip():
        return Found((_python(environment.strip(), roots), "-m", MODULE), "in the environment of the settings")
    usual = (Path.home() if home is None else home) / USUAL_ENVIRONMENT
    python = _python_of(usual)
    if python is not None:
        return Found((str(python), "-m", MODULE), f"in {usual}")
    raise EngineNotFound(not_found_words())


def _program(text: str, roots: Sequence[str]) -> str:
    path = Path(text).expanduser()
    if path.is_dir():
        inside = shutil.which("photomap", path=os.pathsep.join(str(path / part) for part in ("", "bin", "Scripts")))
        if inside is None:
            raise EngineNotFound(
                f"There is no program photomap in {path}: choose another in Settings > Options > photomap."
            )
        path = Path(inside)
    if not path.is_file() or not os.access(path, os.X_OK):
        raise EngineNotFound(
            f"The engine {path} of the settings is not a program. Choose another in Settings > Options > photomap, "
            f"or leave it empty. To install one: {install_words()}"
        )
    if is_in(str(path), roots):
        raise EngineNotFound(
            f"{path} belongs to QGIS: the engine needs an environment of its own. To make one: {install_words()}"
        )
    return str(path)


def _python(text: str, roots: Sequence[str]) -> str:
    path = Path(text).expanduser()
    python = _python_of(path) if path.is_dir() else path
    if python is None or not python.is_file():
        raise EngineNotFound(
            f"There is no Python in {path}: choose the folder of an environment in Settings > Options > photomap. "
            f"To make one: {install_words()}"
        )
    if is_in(str(python), roots) or os.path.normcase(str(python)) in _own_pythons():
        raise EngineNotFound(
            f"{python} is QGIS's own Python: the engine needs an environment of its own. To make one: {install_words()}"
        )
    return str(python)


def _python_of(folder: Path) -> Path | None:
    for name in ("bin/python", "bin/python3", "Scripts/python.exe", "python.exe"):
        if (folder / name).is_file():
            return folder / name
    return None


def _own_pythons() -> set:
    """The names of the Python that runs QGIS; links are not followed, since an environment's Python is one to it."""
    inside = [Path(sys.prefix) / name for name in ("bin/python", "bin/python3", "python.exe", "python3.exe")]
    return {os.path.normcase(str(path)) for path in (Path(sys.executable), *inside)}
