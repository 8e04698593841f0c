"""The plugin's zip: what is in it, that it is valid for QGIS's plugin repository, and that it is always the same."""

import ast
import configparser
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts" / "build_plugin.py"
MOST_BYTES = 25_000_000
WANTED = {
    "name", "qgisMinimumVersion", "description", "about", "version", "author", "email", "repository", "homepage",
    "tracker", "license", "tags", "icon", "hasProcessingProvider",
}  # fmt: skip


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The zip as ``make plugin`` builds it."""
    folder = tmp_path_factory.mktemp("dist")
    ran = subprocess.run([sys.executable, SCRIPT, "-o", folder], capture_output=True, text=True, check=True)
    return Path(ran.stdout.strip())


@pytest.fixture(scope="module")
def metadata(archive):
    parser = configparser.ConfigParser()
    with zipfile.ZipFile(archive) as plugin:
        parser.read_string(plugin.read("photomap/metadata.txt").decode())
    return dict(parser["general"])


def test_all_of_it_lies_in_one_folder_and_nothing_else_does(archive):
    assert archive.name.startswith("photomap-qgis-")
    with zipfile.ZipFile(archive) as plugin:
        names = [PurePosixPath(n) for n in plugin.namelist()]
    assert {n.parts[0] for n in names} == {"photomap"}
    inside = {str(n.relative_to("photomap")) for n in names}
    sources = {p.relative_to(ROOT / "qgis_plugin").as_posix() for p in (ROOT / "qgis_plugin").rglob("*.py")}
    assert sources <= inside
    assert {"metadata.txt", "LICENSE", "icon.svg", "help/qgis.md"} <= inside
    assert {n.suffix for n in names} <= {".py", ".txt", ".svg", ".md", ".png", ".qm", ".qml", ""}, "no binaries"
    assert not [n for n in names if "__pycache__" in n.parts or ".." in n.parts or "test" in n.name]
    assert archive.stat().st_size < MOST_BYTES


def test_the_same_sources_give_the_same_bytes(archive, tmp_path):
    subprocess.run([sys.executable, SCRIPT, "-o", tmp_path], capture_output=True, check=True)
    assert (tmp_path / archive.name).read_bytes() == archive.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == [archive.name], "nothing half written is left"


def test_metadata_are_what_the_repository_asks_for(metadata):
    keys = {k.lower() for k in WANTED}
    assert keys <= set(metadata)
    assert all(metadata[k].strip() for k in keys)
    low, high = (tuple(map(int, metadata[k].split("."))) for k in ("qgisminimumversion", "qgismaximumversion"))
    assert low <= (3, 22)
    assert high >= (4, 0)
    for key in ("homepage", "repository", "tracker"):
        assert metadata[key].startswith("https://")
    assert metadata["hasprocessingprovider"] == "yes"
    assert "GPL-2.0-or-later" in metadata["license"]
    assert "pip install photomap-gis" in metadata["about"], "the engine is a dependency, and it is named"


def test_its_version_is_that_of_the_engine(metadata, archive):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert metadata["version"] == project["project"]["version"]
    assert metadata["version"] in archive.name


def test_licence_and_icon_are_read_as_such(archive):
    with zipfile.ZipFile(archive) as plugin:
        assert "either version 2 of the License" in plugin.read("photomap/LICENSE").decode()
        for name in plugin.namelist():
            if name.endswith(".svg"):
                assert ElementTree.fromstring(plugin.read(name)).tag.endswith("svg"), name


def test_pictures_of_the_help_page_are_with_it(archive):
    with zipfile.ZipFile(archive) as plugin:
        names = plugin.namelist()
        page = plugin.read("photomap/help/qgis.md").decode()
        assert plugin.read("photomap/help/images/qgis-map.png").startswith(b"\x89PNG")
    for line in page.splitlines():
        if "](images/" in line:
            picture = line.split("](")[1].rstrip(")")
            assert f"photomap/help/{picture}" in names


@pytest.mark.parametrize("path", sorted((ROOT / "qgis_plugin").rglob("*.py")), ids=lambda p: p.name)
def test_python_of_the_oldest_qgis_can_read_it(path):
    """QGIS 3.22 on Windows brings Python 3.9; inside the plugin everything is imported relatively."""
    tree = ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 9))
    absolute = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.level == 0]
    assert not [m for m in absolute if m and m.startswith(("qgis_plugin", "photomap"))]
    if any(isinstance(n, (ast.FunctionDef, ast.ClassDef)) for n in tree.body) and path.name != "__init__.py":
        assert "annotations" in [a.name for n in tree.body if isinstance(n, ast.ImportFrom) and n.module == "__future__"
                                 for a in n.names], "else X | None fails on Python 3.9"  # fmt: skip
