"""Where every output meets the disk: written in a workspace beside its place, synced, checked, then moved in whole.

A killed or failed run leaves the old output as it was; what a killed one leaves of the new, the next run in that folder
removes. Failures of the disk become an ``OutputError`` that says what to do.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from photomap_gis.core.errors import DataError, OutputError

Failures = tuple[type[Exception], ...]

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

SCRATCH_PREFIX = ".photomap-"
_CLAIM = ".claim"
_OLD_S = 24 * 3600.0  # a scratch folder that nobody claims is given up after a day
_NEARLY_FULL_BYTES = 4 << 20
_NO_RIGHT = {errno.EACCES, errno.EPERM, errno.EROFS}
_NO_SPACE = {errno.ENOSPC, errno.EDQUOT} if hasattr(errno, "EDQUOT") else {errno.ENOSPC}


@contextlib.contextmanager
def file_in_place_of(
    path: Path,
    check: Callable[[Path], None] | None = None,
    *,
    side_suffixes: tuple[str, ...] = (),
    failures: Failures = (),
) -> Iterator[Path]:
    """Yield a name to write to; on leaving, sync it, ``check`` it, and move it to ``path``.

    The yielded file lies in a fresh scratch folder beside ``path``, so side files of a library may lie there too; all
    of it vanishes where anything fails. ``check`` re-opens the file and raises ``OutputError`` where it is not sound.
    Files named like the output plus one of ``side_suffixes`` go with it: new ones are moved along, old ones removed,
    since they describe what is no more. ``failures`` are the exceptions by which the library that writes says that it
    could not.
    """
    if path.is_dir():
        raise OutputError(f"{path} is a folder: name a file for the output")
    with _scratch_beside(path, failures) as folder:
        temporary = folder / path.name
        yield temporary
        _sync(temporary)
        if check is not None:
            check(temporary)
        _replace(temporary, path)
        for suffix in side_suffixes:
            side = temporary.with_name(f"{path.name}{suffix}")
            if side.exists():
                _replace(side, path.with_name(side.name))
            else:
                path.with_name(side.name).unlink(missing_ok=True)


@contextlib.contextmanager
def folder_in_place_of(path: Path, *, ours: Callable[[Path], bool], failures: Failures = ()) -> Iterator[Path]:
    """Yield an empty folder to fill; on leaving, move it to ``path`` and remove what was there.

    An existing folder is replaced only where it is empty or ``ours`` says that an earlier export wrote it: a user who
    names his home folder must not lose it.
    """
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path} is a file: name a folder for the output")
    if path.is_dir() and any(path.iterdir()) and not ours(path):
        raise OutputError(f"{path} holds other files: name a new folder, or empty this one")
    with _scratch_beside(path, failures) as scratch:
        fresh = scratch / "new"
        fresh.mkdir()
        yield fresh
        if path.exists():
            path.rename(scratch / "old")
        try:
            fresh.rename(path)
        except BaseException:
            if (scratch / "old").exists():
                (scratch / "old").rename(path)
            raise
        _sync_folder(path.parent)


@contextlib.contextmanager
def output_errors(path: Path, *, failures: Failures = ()) -> Iterator[None]:
    """Turn failures of the disk or of a writer within the block into an ``OutputError`` about ``path``."""
    try:
        yield
    except failures as error:  # before OSError: a library's error may be one without an errno
        raise _writer_failed(path, error) from error
    except OSError as error:
        raise OutputError(_os_message(path, error)) from error


def write_file(path: Path, content: bytes) -> None:
    """Write a small file whole or not at all."""
    with file_in_place_of(path) as temporary:
        temporary.write_bytes(content)


@contextlib.contextmanager
def _scratch_beside(path: Path, failures: Failures) -> Iterator[Path]:
    parent = path.parent
    if not parent.is_dir():
        raise OutputError(f"{path} cannot be written: the folder {parent} does not exist; create it or choose another")
    with output_errors(path, failures=failures):
        remove_leftovers(parent)
        folder = Path(tempfile.mkdtemp(prefix=SCRATCH_PREFIX, dir=parent))
        owner = _claim(folder, path.name)
        try:
            yield folder
        except OutputError as error:  # what lies in the scratch folder is told of by the name that the user gave
            text = str(error).replace(str(folder / path.name), str(path)).replace(str(folder / "new"), str(path))
            raise OutputError(text.replace(str(folder), str(path))) from error
        finally:
            if owner is not None:
                os.close(owner)
            shutil.rmtree(folder, ignore_errors=True)


def remove_leftovers(parent: Path) -> None:
    """Remove what killed runs left of their outputs in a folder; those of runs that still go on are not touched.

    A run that was killed while it put a folder in the place of an old one has taken that away: it is put back.
    """
    for scratch in parent.glob(f"{SCRATCH_PREFIX}*"):
        if scratch.is_symlink() or not scratch.is_dir() or not _is_abandoned(scratch):
            continue
        with contextlib.suppress(OSError, UnicodeDecodeError):
            place = parent / Path((scratch / _CLAIM).read_text(encoding="utf-8")).name
            if (scratch / "old").exists() and not place.exists():
                (scratch / "old").rename(place)
        shutil.rmtree(scratch, ignore_errors=True)


def _claim(folder: Path, name: str) -> int | None:
    """Note in a scratch folder whom it is for, and hold that note open, locked, as long as this process lives."""
    note = folder / f"{_CLAIM}.new"
    try:
        owner = os.open(note, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        return None
    try:
        os.write(owner, name.encode())
        if fcntl is not None:
            fcntl.flock(owner, fcntl.LOCK_EX | fcntl.LOCK_NB)
            note.rename(folder / _CLAIM)  # only now: a claim that is there and not locked is a dead one's
    except OSError:  # a disk without locks: its age tells
        os.close(owner)
        return None
    return owner


def _is_abandoned(scratch: Path) -> bool:
    """Whether the process that made a scratch folder is gone."""
    try:
        if fcntl is not None and (scratch / _CLAIM).exists():
            with (scratch / _CLAIM).open("rb") as claim:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        newest = max(p.stat().st_mtime for p in (scratch, *scratch.iterdir()))
    except OSError:  # locked, or gone meanwhile
        return False
    return time.time() - newest > _OLD_S


def _os_message(path: Path, error: OSError) -> str:
    if error.errno in _NO_SPACE:
        return f"{path} cannot be written: the disk is full; free some space or choose another place"
    if error.errno in _NO_RIGHT:
        return (
            f"{path} cannot be written: the place is read-only or the file is in use; choose another place, "
            "or close the program that shows it"
        )
    return f"{path} cannot be written: {error.strerror or error}; choose another place"


def _writer_failed(path: Path, error: Exception) -> DataError:
    # GDAL seldom says that a disk is full, so ask the disk.
    with contextlib.suppress(OSError):
        if shutil.disk_usage(path.parent).free < _NEARLY_FULL_BYTES:
            return OutputError(f"{path} cannot be written: the disk is full; free some space or choose another place")
    reason = " ".join(str(error.__cause__ or error).split())
    return OutputError(f"{path} cannot be written: {reason}; check the disk, or choose another place")


def _sync(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _replace(temporary: Path, path: Path) -> None:
    temporary.replace(path)
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":
        return
    # The rename itself must outlive a power cut; some network disks cannot sync a folder, and then nothing can.
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
