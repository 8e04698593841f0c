"""Missions to serve, made once: one with a place on Earth, one without."""

from pathlib import Path

import pytest
from PIL import Image

from photomap_gis.cli import main
from tests.server.clients import client_of


@pytest.fixture(scope="session")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("serve")
    size = ["--frames", "6", "--width", "480", "--frame-height", "360", "--altitude", "80"]
    assert main(["simulate", "procedural", "-o", str(folder / "flight"), "-q", *size]) == 0
    assert main(["map", str(folder / "flight" / "photos"), "-o", str(folder / "mission"), "-q"]) == 0
    assert main(["export", str(folder / "mission"), "--layers", "--tiles", "-q"]) == 0
    return folder / "mission"


@pytest.fixture(scope="session")
def relative(mission, tmp_path_factory) -> Path:
    """The same photos without GPS."""
    photos = tmp_path_factory.mktemp("relative") / "photos"
    photos.mkdir()
    for photo in sorted((mission.parent / "flight" / "photos").glob("*.JPG")):
        with Image.open(photo) as picture:
            picture.save(photos / photo.name, quality=92)
    assert main(["map", str(photos), "-o", str(photos.parent / "mission"), "-q"]) == 0
    return photos.parent / "mission"


@pytest.fixture
def client(mission):
    with client_of(mission) as client:
        yield client
