"""Every algorithm through the real provider: its result is there, loads, and its errors say what to do."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsGeometry,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingModelAlgorithm,
    QgsProcessingModelChildAlgorithm,
    QgsProcessingModelChildParameterSource,
    QgsProcessingModelOutput,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)

from qgis_plugin.processing.provider import PhotomapProvider
from qgis_plugin.settings import Settings, save_settings

ROOT = Path(__file__).resolve().parents[3]
EVERY = {"map", "export", "plan", "upload", "simulate", "compare", "package", "info"}


@pytest.fixture(scope="module")
def provider(qgis_app, program):
    from processing.core.Processing import Processing

    Processing.initialize()
    save_settings(Settings(engine_path=program))
    provider = PhotomapProvider()
    assert QgsApplication.processingRegistry().addProvider(provider)
    yield provider
    QgsApplication.processingRegistry().removeProvider("photomap")


class Words(QgsProcessingFeedback):
    """Feedback that keeps what it was told, and cancels when a stage begins if it is told to."""

    def __init__(self, cancel_at: str = "") -> None:
        super().__init__(False)
        self.said, self.warned, self.stages, self.shares = [], [], [], []
        self._cancel_at = cancel_at

    def pushInfo(self, info):
        self.said.append(info)

    def pushWarning(self, warning):
        self.warned.append(warning)

    def setProgressText(self, text):
        self.stages.append(text)
        if text == self._cancel_at:
            self.cancel()


def run(name: str, feedback=None, **values):
    import processing

    feedback = feedback or Words()
    feedback.progressChanged.connect(lambda share: feedback.shares.append(share))
    return processing.run(f"photomap:{name}", values, feedback=feedback)


def field_in(
    layer_crs: str, wkt_degrees: str = "POLYGON((8.0 47.0, 8.001 47.0, 8.001 47.0008, 8.0 47.0008, 8.0 47.0))"
):
    """A polygon layer in any CRS over a place that is known in degrees."""
    layer = QgsVectorLayer(f"Polygon?crs={layer_crs}", "field", "memory")
    geometry = QgsGeometry.fromWkt(wkt_degrees)
    change = QgsCoordinateTransform(
        QgsCoordinateReferenceSystem("EPSG:4326"), QgsCoordinateReferenceSystem(layer_crs), QgsProject.instance()
    )
    geometry.transform(change)
    feature = QgsFeature()
    feature.setGeometry(geometry)
    layer.dataProvider().addFeature(feature)
    layer.updateExtents()
    return layer


def test_every_algorithm_is_offered_with_help_and_a_sound_dialog(provider):
    assert {a.name() for a in provider.algorithms()} == EVERY
    for algorithm in provider.algorithms():
        assert algorithm.displayName() and algorithm.shortDescription() and algorithm.shortHelpString()
        assert algorithm.create().id() == algorithm.id()
        names = [p.name() for p in algorithm.parameterDefinitions()]
        assert len(set(names)) == len(names)
        assert all(p.description() for p in algorithm.parameterDefinitions())
        assert "OPTIONS" in names


def test_every_argument_is_one_of_the_engine_s(provider, program):
    from qgis_plugin.process import EngineProcess

    with EngineProcess([program]) as client:
        known = {c["kind"]: {p["name"]: p for p in c["parameters"]} for c in client.commands()}
    for algorithm in provider.algorithms():
        parameters = known[algorithm.kind]
        fields = [f for f in algorithm.create().fields() if f.argument]
        assert {f.argument for f in fields} <= set(parameters)
        for field in fields:
            made, theirs = field.parameter(), parameters[field.argument]
            if made.type() == "enum":
                assert made.options() == [c for c in theirs["choices"] if c in made.options()]
                assert set(made.options()) == set(theirs["choices"])
            if made.type() == "number" and made.defaultValue() is not None:
                assert float(made.defaultValue()) == pytest.approx(theirs["default"])


def test_photos_become_a_map(provider, flight, tmp_path):
    feedback = Words()
    found = run(
        "map", feedback, FOLDER=str(flight / "photos"), OUTPUT=str(tmp_path / "m"), LAYERS=True, CRS="EPSG:25832"
    )
    layer = QgsRasterLayer(found["MAP"], "map", "gdal")
    assert layer.isValid()
    assert layer.crs().authid() == "EPSG:25832"
    assert layer.rasterUnitsPerPixelX() == pytest.approx(found["GSD_M"], rel=0.05)
    assert found["REGISTERED"] == 6
    assert found["CE90_M"] > 0
    assert {"read", "render"} <= set(feedback.stages)
    assert max(feedback.shares) == pytest.approx(100.0)
    assert (tmp_path / "m" / "layers").is_dir()


def test_a_map_is_loaded_into_the_project_where_there_is_one(provider, mission, tmp_path, qgis_new_project):
    import processing

    shutil.copytree(mission, tmp_path / "m")
    context = QgsProcessingContext()
    context.setProject(QgsProject.instance())
    values = {"MISSION": str(tmp_path / "m"), "FORMAT": "geotiff", "OUTPUT": str(tmp_path / "out.tif"), "LOAD": True}
    processing.run("photomap:export", values, context=context, feedback=Words())
    assert list(context.layersToLoadOnCompletion()) == [str(tmp_path / "out.tif")]
    flown = QgsProcessingContext()
    flown.setProject(QgsProject.instance())
    plan = {"AREA": field_in("EPSG:4326"), "HEIGHT": 60, "OUTPUT": str(tmp_path / "f.plan")}
    processing.run("photomap:plan", plan, context=flown, feedback=Words())
    drawn = [QgsVectorLayer(uri, "drawn", "ogr") for uri in flown.layersToLoadOnCompletion()]
    assert [layer.isValid() and layer.featureCount() > 0 for layer in drawn] == [True, True, True]
    again = QgsProcessingContext()
    again.setProject(QgsProject.instance())
    processing.run("photomap:export", {**values, "LOAD": False}, context=again, feedback=Words())
    assert not again.layersToLoadOnCompletion()


def test_the_endings_are_those_of_the_engine(provider, program):
    """Both tables say the same: what one has and the other has not would be refused."""
    from qgis_plugin.formats import formats
    from qgis_plugin.processing.export_names import ENDINGS, named_for

    assert set(ENDINGS) == {f.flag for f in formats()}
    assert named_for("kml", "/a/b.file") == "/a/b.kmz"
    assert named_for("kml", "/a/b.KML") == "/a/b.KML"
    assert named_for("kml", "/a/b.tif") == "/a/b.tif.kmz"
    assert named_for("tiles", "/a/b.file") == "/a/b"
    assert named_for("tiles", "/a/b.c") == "/a/b.c"


def test_every_format_is_exported_and_what_is_a_layer_loads(provider, mission, tmp_path):
    from qgis_plugin.formats import formats

    for format in formats():
        found = run("export", MISSION=str(mission), FORMAT=format.flag, OUTPUT=str(tmp_path / f"{format.flag}.file"))
        assert Path(found["OUTPUT"]).exists(), format.flag
        assert Path(found["OUTPUT"]).stem == format.flag
        if "RASTER" in found:
            assert QgsRasterLayer(found["RASTER"], "raster", "gdal").isValid(), format.flag
        if "VECTOR" in found:
            assert QgsVectorLayer(found["VECTOR"], "vector", "ogr").isValid()


def test_only_inside_a_polygon_of_another_crs(provider, mission, tmp_path):
    whole = QgsRasterLayer(str(mission / "map.tif"), "map", "gdal")
    box = whole.extent()
    box.setXMaximum(box.center().x())
    layer = QgsVectorLayer(f"Polygon?crs={whole.crs().authid()}", "half", "memory")
    feature = QgsFeature()
    feature.setGeometry(QgsGeometry.fromRect(box))
    layer.dataProvider().addFeature(feature)
    layer.updateExtents()
    found = run("export", MISSION=str(mission), FORMAT="geotiff", CUTLINE=layer, OUTPUT=str(tmp_path / "half.tif"))
    half = QgsRasterLayer(found["RASTER"], "half", "gdal")
    assert half.extent().width() == pytest.approx(whole.extent().width() / 2, rel=0.03)


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:3857"])
def test_an_area_of_any_crs_is_planned(provider, crs, tmp_path):
    found = run("plan", AREA=field_in(crs), GSD=0.03, CAMERA="FC6310", OUTPUT=str(tmp_path / "field.plan"))
    assert found["COVERED_SHARE"] > 0.999
    assert found["SORTIES"] == 1
    plan = json.loads((tmp_path / "field.plan").read_text())
    home = plan["mission"]["plannedHomePosition"]
    assert (home[0], home[1]) == (pytest.approx(47.0, abs=0.003), pytest.approx(8.0, abs=0.003))
    drawn = QgsVectorLayer(found["DRAWING"], "drawing", "ogr")
    assert drawn.isValid()


def test_a_place_of_take_off_an_area_to_avoid_and_further_options(provider, tmp_path):
    feedback = Words()
    avoid = field_in(
        "EPSG:3857", "POLYGON((8.0004 47.0003, 8.0006 47.0003, 8.0006 47.0005, 8.0004 47.0005, 8.0004 47.0003))"
    )
    home = "890555.9,5942074.0 [EPSG:3857]"
    found = run("plan", feedback, AREA=field_in("EPSG:25832"), AVOID=avoid, HOME=home, HEIGHT=60,
                OPTIONS='{"rally": ["47.0,8.0,30"], "fence-margin": 80}', OUTPUT=str(tmp_path / "f.plan"))  # fmt: skip
    plan = json.loads((tmp_path / "f.plan").read_text())
    assert plan["rallyPoints"]["points"] == [[47.0, 8.0, 30.0]]
    assert plan["mission"]["plannedHomePosition"][:2] == [pytest.approx(47.0, abs=1e-3), pytest.approx(8.0, abs=1e-3)]
    assert any("camera" in w for w in feedback.warned)  # what was assumed is said
    assert 0 < found["COVERED_SHARE"] <= 1


def test_a_flight_is_simulated_over_a_layer(provider, mission, tmp_path):
    ground = QgsRasterLayer(str(mission / "map.tif"), "map", "gdal")
    found = run("simulate", GROUND=ground, FRAMES=4, ALTITUDE=40, WIDTH=320, HEIGHT=240, OUTPUT=str(tmp_path / "s"))
    assert len(list(Path(found["SOURCE"]).glob("*.JPG"))) == 4
    assert found["GSD_M"] > 0


def test_what_has_changed_is_a_raster_and_areas(provider, mission, tmp_path):
    old = QgsRasterLayer(str(mission / "map.tif"), "old", "gdal")
    out = {"OUTPUT": str(tmp_path / "change.tif"), "POLYGONS": str(tmp_path / "change.gpkg")}
    found = run("compare", OLD=old, NEW=old, **out)
    assert QgsRasterLayer(found["OUTPUT"], "change", "gdal").isValid()
    areas = QgsVectorLayer(found["POLYGONS"], "areas", "ogr")
    assert areas.isValid()
    assert areas.featureCount() == found["AREAS"] == 0  # nothing has changed against itself
    assert found["CHANGED_M2"] == 0


def test_a_mission_is_packed_and_told(provider, mission, flight, tmp_path):
    found = run("package", MISSION=str(mission), OUTPUT=str(tmp_path / "handover.zip"), MAX_SIZE="2MB")
    assert found["BYTES"] == (tmp_path / "handover.zip").stat().st_size <= 2_000_000
    found = run("info", FOLDER=str(flight / "photos"), OUTPUT=str(tmp_path / "info.json"))
    assert json.loads(found["REPORT"]) == json.loads((tmp_path / "info.json").read_text())
    told = json.loads(run("info", FOLDER=str(mission))["REPORT"])
    assert told["crs"] == "EPSG:32632"


@pytest.fixture
def vehicle():
    """A simulated autopilot in a process of its own."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "QT", "QGIS"))}
    process = subprocess.Popen(
        [os.environ["PHOTOMAP_TEST_PYTHON"], "-m", "photomap_gis.simulate.vehicle", "--link", "tcp", "--port", "0",
         "--home", "47.0", "8.0", "400.0"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=clean,
    )  # fmt: skip
    yield json.loads(process.stdout.readline())["port"]
    process.stdin.close()
    process.wait(20)
    process.stdout.close()


def test_a_plan_is_uploaded_and_verified(provider, vehicle, tmp_path):
    plan = str(tmp_path / "field.plan")
    run("plan", AREA=field_in("EPSG:4326"), GSD=0.03, OUTPUT=plan)
    feedback = Words()
    found = run("upload", feedback, PLAN=plan, CONNECT=f"tcp:127.0.0.1:{vehicle}", SYSTEM=1)
    assert found["OUTCOME"] == "verified"
    assert found["ITEMS"] > 4
    assert Path(found["SAVED"]).is_file()
    with pytest.raises(QgsProcessingException, match=r"height|higher|above"):
        run("upload", PLAN=plan, CONNECT=f"tcp:127.0.0.1:{vehicle}", SYSTEM=1, MAX_HEIGHT=5)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("map", {}, "Choose a folder of photos"),
        ("map", {"FOLDER": "EMPTY"}, "photo|no "),
        ("info", {"FILES": ["/nowhere.mp4"]}, "check the name"),
        ("export", {"MISSION": "EMPTY", "FORMAT": "kml"}, "no mission folder"),
        ("package", {"MISSION": "EMPTY"}, "no mission folder"),
        ("info", {"FOLDER": "EMPTY", "OPTIONS": "{"}, "JSON object"),
        ("info", {"FOLDER": "EMPTY", "OPTIONS": '{"colour": 1}'}, "no argument 'colour'"),
        ("upload", {"PLAN": "PLAN", "CONNECT": "tcp:127.0.0.1:9", "TIMEOUT": 1}, "."),
    ],
)  # fmt: skip
def test_errors_say_what_to_do(provider, tmp_path, name, values, words):
    (tmp_path / "empty").mkdir()
    (tmp_path / "x.plan").write_text("{}")
    given = {"EMPTY": str(tmp_path / "empty"), "PLAN": str(tmp_path / "x.plan")}
    values = {k: given.get(v, v) if isinstance(v, str) else v for k, v in values.items()}
    if name in ("map", "export", "package"):
        values["OUTPUT"] = str(tmp_path / "out.zip")
    with pytest.raises(QgsProcessingException, match=words):
        run(name, **values)


def test_a_layer_that_is_no_file_is_told(provider, mission, tmp_path):
    tiles = QgsRasterLayer("type=xyz&url=file:///nowhere/%7Bz%7D/%7Bx%7D/%7By%7D.png", "tiles", "wms")
    old = QgsRasterLayer(str(mission / "map.tif"), "old", "gdal")
    QgsProject.instance().addMapLayer(tiles)
    try:
        with pytest.raises(QgsProcessingException, match="is no file"):
            run("compare", OLD=tiles, NEW=old, OUTPUT=str(tmp_path / "c.tif"), POLYGONS=str(tmp_path / "c.gpkg"))
    finally:
        QgsProject.instance().removeMapLayer(tiles.id())


def test_what_the_provider_started_ends_with_it(provider, program, flight, wait_until):
    from qgis_plugin.processing.held_engine import engine_for, release

    client = engine_for([program])
    pid = client.about()["pid"]
    assert engine_for([program]) is client  # one for many algorithms
    os.kill(pid, 9)
    again = engine_for([program])
    assert again.about()["pid"] != pid
    release()
    wait_until(lambda: gone(again), "the end of the engine")


def gone(client) -> bool:
    from qgis_plugin.client import EngineGone

    try:
        client.about()
    except EngineGone:
        return True
    return False


def test_without_an_engine_the_message_tells_how_to_get_one(provider, program, tmp_path):
    save_settings(Settings(engine_path=str(tmp_path / "none")))
    try:
        with pytest.raises(QgsProcessingException, match="pip install photomap-gis"):
            run("info", FOLDER=str(tmp_path))
    finally:
        save_settings(Settings(engine_path=program))


def test_cancel_stops_the_job_and_the_same_call_goes_on(provider, flight, tmp_path):
    feedback = Words(cancel_at="read")
    found = run("map", feedback, FOLDER=str(flight / "photos"), OUTPUT=str(tmp_path / "m"))
    assert "MAP" not in found
    assert not (tmp_path / "m" / "map.tif").exists()
    assert any("stopped" in line for line in feedback.said)
    assert Path(run("map", FOLDER=str(flight / "photos"), OUTPUT=str(tmp_path / "m"))["MAP"]).is_file()


def test_a_model_chains_them(provider, tmp_path):
    model = QgsProcessingModelAlgorithm("chain", "tests")
    simulate = QgsProcessingModelChildAlgorithm("photomap:simulate")
    simulate.setChildId("simulate")
    static = QgsProcessingModelChildParameterSource.fromStaticValue
    for key, value in {"FRAMES": 6, "ALTITUDE": 80, "WIDTH": 480, "HEIGHT": 360, "OUTPUT": str(tmp_path / "s")}.items():
        simulate.addParameterSources(key, [static(value)])
    model.addChildAlgorithm(simulate)
    told = QgsProcessingModelChildAlgorithm("photomap:info")
    told.setChildId("info")
    told.addParameterSources("FOLDER", [QgsProcessingModelChildParameterSource.fromChildOutput("simulate", "SOURCE")])
    out = QgsProcessingModelOutput("report", "report")
    out.setChildOutputName("OUTPUT")
    out.setChildId("info")
    told.setModelOutputs({"report": out})
    model.addChildAlgorithm(told)
    model.initAlgorithm()
    _, sound = model.run({"info:report": str(tmp_path / "info.json")}, QgsProcessingContext(), Words())
    assert sound
    assert json.loads((tmp_path / "info.json").read_text())["frames"] == 6


def test_qgis_process_runs_them_without_a_window(program, tmp_path):
    tool = shutil.which("qgis_process.bin") or shutil.which("qgis_process")
    if tool is None:
        pytest.skip("qgis_process is not installed")
    profile = tmp_path / "profile"
    plugins = profile / "profiles" / "default" / "python" / "plugins"
    plugins.mkdir(parents=True)
    shutil.copytree(ROOT / "qgis_plugin", plugins / "photomap", ignore=shutil.ignore_patterns("__pycache__"))
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "QGIS"))}
    path = os.pathsep.join([str(Path(program).parent), clean["PATH"]])
    env = {**clean, "QGIS_CUSTOM_CONFIG_PATH": str(profile), "PATH": path}

    def call(*words):
        return subprocess.run([tool, *words], env=env, capture_output=True, text=True, timeout=300, check=False)

    enabled = call("plugins", "enable", "photomap")
    assert enabled.returncode == 0, enabled.stderr + enabled.stdout
    listed = call("list")
    assert "photomap:map" in listed.stdout, listed.stderr
    ran = call("run", "photomap:simulate", "--", "FRAMES=3", "ALTITUDE=80", "WIDTH=320", "HEIGHT=240",
               f"OUTPUT={tmp_path / 's'}")  # fmt: skip
    assert ran.returncode == 0, ran.stderr + ran.stdout
    assert "SOURCE" in ran.stdout
    assert len(list((tmp_path / "s" / "photos").glob("*.JPG"))) == 3
    assert sys.executable not in ran.stdout
