"""The environment variables of the engine: those of the user, without what QGIS sets for its own Python and libraries.

QGIS's start scripts point PYTHONHOME at QGIS's Python, GDAL_DATA and PROJ_LIB at its libraries' data, and put its
folders on PATH. In another Python these break imports or, worse, silently give wrong projections.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

_PREFIXES = ("PYTHON", "QGIS", "QT_", "QML", "GDAL_", "PROJ_", "OSGEO", "OGR_", "O4W", "GRASS", "GISBASE", "SAGA")
_NAMES = frozenset(
    {
        "VIRTUAL_ENV",
        "CONDA_PREFIX",
        "CONDA_DEFAULT_ENV",
        "CPL_ZIP_ENCODING",
        "GEOTIFF_CSV",
        "PDAL_DRIVER_PATH",
        "VSI_CACHE",
        "VSI_CACHE_SIZE",
        "SSL_CERT_FILE",
        "SSL_CERT_DIR",
        "OPENSSL_ENGINES",
        "__PYVENV_LAUNCHER__",
        "PHOTOMAP_PROGRESS",
        "PHOTOMAP_LIFELINE",
    }
)
_LIBRARY_PATHS = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "DYLD_FALLBACK_LIBRARY_PATH", "DYLD_FRAMEWORK_PATH")
_SHARED_PREFIXES = frozenset({"", "/", "/usr", "/usr/local", "/opt", "/opt/homebrew"})
"""Where QGIS shares its folder with everything else: what lies there is not QGIS's own."""


def clean_environment(environ: Mapping[str, str], roots: Sequence[str] = ()) -> dict[str, str]:
    """Return the variables for the engine. ``roots`` are QGIS's own folders (``qgis_roots``), taken off all paths."""
    clean = {}
    for name, value in environ.items():
        upper = name.upper()
        if upper in _NAMES or upper.startswith(_PREFIXES):
            continue
        if upper == "PATH" or upper in _LIBRARY_PATHS:
            kept = [part for part in value.split(os.pathsep) if part and not is_in(part, roots)]
            if not kept and upper != "PATH":
                continue
            value = os.pathsep.join(kept)
        clean[name] = value
    return clean


def qgis_roots(
    environ: Mapping[str, str] | None = None,
    prefix: str | None = None,
) -> list[str]:
    """Return the folders that belong to QGIS alone: OSGeo4W's, its installer's, its application bundle's.

    On Linux QGIS lives in ``/usr`` with everything else: there are none.
    """
    environ = os.environ if environ is None else environ
    prefix = sys.prefix if prefix is None else prefix
    found = [environ.get("OSGEO4W_ROOT", ""), environ.get("QGIS_PREFIX_PATH", "")]
    at = _normal(prefix)
    if ".app/" in at + "/":  # macOS: .../QGIS.app/Contents/...
        found.append((at + "/")[: (at + "/").index(".app/") + len(".app")])
    elif os.name == "nt":  # C:\\Program Files\\QGIS 3.34\\apps\\Python39
        apps = Path(prefix).parent
        found.append(str(apps.parent) if apps.name.lower() == "apps" else prefix)
    return [root for root in map(_normal, found) if root not in _SHARED_PREFIXES]


def is_in(path: str, roots: Sequence[str]) -> bool:
    """Whether a path lies in one of the folders, or is one."""
    at = _normal(path)
    return any(at == _normal(root) or at.startswith(_normal(root) + "/") for root in roots)


def _normal(path: str) -> str:
    return os.path.normcase(os.path.normpath(path)).replace("\\", "/").rstrip("/") if path else ""
