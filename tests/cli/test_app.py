"""The command line's frame: help, exit codes, no tracebacks."""

import subprocess
import sys

import click
import pytest

from photomap_gis.cli import app, main
from photomap_gis.core.errors import DataError, LinkError, MissingExtraError, UsageError


def test_help_lists_every_command_and_the_exit_codes(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in app.COMMANDS)
    assert "130 stopped" in text


@pytest.mark.parametrize("name", app.COMMANDS)
def test_every_command_teaches_with_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"photomap {name}" in text.split("Options:")[0].split("\n", 1)[1], "an example beside the usage line"


def test_unknown_command_is_a_usage_error(capsys):
    assert main(["fly"]) == 2
    assert "No such command" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UsageError("x"), 2),
        (DataError("x"), 3),
        (LinkError("x"), 4),
        (MissingExtraError("x"), 5),
        (KeyboardInterrupt(), 130),
        (ZeroDivisionError("x"), 1),
        (MemoryError(), 3),
    ],
)
def test_errors_become_one_line_and_an_exit_code(monkeypatch, capsys, error, code):
    def fail() -> None:
        raise error

    monkeypatch.setattr(app.LazyGroup, "get_command", lambda *_: click.Command("map", callback=fail))
    assert main(["map"]) == code
    err = capsys.readouterr().err.lstrip("\n")  # click ends the line that ^C was echoed on
    assert err.startswith("photomap: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from photomap_gis.cli import main; main(['--help']);"
        "heavy = {'cv2', 'gtsam', 'scipy', 'rasterio', 'pyproj', 'av', 'numpy', 'pydantic'} & set(sys.modules);"
        "sys.exit(', '.join(heavy) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
