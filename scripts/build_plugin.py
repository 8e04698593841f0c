"""``make plugin``: the QGIS plugin as ``dist/photomap-qgis-VERSION.zip``; the same sources give the same bytes.

Only the standard library is needed. Translations are compiled where Qt's lrelease is installed, else left out.

    python3 scripts/build_plugin.py [-o FOLDER]
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLUGIN = ROOT / "qgis_plugin"
NAME = "photomap"
"""The plugin's folder in the zip, and its name in QGIS."""
SUFFIXES = frozenset({".py", ".txt", ".svg", ".qml", ".md", ".png", ".qm"})
BARE = frozenset({"LICENSE"})
DATE = (1980, 1, 1, 0, 0, 0)
LRELEASE = ("lrelease", "lrelease-qt5", "lrelease6", "lrelease-qt6")


def main(arguments: list[str] | None = None) -> int:
    """Build the zip and print where it is."""
    parser = argparse.ArgumentParser(description="Build the QGIS plugin's zip.")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", help="folder of the zip; default: dist")
    folder = parser.parse_args(arguments).output
    with tempfile.TemporaryDirectory() as scratch:
        compiled = compile_translations(Path(scratch))
        if not compiled:
            print("no lrelease: the plugin will speak English only", file=sys.stderr)
        print(build(folder, compiled))
    return 0


def version() -> str:
    """Return the version of the plugin, as its metadata say it."""
    found = re.search(r"^version=(\S+)$", (PLUGIN / "metadata.txt").read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise SystemExit("qgis_plugin/metadata.txt says no version")
    return found[1]


def members(compiled: dict[str, Path]) -> dict[str, Path]:
    """Return what goes into the zip: names inside of the plugin's folder, and the files that they come from."""
    found = {
        path.relative_to(PLUGIN).as_posix(): path
        for path in PLUGIN.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and (path.suffix in SUFFIXES or path.name in BARE)
    }
    page = ROOT / "docs" / "qgis.md"
    found["help/qgis.md"] = page
    for picture in re.findall(r"\]\((images/[\w.-]+\.png)\)", page.read_text(encoding="utf-8")):
        found[f"help/{picture}"] = page.parent / picture
    return {name: path for name, path in found.items() if not name.endswith(".qm")} | compiled


def build(folder: Path, compiled: dict[str, Path]) -> Path:
    """Write the zip into a folder and return it; it appears whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{NAME}-qgis-{version()}.zip"
    scratch = target.with_suffix(".part")
    try:
        with zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
            for name, path in sorted(members(compiled).items()):
                entry = zipfile.ZipInfo(f"{NAME}/{name}", DATE)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                entry.create_system = 3
                archive.writestr(entry, path.read_bytes())
        scratch.replace(target)
    finally:
        scratch.unlink(missing_ok=True)
    return target


def compile_translations(scratch: Path) -> dict[str, Path]:
    """Return the compiled translations by their names in the plugin; none where there is no lrelease."""
    tool = next((found for name in LRELEASE if (found := shutil.which(name))), None)
    if tool is None:
        return {}
    compiled = {}
    for source in sorted((PLUGIN / "i18n").glob("*.ts")):
        target = scratch / f"{source.stem}.qm"
        ran = subprocess.run([tool, "-silent", str(source), "-qm", str(target)], capture_output=True, check=False)
        if ran.returncode != 0 or not target.is_file():
            continue  # qtchooser's wrapper without a Qt behind it
        compiled[f"i18n/{target.name}"] = target
    return compiled


if __name__ == "__main__":
    sys.exit(main())
