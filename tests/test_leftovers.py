"""What killed runs leave of their outputs: the next run removes it, and nothing else."""

import os
import signal
import subprocess
import sys
import time

import pytest

from photomap_gis.publish import file_in_place_of, folder_in_place_of, remove_leftovers, write_file

POSIX = pytest.mark.skipif(os.name != "posix", reason="a process is killed by SIGKILL")


def killed(code: str, *arguments: str) -> None:
    run = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert run.returncode == -signal.SIGKILL, run.stderr


FILE = """
import os, signal, sys
from pathlib import Path
from photomap_gis.publish import file_in_place_of
with file_in_place_of(Path(sys.argv[1])) as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""

SWAP = """
import os, signal, sys
from pathlib import Path
from photomap_gis.publish import folder_in_place_of
rename = Path.rename
def once(self, target):
    done = rename(self, target)
    if Path(target).name == "old":
        os.kill(os.getpid(), signal.SIGKILL)
    return done
Path.rename = once
with folder_in_place_of(Path(sys.argv[1]), ours=lambda p: True) as fresh:
    (fresh / "new.txt").write_text("new")
"""


@POSIX
def test_a_killed_runs_leftovers_go_with_the_next_output_there(tmp_path):
    path = tmp_path / "map.tif"
    write_file(path, b"old")
    killed(FILE, str(path))
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 2, "the kill leaves something"
    write_file(tmp_path / "other.txt", b"x")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.tif", "other.txt"]


@POSIX
def test_a_folder_that_was_taken_away_by_a_killed_run_comes_back(tmp_path):
    path = tmp_path / "tiles"
    path.mkdir()
    (path / "old.txt").write_text("old")
    killed(SWAP, str(path))
    assert not path.exists()
    remove_leftovers(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["tiles"] and (path / "old.txt").read_text() == "old"
    killed(SWAP, str(path))
    with folder_in_place_of(path, ours=lambda p: True) as fresh:
        (fresh / "newest.txt").write_text("newest")
    assert [p.name for p in tmp_path.iterdir()] == ["tiles"]
    assert [p.name for p in path.iterdir()] == ["newest.txt"]


def test_runs_that_go_on_are_left_alone(tmp_path):
    with file_in_place_of(tmp_path / "slow.bin") as temporary:
        temporary.write_bytes(b"slowly")
        write_file(tmp_path / "quick.txt", b"x")
        remove_leftovers(tmp_path)
        assert temporary.read_bytes() == b"slowly"
    assert (tmp_path / "slow.bin").read_bytes() == b"slowly"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["quick.txt", "slow.bin"]


def test_what_nobody_claims_is_kept_for_a_day(tmp_path):
    young, old, theirs = (tmp_path / n for n in (".photomap-young", ".photomap-old", ".photomaps"))
    for folder in (young, old, theirs):
        folder.mkdir()
        (folder / "file").write_text("")
    long_ago = time.time() - 2 * 24 * 3600
    for path in (old / "file", old, theirs / "file", theirs):
        os.utime(path, (long_ago, long_ago))
    remove_leftovers(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == [".photomap-young", ".photomaps"]
