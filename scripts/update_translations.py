"""Bring the plugin's translations up to date with its sources: ``qgis_plugin/i18n/photomap_LANGUAGE.ts``.

    python3 scripts/update_translations.py            # writes
    python3 scripts/update_translations.py --check    # says what is missing (exit code 1)

Strings are the first arguments of ``tr("...")``, and the titles in the table of docks. What is in a file and no longer
in the sources is dropped; what is new stands there as unfinished, for a person to translate (Qt Linguist reads it).
"""

from __future__ import annotations

import argparse
import ast
import sys
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import escape

PLUGIN = Path(__file__).resolve().parents[1] / "qgis_plugin"
CONTEXT = "photomap"


def main(arguments: list[str] | None = None) -> int:
    """Update or check every language there is."""
    parser = argparse.ArgumentParser(description="Update the plugin's translations.")
    parser.add_argument("--check", action="store_true", help="write nothing; say what is missing or left over")
    check = parser.parse_args(arguments).check
    wanted, faults = strings(), 0
    for file in sorted((PLUGIN / "i18n").glob("*.ts")):
        known = read(file)
        missing = [text for text in wanted if not known.get(text)]
        extra = [text for text in known if text not in wanted]
        print(f"{file.name}: {len(wanted)} strings, {len(missing)} to translate, {len(extra)} no longer there")
        faults += bool(missing or extra)
        if check:
            for text in (*missing, *extra):
                print(f"  {text}")
        else:
            write(file, {text: known.get(text, "") for text in wanted})
    return 1 if check and faults else 0


def strings() -> list[str]:
    """Return every string that the plugin translates, in the order of its files."""
    found: dict[str, None] = {}
    for path in sorted(PLUGIN.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                at = {"tr": 0, "DockEntry": 1}.get(node.func.id)
                if at is not None and len(node.args) > at:
                    argument = node.args[at]
                    if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                        found[argument.value] = None
    return list(found)


def read(file: Path) -> dict[str, str]:
    """Return a language's translations; empty where one is unfinished."""
    known = {}
    for message in ElementTree.parse(file).iter("message"):
        translation = message.find("translation")
        done = translation is not None and translation.get("type") != "unfinished"
        known[message.findtext("source", "")] = (translation.text or "") if done else ""
    return known


def write(file: Path, translations: dict[str, str]) -> None:
    """Write a language's file, as Qt Linguist would."""
    language = file.stem.split("_", 1)[1]
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<!DOCTYPE TS>", f'<TS version="2.1" language="{language}">']
    lines += ["<context>", f"    <name>{CONTEXT}</name>"]
    for source, text in translations.items():
        unfinished = "" if text else ' type="unfinished"'
        lines += ["    <message>", f"        <source>{escape(source)}</source>"]
        lines += [f"        <translation{unfinished}>{escape(text)}</translation>", "    </message>"]
    file.write_text("\n".join([*lines, "</context>", "</TS>", ""]), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
