"""Puts OpenLayers, the map library of ``photomap serve``'s page, into the package when it is built or installed.

The official build (``ol.js``, ``ol.css`` of npm's ``ol``) is not kept in the repository. It is had from npm where
there is one, else out of a package on PyPI that carries the same two files, by the pip that builds this one. Their
SHA-256 are pinned here, so both ways give the same bytes or none. Where neither works the package is built without
them: the server works, and its page says what to do. ``python hatch_build.py`` does the same for a checkout.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

NPM_PACKAGE = "ol@10.7.0"
PYPI_PACKAGE = "pyopenlayersqt==0.21.0"  # only its two files of OpenLayers are taken: it is not installed
SHA256 = {
    "ol.js": "c8a9508a5f1806a6c6ca400360aaa160394a2399709e6b030678a5c99ea36fad",
    "ol.css": "abc8afd72cc10bd29cc143f443bae4a6804bd3cb3fb262e6b6a6bc6c924ea34f",
}
FOLDER = Path(__file__).parent / "photomap_gis" / "server" / "web" / "dist"
_SECONDS = 120


def has_openlayers(folder: Path = FOLDER) -> bool:
    """Whether the two files are there, whole."""
    return all(
        (folder / name).is_file() and _sha256((folder / name).read_bytes()) == sha for name, sha in SHA256.items()
    )


def get_openlayers(folder: Path = FOLDER) -> list[str]:
    """Put the two files into ``folder``; return why not, by way, empty where they are there."""
    if has_openlayers(folder):
        return []
    why: list[str] = []
    for way in (_by_npm, _by_pip):
        try:
            files = way()
            for name, sha in SHA256.items():
                if _sha256(files[name]) != sha:
                    raise ValueError(f"{name} is not the one that was expected (SHA-256)")
        except (
            OSError,
            ValueError,
            KeyError,
            subprocess.SubprocessError,
            tarfile.TarError,
            zipfile.BadZipFile,
        ) as error:
            why.append(f"{way.__name__.removeprefix('_by_')}: {error}")
            continue
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            temporary = folder / f".{name}.{os.getpid()}"
            temporary.write_bytes(data)
            temporary.replace(folder / name)
        return []
    return why


def _by_npm() -> dict[str, bytes]:
    npm = shutil.which("npm")
    if npm is None:
        raise FileNotFoundError("npm is not installed")
    [archive] = _downloaded([npm, "pack", "--ignore-scripts", "--fetch-retries=1", NPM_PACKAGE], "*.tgz")
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        return {
            name: _read(tar.extractfile(f"package/{inside}"))
            for name, inside in (("ol.js", "dist/ol.js"), ("ol.css", "ol.css"))
        }


def _by_pip() -> dict[str, bytes]:
    options = ["--no-deps", "--only-binary", ":all:", "--disable-pip-version-check", "--retries=1", "--quiet"]
    [wheel] = _downloaded([sys.executable, "-m", "pip", "download", *options, PYPI_PACKAGE], "*.whl")
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        return {name: archive.read(f"pyopenlayersqt/vendor/ol/{name}") for name in SHA256}


def _downloaded(command: list[str], pattern: str) -> list[bytes]:
    """Run a command that downloads into its folder, and return what it brought."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=_SECONDS, check=False)
        files = [path.read_bytes() for path in Path(folder).glob(pattern)]
    if done.returncode or len(files) != 1:
        last = (done.stderr.strip().splitlines() or ["nothing was downloaded"])[-1]
        raise OSError(last)
    return files


def _read(stream: Any) -> bytes:
    if stream is None:
        raise KeyError("the package does not hold the file")
    data: bytes = stream.read()
    return data


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _warn(why: list[str], say: Callable[[str], object]) -> None:
    if why:
        say(f"OpenLayers could not be had ({'; '.join(why)}): 'photomap serve' will have no map page, only its tiles")


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run as a script in a checkout
    pass
else:

    class OpenLayersHook(BuildHookInterface):  # type: ignore[misc,type-arg,unused-ignore]
        """Runs before a wheel is made, an editable one too."""

        PLUGIN_NAME = "custom"

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            """Get the files, and have them in the wheel though git ignores them."""
            _warn(get_openlayers(), self.app.display_warning)
            build_data["artifacts"] += [f"photomap_gis/server/web/dist/{name}" for name in SHA256]


if __name__ == "__main__":
    problems = get_openlayers()
    _warn(problems, lambda text: print(text, file=sys.stderr))
    sys.exit(3 if problems else 0)
