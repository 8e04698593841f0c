"""The plugin in QGIS's real window under Xvfb: installed from its zip into a fresh profile, worked with by real clicks.

The pictures of the run lie beside its results (``--basetemp`` says where); the play is ``real_window/play.py``.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import build_plugin

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PROFILE = """
[PythonPlugins]
photomap=true
processing=true

[photomap]
engine_path={program}
folder={folder}

[locale]
overrideFlag=true
userLocale=en_US

[qgis]
checkVersion=false
showTips=false
newsFeed/httpsfeedqgisorg/disabled=true
"""
TIMEOUT_S = 300
BAR_MS = 100.0
"""No slot of the plugin should hold the window up for longer, on a machine that does nothing else."""
MOST_CPU_MS = 2.5 * BAR_MS
"""What a busy machine makes of that, in time of the window's thread: caches and threads are shared."""


def missing() -> str | None:
    """Why there is no window here, ``None`` where there is one."""
    for tool in ("qgis", "xvfb-run"):
        if shutil.which(tool) is None:
            return f"{tool} is not installed (apt install qgis xvfb xauth)"
    return None


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Play it once; what was noted, and the folder of its pictures."""
    if (why := missing()) is not None:
        pytest.skip(why)
    home = tmp_path_factory.mktemp("window")
    out = home / "out"
    out.mkdir()
    photomap = [sys.executable, "-m", "photomap_gis.cli"]
    words = ["--frames", "6", "--width", "480", "--frame-height", "360", "--altitude", "80", "-q"]
    subprocess.run([*photomap, "simulate", "procedural", "-o", str(home / "sim"), *words], cwd=ROOT, check=True)
    stale_from(home / "sim", home / "stale.tif")
    program = home / "bin" / "photomap"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m photomap_gis.cli "$@"\n')
    program.chmod(0o755)
    archive = build_plugin.build(home / "dist", {})
    profile = home / "profiles" / "profiles" / "default"
    with zipfile.ZipFile(archive) as plugin:
        plugin.extractall(profile / "python" / "plugins")
    (profile / "QGIS").mkdir()
    (profile / "QGIS" / "QGIS3.ini").write_text(PROFILE.format(program=program, folder=home / "missions"))
    clean = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "GDAL", "PROJ", "VIRTUAL", "QGIS", "QT"))
    }
    environment = {
        **clean, "HOME": str(home), "PATH": "/usr/bin:/bin",  # QGIS's Python must not find ours
         "XDG_RUNTIME_DIR": str(home), "LIBGL_ALWAYS_SOFTWARE": "1",
        "PHOTOMAP_PLAY": str(HERE / "real_window"), "PHOTOMAP_PLAY_OUT": str(out),
        "PHOTOMAP_PLAY_FLIGHT": str(home / "sim"), "PHOTOMAP_PLAY_STALE": str(home / "stale.tif"),
        "PHOTOMAP_PLAY_PYTHON": sys.executable, "PHOTOMAP_PLAY_ROOT": str(ROOT),
    }  # fmt: skip
    command = [
        "xvfb-run", "-a", "-s", "-screen 0 1280x860x24", "qgis", "--nologo", "--noversioncheck",
        "--profiles-path", str(home / "profiles"), "--code", str(HERE / "real_window" / "play.py"),
    ]  # fmt: skip
    with vehicle() as url, (home / "qgis.log").open("wb") as log:
        environment["PHOTOMAP_PLAY_VEHICLE"] = url
        code = run_whole(command, env=environment, cwd=home, stdout=log, stderr=log)
    said = (home / "qgis.log").read_text(errors="replace")[-4000:]
    assert (out / "result.json").is_file(), f"QGIS ended ({code}) before the play did\n{said}"
    result = json.loads((out / "result.json").read_text())
    assert "fault" not in result, f"{result['fault']}\n{result['steps'][-3:]}\npictures: {out}"
    return result, out


@contextmanager
def vehicle():
    """A simulated vehicle above the flight's ground; yields where it is to be reached."""
    command = [
        sys.executable,
        "-m",
        "photomap_gis.simulate.vehicle",
        "--port",
        "0",
        "--home",
        "53.1676",
        "8.6487",
        "20",
    ]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield f"tcp:127.0.0.1:{json.loads(process.stdout.readline())['port']}"
    finally:
        process.stdin.close()
        process.wait(10)
        process.stdout.close()


def run_whole(command, **options) -> int:
    """Run a command; when its time is over, end all that it started."""
    process = subprocess.Popen(command, start_new_session=True, **options)
    try:
        return process.wait(TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.wait()


def stale_from(simulation: Path, target: Path) -> None:
    """Old imagery of the flight's ground: coarse, grey, in another CRS."""
    import rasterio
    from rasterio.enums import Resampling
    from rasterio.vrt import WarpedVRT

    truth = next(p for p in sorted((simulation / "truth").rglob("*.tif")) if "ground" in p.name)
    with rasterio.open(truth) as ground, WarpedVRT(ground, crs="EPSG:3857", resampling=Resampling.average) as warped:
        side = 300
        grey = warped.read(1, out_shape=(side, side), resampling=Resampling.average)
        transform = warped.transform * warped.transform.scale(warped.width / side, warped.height / side)
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "uint8", "crs": "EPSG:3857"}
    with rasterio.open(target, "w", **profile, transform=transform) as out:
        out.write(grey, 1)


def names(tree):
    return [name.split(":")[0] for name, _, _ in tree]


def test_it_is_loaded_from_the_zip_and_complete(run):
    result, _ = run
    assert "/profiles/default/python/plugins/photomap/" in result["plugin_file"]
    assert result["loaded"]["bars"] == ["photomapToolBar"]
    assert result["loaded"]["menu"] == ["photomap"]
    assert result["loaded"]["docks"] == []


def test_the_map_is_a_group_in_its_order_and_the_canvas_shows_it(run):
    result, _ = run
    layers = result["mapped"]
    assert names(layers) == ["Track", "Cameras", "Footprints of the frames", "What is known of each pixel", "Map"]
    assert [ticked for _, ticked, _ in layers] == [True, False, False, True, True]
    assert [ticked for _, ticked, _ in layers[3][2]] == [False] * 4
    assert "2026-06-15" in layers[-1][0] and "CE90" in layers[-1][0]


def test_imagery_is_replaced_in_place_and_put_back(run):
    result, _ = run
    assert result["offered"][0] == "orthophoto 2019"
    new, *_ = [entry for entry in result["replaced"] if "CE90" in entry[0]]
    assert new[0].startswith("flight-1: 2026-06-15")
    at = result["replaced"].index(new)
    assert result["replaced"][at + 1][:2] == ["orthophoto 2019", False]
    assert new[1] is True
    assert [e[:2] for e in result["undone"]] == [["roads 2024", False], ["orthophoto 2019", True], ["hills", False]]
    assert result["swapped"][0].endswith("/flight-1/map.tif")
    assert "CE90" in result["swapped"][1]
    assert result["swapped_back"][0].endswith("stale.tif")
    assert result["swapped_back"][1] == "orthophoto 2019"


def test_the_map_was_exported(run):
    _, out = run
    assert (out / "flight-1" / "exports" / "map.tif").stat().st_size > 10_000


def test_a_flight_was_planned_over_the_drawn_area_and_is_on_the_vehicle(run):
    result, _ = run
    assert result["drawn"] == 4
    assert result["covered"] == pytest.approx(1.0, abs=1e-3)
    assert "verified" in result["uploaded"].lower()


def test_unloaded_nothing_is_left_and_loaded_again_all_is_there(run):
    result, _ = run
    for key, left in result["unloaded"].items():
        assert not left or key == "canvas tool", key
    assert result["unloaded"]["canvas tool"] == "qgis._gui"
    assert result["reloaded"] == result["loaded"]


def test_the_engines_ended_with_the_plugin_and_with_qgis(run):
    result, _ = run
    for pid in (result["engine_pid"], result["last_engine_pid"]):
        assert pid > 0
        words = Path(f"/proc/{pid}/cmdline")
        assert not words.exists() or "photomap" not in words.read_text()


def test_no_slot_of_the_plugin_holds_the_window_up(run):
    result, _ = run
    assert result["entries"] > 100, "the stopwatch has seen the plugin at work"
    print("longest stays in the plugin:", result["worst"], "longest gaps between beats (ms):", result["gaps_ms"])
    assert result["worst"][0]["cpu_ms"] <= MOST_CPU_MS, result["worst"]
    assert result["worst"][3]["cpu_ms"] <= BAR_MS, "but for the first time that something is shown, all are well below"


def test_pictures_were_kept(run):
    _, out = run
    assert {p.stem for p in out.glob("*.png")} >= {"1-ready", "3-mapped", "5-replaced", "6-swipe"}
