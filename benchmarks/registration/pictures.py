"""The pictures that pairs are cut from: two disjoint lists, split by ground, one to tune on and one to report on.

Photos of one flight show the same ground many times over, so a whole ground stands on one side, except seneca, whose
two parts lie 150 m apart (more than a photo's diagonal; the photos between them are in neither list).
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

from photomap_gis.simulate.scene import procedural_scene

Part = Literal["tuning", "reporting"]
Grey = npt.NDArray[np.uint8]

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
SCENE_SIZE_M = (200.0, 200.0)
SCENE_GSD_M = 0.15
GPS_IFD = 34853


class Origin(StrEnum):
    """Where a picture comes from."""

    SHARED = "shared"
    PACKAGE = "package"
    SCENE = "scene"


@dataclass(frozen=True, slots=True)
class Picture:
    """A source picture: ``ground`` names what it shows, ``where`` is a path, ``package:path``, or a scene's seed.

    Views of it need at least ``least_px`` of its pixels a frame pixel to be crisp (small pictures are allowed 1).
    """

    ground: str
    origin: Origin
    where: str
    least_px: float = 1.3

    @property
    def name(self) -> str:
        """The ground and the file."""
        return f"{self.ground}/{Path(self.where.rpartition(':')[2]).stem}"


def _photos(ground: str, form: str, numbers: tuple[int, ...]) -> tuple[Picture, ...]:
    folder = ground.partition("-")[0]
    return tuple(Picture(ground, Origin.SHARED, f"{folder}/images/{form.format(n)}") for n in numbers)


def _package(ground: str, where: str) -> Picture:
    return Picture(ground, Origin.PACKAGE, where, least_px=1.0)


def _scenes(seeds: range) -> tuple[Picture, ...]:
    return tuple(Picture(f"scene-{seed}", Origin.SCENE, str(seed)) for seed in seeds)


TUNING: tuple[Picture, ...] = (
    *_photos("caliterra", "IMG_{}.jpg", (9354, 9358, 9362, 9366, 9370, 9374, 9378, 9382, 9386, 9390, 9394, 9398, 9402,
                                         9406, 9410, 9414, 9418, 9424, 9428)),
    *_photos("seneca", "IMG_0{}.jpg", (446, 447, 448, 449, 450, 451, 452, 453, 454, 457, 458, 459, 460, 461, 462, 463,
                                       464, 473, 515, 516, 517, 518, 519, 520, 521, 522, 523, 524, 525, 526, 527, 528,
                                       529, 530, 533, 534, 535, 536, 537, 538, 539, 540, 547, 599, 600, 601, 602, 603,
                                       604, 605, 606)),
    Picture("yellowstone-541000", Origin.SHARED, "ortho_yellowstone/2019_YELL_2_541000_4977000_image_crop.png"),
    _package("grass", "skimage:data/grass.png"),
    _package("astronaut", "skimage:data/astronaut.png"),
    _package("coffee", "skimage:data/coffee.png"),
    _package("china", "sklearn:datasets/images/china.jpg"),
    *_scenes(range(0, 24, 2)),
)  # fmt: skip
REPORTING: tuple[Picture, ...] = (
    *_photos("boruszyn", "img_{}.jpg", (4854, 4858, 4873, 4880, 4883, 4885, 4890, 4908, 4909, 4911, 4912, 4915, 4918,
                                        4926, 4928, 4929, 4933, 4935, 4937, 4940, 4946, 4955, 4961, 4967, 4969, 4970,
                                        4976, 4977)),
    *_photos("seneca-north", "IMG_0{}.jpg", (482, 491, 492, 493, 494, 495, 496, 500, 501, 502, 503, 504, 505, 506, 507,
                                             508, 509, 510, 511, 558, 559, 570, 571, 572, 573, 574, 575, 576, 581, 582,
                                             583, 584, 585, 586, 587, 588, 589, 590, 591, 592)),
    Picture("yellowstone-528000", Origin.SHARED, "ortho_yellowstone/2019_YELL_2_528000_4978000_image_crop2.png"),
    _package("gravel", "skimage:data/gravel.png"),
    _package("tissue", "skimage:data/ihc.png"),
    _package("motorcycle", "skimage:data/motorcycle_left.png"),
    _package("flower", "sklearn:datasets/images/flower.jpg"),
    *_scenes(range(1, 25, 2)),
)  # fmt: skip
LISTS: dict[Part, tuple[Picture, ...]] = {"tuning": TUNING, "reporting": REPORTING}

PLACE_APART_M = {"seneca": 160.0, "seneca-north": 160.0}
"""Photos of a ground whose fixes are further apart than this show different places (a photo's diagonal and more)."""


@dataclass(frozen=True, slots=True)
class Absent:
    """A source that could not be used, and why."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Sources:
    """The pictures of one part that are here, by group; ``absent`` are those left out."""

    part: Part
    groups: tuple[tuple[Picture, ...], ...]
    absent: tuple[Absent, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All of them."""
        return tuple(p for group in self.groups for p in group)

    @property
    def scenes(self) -> tuple[Picture, ...]:
        """Those with heights."""
        return tuple(p for p in self.pictures if p.origin is Origin.SCENE)


def find_sources(part: Part) -> Sources:
    """Return what of a part's list can be read here; sources are drawn group by group, so that no flight outweighs."""
    groups: dict[str, list[Picture]] = {}
    absent: dict[str, Absent] = {}
    for picture in LISTS[part]:
        reason = _why_absent(picture)
        if reason is not None:
            absent.setdefault(picture.ground, Absent(picture.ground, reason))
            continue
        # all small pictures out of packages are one group, and so are all scenes
        key = picture.ground if picture.origin is Origin.SHARED else picture.origin.value
        groups.setdefault(key, []).append(picture)
    return Sources(part, tuple(tuple(g) for g in groups.values()), tuple(absent.values()))


def _why_absent(picture: Picture) -> str | None:
    if picture.origin is Origin.SCENE:
        return None
    if picture.origin is Origin.SHARED:
        if _path(picture).is_file():
            return None
        return "the data that lie beside the repository (../shared/data) are not here"
    package = picture.where.partition(":")[0]
    if importlib.util.find_spec(package) is None:
        return f"the package {package} is not installed (pip install '.[bench]')"
    return None if _path(picture).is_file() else f"this version of {package} does not ship it"


def _path(picture: Picture) -> Path:
    if picture.origin is Origin.PACKAGE:
        package, _, inside = picture.where.partition(":")
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            raise FileNotFoundError(f"package {package} is not installed")
        return Path(spec.origin).parent / inside
    return SHARED / picture.where


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A height field with its grey colours; heights in pixels of the raster, so that no unit remains."""

    grey: Grey
    height_px: npt.NDArray[np.float32]


@lru_cache(maxsize=128)
def read_grey(picture: Picture) -> Grey:
    """``(H, W)`` grey values of a picture, decoded once a process."""
    if picture.origin is Origin.SCENE:
        return read_scene(picture).grey
    grey = cv2.imread(str(_path(picture)), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if grey is None:
        raise OSError(f"cannot read {picture.name}")
    return np.asarray(grey, np.uint8)


@lru_cache(maxsize=128)
def read_calm(picture: Picture) -> Grey:
    """``(H, W)`` grey values without their finest grain, which in a calm picture is half of it the photo's own noise.

    Left in, it would lie on the ground for both cameras to see, as no noise does.
    """
    return np.asarray(cv2.GaussianBlur(read_grey(picture), (0, 0), 2.0), np.uint8)


@lru_cache(maxsize=16)
def read_scene(picture: Picture) -> Scene:
    """Return a scene's colours and heights, made once a process."""
    ground = procedural_scene(SCENE_SIZE_M, SCENE_GSD_M, int(picture.where))
    assert ground.height_m is not None
    grey = np.asarray(cv2.cvtColor(ground.colour, cv2.COLOR_BGR2GRAY), np.uint8)
    return Scene(grey, (ground.height_m / SCENE_GSD_M).astype(np.float32))


def show_different_places(p: Picture, q: Picture) -> bool:
    """Whether it is sure that two pictures have no ground in common."""
    if p.ground != q.ground:
        return True
    limit = PLACE_APART_M.get(p.ground)
    if limit is None:
        return False
    (lat0, lon0), (lat1, lon1) = fix_deg(p), fix_deg(q)
    north, east = lat0 - lat1, (lon0 - lon1) * math.cos(math.radians(lat0))
    return 111_320.0 * math.hypot(north, east) > limit


@lru_cache(maxsize=512)
def fix_deg(picture: Picture) -> tuple[float, float]:
    """Latitude and longitude of a photo's fix."""
    with Image.open(_path(picture)) as photo:
        gps = photo.getexif().get_ifd(GPS_IFD)
    latitude, longitude = (
        (-1.0 if gps[ref] in ("S", "W") else 1.0) * sum(float(v) / 60.0**k for k, v in enumerate(gps[value]))
        for ref, value in ((1, 2), (3, 4))
    )
    return latitude, longitude
