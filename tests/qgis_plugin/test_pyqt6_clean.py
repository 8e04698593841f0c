"""The plugin runs on Qt 5 and Qt 6: a rule over its sources, and each name of Qt looked up in PyQt6 itself."""

import ast
import importlib
import sys
from pathlib import Path

import pytest

PLUGIN = Path(__file__).parents[2] / "qgis_plugin"
SOURCES = sorted(PLUGIN.rglob("*.py"))
MOVED = {"QAction": "QtGui", "QActionGroup": "QtGui", "QShortcut": "QtGui", "QUndoStack": "QtGui"}
"""Classes that qgis.PyQt.QtWidgets has in every QGIS, though Qt 6 moved them."""
GONE = frozenset({"exec_", "QRegExp", "QDesktopWidget", "QMatrix", "globalPos", "posF", "QGLWidget", "fromUtf8"})
ENUMS = frozenset({"QgsMapLayerType"})
"""Imported names that are enums themselves."""
GIVEN_BY_QGIS = frozenset({"qgis", "osgeo", "processing"})


def violations(source: str) -> list[str]:
    """Return what of a source would not work on Qt 6, or outside of QGIS's own Python."""
    tree = ast.parse(source)
    found = []
    classes: set[str] = set()
    notes = {id(n) for node in ast.walk(tree) for n in _annotations(node)}
    scopes = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
    called = {id(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [f"import {a.name}" for a in node.names if not _allowed(a.name)]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            if not _allowed(node.module or ""):
                found.append(f"from {node.module} import")
            if (node.module or "").startswith("qgis."):
                classes |= {a.asname or a.name for a in node.names}
            wrong = node.module == "qgis.PyQt.QtGui"
            found += [a.name for a in node.names if a.name in GONE]
            found += [f"{a.name} from QtGui" for a in node.names if wrong and a.name in MOVED]
        if isinstance(node, (ast.Attribute, ast.Name)):
            name = node.attr if isinstance(node, ast.Attribute) else node.id
            if name in GONE:
                found.append(name)
    for node in ast.walk(tree):
        unscoped = (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in classes - ENUMS
            and node.attr[:1].isupper()
            and id(node) not in scopes
            and id(node) not in notes
            and id(node) not in called
        )
        if unscoped:
            found.append(f"{node.value.id}.{node.attr} is not scoped")
    return found


def _allowed(module: str) -> bool:
    root = module.split(".")[0]
    return root in GIVEN_BY_QGIS or root in sys.stdlib_module_names


def _annotations(node):
    for note in (getattr(node, "annotation", None), getattr(node, "returns", None)):
        if isinstance(note, ast.AST):
            yield from ast.walk(note)


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PLUGIN)))
def test_a_source_is_clean(path):
    assert violations(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("source", [
    "from PyQt5.QtCore import Qt", "import PyQt6", "import numpy", "from rasterio import open",
    "from qgis.PyQt.QtCore import Qt\nx = Qt.LeftButton",
    "from qgis.core import Qgis\nprint(Qgis.Warning)",
    "from qgis.PyQt.QtWidgets import QMessageBox\nQMessageBox().exec_()",
    "from qgis.PyQt.QtGui import QAction",
    "from qgis.PyQt.QtWidgets import QFrame\nf(QFrame.NoFrame | 1)",
    "from qgis.PyQt.QtCore import QRegExp",
])  # fmt: skip
def test_the_rule_finds_what_qt_6_or_qgis_has_not(source):
    assert violations(source)


@pytest.mark.parametrize("source", [
    "import json\nfrom qgis.PyQt.QtCore import Qt\nx = Qt.MouseButton.LeftButton",
    "from qgis.PyQt.QtCore import QProcess\ndef f(e: QProcess.ProcessError) -> QProcess.ExitStatus: ...",
    "from qgis.PyQt.QtWidgets import QAction\nfrom .words import tr",
])  # fmt: skip
def test_the_rule_lets_pass_what_works(source):
    assert violations(source) == []


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(PLUGIN)))
def test_qt_6_has_every_name(path):
    """Imports and scoped enums are looked up in PyQt6: what QGIS on Qt 6 will find there."""
    pytest.importorskip("PyQt6.QtWidgets", reason="PyQt6 is not installed (extra dev)", exc_type=ImportError)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = {}
    for node in ast.walk(tree):
        if not (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("qgis.PyQt.")):
            continue
        for name in node.names:
            module = MOVED.get(name.name, node.module.removeprefix("qgis.PyQt."))
            found = importlib.import_module(f"PyQt6.{module}")
            assert hasattr(found, name.name), f"PyQt6.{module} has no {name.name}"
            classes[name.asname or name.name] = getattr(found, name.name)
    notes = {id(n) for node in ast.walk(tree) for n in _annotations(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and id(node) not in notes:
            words = []
            inner = node
            while isinstance(inner, ast.Attribute):
                words.append(inner.attr)
                inner = inner.value
            if isinstance(inner, ast.Name) and inner.id in classes and words[-1][:1].isupper():
                found = classes[inner.id]
                for word in reversed(words):
                    assert hasattr(found, word), f"{inner.id}.{'.'.join(reversed(words))} is not in PyQt6"
                    found = getattr(found, word)
