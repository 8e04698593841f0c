"""The plugin's words in other languages: what the script finds, and that no translation breaks what it stands for."""

import re
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import build_plugin  # noqa: E402
import update_translations  # noqa: E402

FILES = sorted((ROOT / "qgis_plugin" / "i18n").glob("*.ts"))


def pieces(text: str) -> list[str]:
    """What a program fills in or a key presses: these must be the same in every language."""
    return sorted(re.findall(r"\{\w*\}", text))


@pytest.mark.parametrize("file", FILES, ids=lambda p: p.stem)
def test_translations_keep_what_is_filled_in_and_pressed(file):
    for source, text in update_translations.read(file).items():
        if text:
            assert pieces(text) == pieces(source), source
            assert text.count("&") == source.count("&"), f"a shortcut came or went: {source}"
            assert text.endswith("…") == source.endswith("…"), source


@pytest.mark.parametrize("file", FILES, ids=lambda p: p.stem)
def test_most_of_the_plugin_is_translated(file):
    known, wanted = update_translations.read(file), update_translations.strings()
    assert sum(bool(known.get(text)) for text in wanted) > 0.9 * len(wanted)


def test_the_script_keeps_what_is_known_and_marks_what_is_new(tmp_path, monkeypatch, capsys):
    plugin = tmp_path / "plugin"
    (plugin / "i18n").mkdir(parents=True)
    (plugin / "a.py").write_text('x = tr("kept & <b>")\ny = tr("new {}").format(1)\nz = tr(name)\n')
    update_translations.write(plugin / "i18n" / "photomap_de.ts", {"kept & <b>": "behalten & <b>", "gone": "weg"})
    monkeypatch.setattr(update_translations, "PLUGIN", plugin)
    assert update_translations.main(["--check"]) == 1
    assert "new {}" in capsys.readouterr().out
    assert update_translations.main([]) == 0
    assert update_translations.read(plugin / "i18n" / "photomap_de.ts") == {
        "kept & <b>": "behalten & <b>",
        "new {}": "",
    }
    text = (plugin / "i18n" / "photomap_de.ts").read_text()
    assert update_translations.main([]) == 0
    assert (plugin / "i18n" / "photomap_de.ts").read_text() == text


def test_they_are_compiled_into_the_zip_where_qt_is(tmp_path):
    if not any(shutil.which(tool) for tool in build_plugin.LRELEASE):
        pytest.skip("no lrelease (apt install qttools5-dev-tools)")
    compiled = build_plugin.compile_translations(tmp_path)
    assert set(compiled) == {f"i18n/{f.stem}.qm" for f in FILES}
    assert all(path.read_bytes().startswith(b"\x3c\xb8\x64\x18") for path in compiled.values()), "Qt's mark"
