"""The plugin's table of export formats says what the engine's says."""

from photomap_gis.pipeline.formats import DEFAULT_NAMES, FOLDERS, SUFFIXES, Format
from qgis_plugin.processing.export_names import ENDINGS, RASTERS, VECTORS, named_for


def test_the_plugin_and_the_engine_name_the_same_files():
    assert set(ENDINGS) == {f.value for f in Format}
    for format in Format:
        if format in FOLDERS:
            assert ENDINGS[format.value] == ()
        else:
            assert set(ENDINGS[format.value]) == set(SUFFIXES[format])
            assert DEFAULT_NAMES[format].endswith(ENDINGS[format.value][0])
        assert named_for(format.value, "/out/OUTPUT.file") != "/out/OUTPUT.file"
    assert set(ENDINGS) >= RASTERS | VECTORS
