"""What a disk can do to an output, and what the user is told."""

import errno
import os
import shutil

import pytest

from photomap_gis import publish
from photomap_gis.core.errors import OutputError
from photomap_gis.export import write_geotiff, write_kmz, write_mbtiles, write_poses, write_tiles
from photomap_gis.export.poses import PoseRow
from photomap_gis.export.publish import file_in_place_of, folder_in_place_of

WRITERS = {
    "map.tif": write_geotiff,
    "map.kmz": write_kmz,
    "map.kml": write_kmz,
    "map.mbtiles": write_mbtiles,
    "tiles": write_tiles,
    "poses.csv": lambda _, path: write_poses([PoseRow("a", "a.jpg")], path),
    "poses.geojson": lambda _, path: write_poses([PoseRow("a", "a.jpg")], path),
}


@pytest.fixture(params=WRITERS.items(), ids=WRITERS.keys())
def writer(request):
    return request.param


def raising(code):
    def fail(*_, **__):
        raise OSError(code, os.strerror(code))

    return fail


def left_over(folder):
    return [p.name for p in folder.iterdir() if p.name.startswith(".photomap")]


def test_missing_folder(writer, scene, tmp_path):
    name, write = writer
    with pytest.raises(OutputError, match="does not exist; create it"):
        write(scene.small(), tmp_path / "nowhere" / name)


def test_nothing_is_left_beside_the_output(writer, scene, tmp_path):
    name, write = writer
    write(scene.small(), tmp_path / name)
    assert (tmp_path / name).exists()
    assert left_over(tmp_path) == []


def test_output_can_be_replaced(writer, scene, tmp_path):
    name, write = writer
    write(scene.small(), tmp_path / name)
    write(scene.small(), tmp_path / name)
    assert left_over(tmp_path) == []


@pytest.mark.parametrize(
    ("code", "words"),
    [(errno.ENOSPC, "disk is full"), (errno.EROFS, "read-only"), (errno.EACCES, "read-only"), (errno.EIO, "choose")],
)
def test_failing_disk(writer, scene, tmp_path, monkeypatch, code, words):
    name, write = writer
    if (tmp_path / name).suffix:
        (tmp_path / name).write_bytes(b"old")
    monkeypatch.setattr(publish, "_sync", raising(code))
    monkeypatch.setattr(publish, "_sync_folder", raising(code))
    with pytest.raises(OutputError, match=words) as caught:
        write(scene.small(), tmp_path / name)
    assert "\n" not in str(caught.value)
    assert left_over(tmp_path) == []
    if (tmp_path / name).suffix:
        assert (tmp_path / name).read_bytes() == b"old"


def test_read_only_folder(writer, scene, tmp_path, monkeypatch):
    name, write = writer
    monkeypatch.setattr(publish.tempfile, "mkdtemp", raising(errno.EROFS))
    with pytest.raises(OutputError, match="read-only"):
        write(scene.small(), tmp_path / name)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")  # noqa: PTH110
def test_gdal_on_a_full_disk(scene, tmp_path, monkeypatch):
    """GDAL's own writing fails as on a full disk: the draft is a link to a device that takes nothing."""
    made = publish.tempfile.mkdtemp

    def full(**kwargs):
        folder = made(**kwargs)
        os.symlink("/dev/full", os.path.join(folder, "map.tif"))  # noqa: PTH211, PTH118
        return folder

    monkeypatch.setattr(publish.tempfile, "mkdtemp", full)
    with pytest.raises(OutputError):
        write_geotiff(scene.small(), tmp_path / "map.tif")
    assert not (tmp_path / "map.tif").exists()


def test_gdal_error_on_a_nearly_full_disk_says_so(scene, tmp_path, monkeypatch):
    from rasterio.errors import RasterioIOError

    from photomap_gis.export import geotiff

    def fail(*_, **__):
        raise RasterioIOError("Write error at scanline 3")

    monkeypatch.setattr(geotiff.rasterio, "open", fail)
    with pytest.raises(OutputError, match="Write error at scanline 3"):
        write_geotiff(scene.small(), tmp_path / "map.tif")
    usage = type(shutil.disk_usage(tmp_path))(10**9, 10**9 - 1000, 1000)
    monkeypatch.setattr(publish.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(OutputError, match="disk is full"):
        write_geotiff(scene.small(), tmp_path / "map.tif")
    assert list(tmp_path.iterdir()) == []


def test_side_files_of_an_older_map_go_with_it(scene, tmp_path):
    (tmp_path / "map.tif").write_bytes(b"old")
    for suffix in (".aux.xml", ".ovr"):
        (tmp_path / f"map.tif{suffix}").write_text("statistics of the old map")
    (tmp_path / "map.tif.txt").write_text("a note")
    write_geotiff(scene.small(), tmp_path / "map.tif")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.tif", "map.tif.txt"]


def test_a_stopped_run_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), file_in_place_of(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert left_over(tmp_path) == []


def test_a_file_that_fails_its_check_is_not_moved(tmp_path):
    def check(_):
        raise OutputError("damaged")

    with pytest.raises(OutputError, match="damaged"), file_in_place_of(tmp_path / "a.txt", check) as temporary:
        temporary.write_text("x")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_no_file_and_a_file_no_folder(scene, tmp_path):
    (tmp_path / "map.tif").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        write_geotiff(scene.small(), tmp_path / "map.tif")
    (tmp_path / "tiles").write_text("x")
    with pytest.raises(OutputError, match="is a file"):
        write_tiles(scene.small(), tmp_path / "tiles")


def test_a_users_folder_is_never_replaced(scene, tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.txt").write_text("years of work")
    with pytest.raises(OutputError, match="holds other files"):
        write_tiles(scene.small(), tmp_path / "home")
    assert (tmp_path / "home" / "thesis.txt").read_text() == "years of work"
    (tmp_path / "home" / "tiles.json").write_text("[]")
    with pytest.raises(OutputError, match="holds other files"):
        write_tiles(scene.small(), tmp_path / "home")


def test_a_folder_that_cannot_be_moved_in_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "tiles"
    path.mkdir()
    (path / "old").write_text("old")
    rename = publish.Path.rename

    def fail(self, target):
        if self.name == "new":
            raise PermissionError(errno.EACCES, "in use")
        return rename(self, target)

    monkeypatch.setattr(publish.Path, "rename", fail)
    with pytest.raises(OutputError, match="in use"), folder_in_place_of(path, ours=lambda _: True) as fresh:
        (fresh / "a").write_text("new")
    assert (path / "old").read_text() == "old"
