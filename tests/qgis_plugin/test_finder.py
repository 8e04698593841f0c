"""The engine is found where it may be, never in QGIS's own Python; else there is one message with the way to get it."""

import os
import sys
from pathlib import Path

import pytest

from qgis_plugin.finder import EngineNotFound, find_engine, install_words, not_found_words


def executable(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def find(tmp_path):
    """The finder on a machine that has nothing but what a test puts there."""

    def find(program="", environment="", path="", roots=()):
        return find_engine(program, environment, {"PATH": path}, roots, home=tmp_path / "home")

    return find


def test_the_setting_goes_before_the_path_before_the_environment_before_the_usual_place(find, tmp_path):
    usual = executable(tmp_path / "home" / "photomap-env" / "bin" / "python")
    assert find().command == (str(usual), "-m", "photomap_gis.cli")
    env = executable(tmp_path / "env" / "bin" / "python")
    assert find(environment=str(tmp_path / "env")).command == (str(env), "-m", "photomap_gis.cli")
    assert find(environment=str(env)).command == (str(env), "-m", "photomap_gis.cli")
    on_path = executable(tmp_path / "bin" / "photomap")
    path = os.pathsep.join([str(tmp_path / "empty"), str(tmp_path / "bin")])
    assert find(environment=str(tmp_path / "env"), path=path).command == (str(on_path),)
    chosen = executable(tmp_path / "elsewhere" / "photomap")
    assert find(str(chosen), str(tmp_path / "env"), path).command == (str(chosen),)
    assert find(str(chosen.parent)).command == (str(chosen),)  # its folder will do


def test_windows_environments_have_their_python_elsewhere(find, tmp_path):
    python = executable(tmp_path / "venv" / "Scripts" / "python.exe")
    assert find(environment=str(tmp_path / "venv")).command[0] == str(python)
    python = executable(tmp_path / "conda" / "python.exe")
    assert find(environment=str(tmp_path / "conda")).command[0] == str(python)


def test_none_is_one_message_with_the_install_command(find):
    with pytest.raises(EngineNotFound) as none:
        find()
    assert str(none.value) == not_found_words()
    assert "pip install photomap-gis" in str(none.value)
    assert "Settings" in str(none.value)
    assert "Scripts\\pip" in install_words(windows=True)
    assert "bin/pip" in install_words(windows=False)


def test_a_wrong_setting_is_told_and_not_passed_over(find, tmp_path):
    path = str(executable(tmp_path / "bin" / "photomap").parent)
    for wrong in (tmp_path / "none", executable(tmp_path / "x" / "other").parent):
        with pytest.raises(EngineNotFound, match=r"settings|no program photomap"):
            find(str(wrong), path=path)
    plain = tmp_path / "plain"
    plain.write_text("no program")
    with pytest.raises(EngineNotFound, match="is not a program"):
        find(str(plain), path=path)
    with pytest.raises(EngineNotFound, match="no Python in"):
        find(environment=str(tmp_path / "none"))


def test_what_belongs_to_qgis_is_never_taken(find, tmp_path):
    qgis = tmp_path / "QGIS 3.34"
    inside = executable(qgis / "bin" / "photomap")
    python = executable(qgis / "apps" / "Python39" / "python.exe")
    with pytest.raises(EngineNotFound, match="not installed"):
        find(path=str(qgis / "bin"), roots=[str(qgis)])
    for words in ({"program": str(inside)}, {"environment": str(python)}, {"environment": str(python.parent)}):
        with pytest.raises(EngineNotFound, match="environment of its own"):
            find(roots=[str(qgis)], **words)
    with pytest.raises(EngineNotFound, match="QGIS's own Python"):
        find(environment=sys.executable)  # the Python that runs this is QGIS's own, as far as the finder can know
