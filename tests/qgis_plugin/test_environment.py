"""QGIS's variables never reach the engine, the user's do."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qgis_plugin.environment import clean_environment, is_in, qgis_roots

QGIS_SAYS = {
    "PYTHONHOME": "/qgis/python",
    "PYTHONPATH": "/qgis/python/plugins",
    "PYTHONEXECUTABLE": "/qgis/bin/python3",
    "PYTHONSTARTUP": "/qgis/start.py",
    "__PYVENV_LAUNCHER__": "/qgis/bin/python3",
    "GDAL_DATA": "/qgis/gdal",
    "GDAL_DRIVER_PATH": "/qgis/gdalplugins",
    "PROJ_LIB": "/qgis/proj",
    "PROJ_DATA": "/qgis/proj",
    "QT_PLUGIN_PATH": "/qgis/qt",
    "QGIS_PREFIX_PATH": "/qgis/app",
    "OSGEO4W_ROOT": "/qgis",
    "O4W_QT_PREFIX": "/qgis/qt",
    "SSL_CERT_FILE": "/qgis/certs.pem",
    "gdal_data": "/qgis/gdal",
}
USER_SAYS = {"HOME": "/home/me", "LANG": "de_DE.UTF-8", "TMPDIR": "/tmp", "PHOTOMAP_DEBUG": "1", "OMP_NUM_THREADS": "2"}


def test_what_qgis_sets_is_gone_and_what_the_user_sets_stays():
    assert clean_environment({**QGIS_SAYS, **USER_SAYS}) == USER_SAYS


def test_qgis_s_folders_are_taken_off_the_paths():
    path = os.pathsep.join(["/qgis/bin", "/usr/bin", "/qgis", "/qgistools/bin", ""])
    clean = clean_environment({"PATH": path, "LD_LIBRARY_PATH": "/qgis/lib"}, ["/qgis"])
    assert clean == {"PATH": os.pathsep.join(["/usr/bin", "/qgistools/bin"])}


@pytest.mark.parametrize("prefix", ["/usr", "/usr/local", "/"])
def test_on_a_linux_that_qgis_shares_nothing_is_qgis_s_alone(prefix):
    assert qgis_roots({}, prefix) == []
    assert qgis_roots({"QGIS_PREFIX_PATH": "/usr"}, prefix) == []


def test_bundles_and_osgeo4w_are_qgis_s():
    assert qgis_roots({"OSGEO4W_ROOT": "/qgis"}, "/usr") == ["/qgis"]
    bundle = "/Applications/QGIS-LTR.app"
    assert qgis_roots({}, f"{bundle}/Contents/MacOS") == [bundle]
    assert is_in(f"{bundle}/Contents/MacOS/bin/python3", qgis_roots({}, f"{bundle}/Contents/MacOS"))


@given(st.dictionaries(st.text(min_size=1, max_size=12), st.text(max_size=12), max_size=6))
def test_cleaning_twice_changes_nothing_more_and_makes_nothing_up(environ):
    clean = clean_environment(environ, ["/qgis"])
    assert clean_environment(clean, ["/qgis"]) == clean
    assert set(clean) <= set(environ)
