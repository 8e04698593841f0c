"""Error frames in a flight: what is spoilt in part is masked, what is spoilt is left out with its reason."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from photomap_gis.core.frame import FrameStatus
from photomap_gis.core.measurement import Registration
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.ifmi import FrameVerdict
from photomap_gis.pipeline import MapSettings, map_flight
from photomap_gis.pipeline.neighbours import LONGEST_STREAK, Met, WorkingImages, _Chain
from photomap_gis.simulate.evaluate import evaluate_map
from photomap_gis.store import Mission, PreparedFrame

TORN, BLACK = 5, 9


def spoil(photo: Path, change) -> None:
    """Change a photo's pixels and keep all that is written beside them."""
    with Image.open(photo) as picture:
        pixels, exif, xmp = np.array(picture), picture.info.get("exif", b""), picture.info.get("xmp")
    more = {} if xmp is None else {"xmp": xmp}
    Image.fromarray(change(pixels)).save(photo, quality=92, exif=exif, **more)


def tear(pixels):
    h, w = pixels.shape[:2]
    out = pixels.copy()
    rows = slice(round(0.45 * h), round(0.65 * h))
    out[rows] = np.roll(out[rows], w // 4, axis=1)
    return out


@pytest.fixture(scope="module")
def spoilt(flown, tmp_path_factory):
    """A flight with a photo torn over a fifth of its rows, and a black one."""
    photos = tmp_path_factory.mktemp("spoilt") / "photos"
    shutil.copytree(flown.photos, photos)
    names = sorted(photos.glob("*.JPG"))
    spoil(names[TORN], tear)
    spoil(names[BLACK], np.zeros_like)
    folder = tmp_path_factory.mktemp("missions") / "m"
    return photos, folder, map_flight([photos], folder, MapSettings(workers=2))


def test_a_torn_frame_is_masked_and_a_black_one_left_out(spoilt, flown):
    _, folder, summary = spoilt
    with Mission.open(folder) as mission:
        prepared = {p.frame: p for p in mission.prepared}
        statuses = {p.frame: (p.status, p.reason) for p in mission.load_solution().placements}
    assert prepared[TORN].usable and "lost" in prepared[TORN].reason
    assert statuses[TORN][0] is FrameStatus.REGISTERED
    assert not prepared[BLACK].usable and statuses[BLACK][0] is FrameStatus.ERROR_FRAME
    assert "black" in statuses[BLACK][1]
    assert [f for f, p in prepared.items() if p.reason] == [TORN, BLACK], "nothing else is touched"
    assert summary.frames["error_frame"] == 1 and summary.frames["registered"] == 13
    masked = list((folder / "cache" / "working").rglob(f"{TORN:06d}.masked.png"))
    assert len(masked) == 1
    both = cv2.imread(str(masked[0]), cv2.IMREAD_GRAYSCALE)
    mask = both[len(both) // 2 :] > 127
    h = len(mask)
    assert mask[round(0.48 * h) : round(0.62 * h)].mean() < 0.4 and mask[: round(0.35 * h)].mean() > 0.9
    errors = evaluate_map(summary.map, flown.truth.folder)
    assert errors.relative_rmse_gsd < 5


def test_a_second_run_changes_nothing(spoilt):
    photos, folder, summary = spoilt
    before = {p.name: p.read_bytes() for p in folder.glob("*.jsonl")}
    assert map_flight([photos], folder).frames == summary.frames
    assert {p.name: p.read_bytes() for p in folder.glob("*.jsonl")} == before


class Journals:
    """A mission's journals, as lists."""

    def __init__(self):
        self.prepared, self.registrations = [], []


def met(a, b, *, ok=True, fault=None, accepted=True, moved_px=8.0, still=False):
    verdict = FrameVerdict(ok, None if ok and fault is None else "odd", fault)
    found = Registration(Similarity2D(moved_px), np.eye(4), 1.0, (256, 256), accepted=accepted, a=a, b=b)
    return Met(a, b, verdict, found, moved_px, still)


@pytest.fixture
def chain():
    images = WorkingImages(lambda frame: (np.zeros((4, 4), np.uint8), None), lambda frame, grey, mask: None)
    prepared = {k: PreparedFrame(k, True) for k in range(20)}
    journals = Journals()
    c = _Chain(journals, prepared, images)
    c.journals, c.frames = journals, prepared
    return c


def test_the_odd_one_of_three_is_the_first_where_nobody_vouches_for_it(chain):
    odd = met(0, 1, ok=False)
    chain.take((0, 1), odd, met(1, 2))
    chain.take((1, 2), met(1, 2), None)
    assert not chain.frames[0].usable and chain.frames[1].usable


def test_the_odd_one_is_the_second_where_the_first_fits_its_own_predecessor(chain):
    chain.take((0, 1), met(0, 1), None)
    chain.take((1, 2), met(1, 2, ok=False), met(2, 3))
    assert chain.frames[1].usable and not chain.frames[2].usable
    chain.take((2, 3), met(2, 3), None)
    assert (2, 3) not in chain.met, "judged against a rejected frame: once more"
    assert [(r.a, r.b) for r in chain.journals.registrations] == [(0, 1)]


def test_many_odd_ones_in_a_row_are_a_new_scene(chain):
    chain.take((0, 1), met(0, 1), None)
    for k in range(2, 2 + LONGEST_STREAK):
        chain.begin_round()
        chain.take((1, k), met(1, k, ok=False), None)
        assert not chain.frames[k].usable
    chain.begin_round()
    last = 2 + LONGEST_STREAK
    chain.take((1, last), met(1, last, ok=False), None)
    assert chain.frames[last].usable


def test_a_frame_that_stands_still_after_a_moving_one_is_frozen(chain):
    chain.take((0, 1), met(0, 1, moved_px=9.0), None)
    chain.take((1, 2), met(1, 2, moved_px=0.1, still=True), None)
    assert not chain.frames[2].usable and "frozen" in chain.frames[2].reason


def test_a_hovering_camera_goes_on(chain):
    for k in range(5):
        chain.take((k, k + 1), met(k, k + 1, moved_px=0.2, still=True), None)
    assert all(p.usable for p in chain.frames.values())
