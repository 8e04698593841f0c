"""Words in the user's language: ``tr`` for strings, and the translator that QGIS gets for them."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsSettings
from qgis.PyQt.QtCore import QCoreApplication, QLocale, QTranslator

CONTEXT = "photomap"
FOLDER = Path(__file__).parent / "i18n"


def tr(text: str) -> str:
    """Return a string in the user's language; its source text where there is no translation."""
    return QCoreApplication.translate(CONTEXT, text)


def language() -> str:
    """Return the two letters of the language that QGIS shows, ``en`` where unknown."""
    settings = QgsSettings()
    own = settings.value("locale/overrideFlag", False, type=bool)
    name = settings.value("locale/userLocale", "") if own else QLocale.system().name()
    return (str(name) or "en")[:2]


def install_translator() -> QTranslator | None:
    """Install the compiled translation of the user's language and return it; ``None`` where there is none.

    ``.qm`` files are made by ``make plugin`` where Qt's lrelease is installed; without them the plugin speaks English.
    """
    file = FOLDER / f"photomap_{language()}.qm"
    translator = QTranslator()
    if not file.is_file() or not translator.load(str(file)):
        return None
    QCoreApplication.installTranslator(translator)
    return translator
