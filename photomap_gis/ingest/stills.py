"""One photo: what it says of itself, and its pixels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from photomap_gis.core.errors import FrameReadError
from photomap_gis.core.frame import Frame, FrameRef, ImageArray
from photomap_gis.ingest.exif import ExifFacts, read_exif
from photomap_gis.ingest.headers import has_whole_picture, read_header
from photomap_gis.ingest.lenses import LensFacts
from photomap_gis.ingest.profiles import CameraRole
from photomap_gis.ingest.xmp import XmpFacts, read_xmp

PHOTO_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".tif", ".tiff", ".png", ".webp", ".bmp", ".jp2"})
RAW_SUFFIXES = frozenset({".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".heic", ".heif"})
MAX_PIXELS = 600_000_000
MAX_FILE_BYTES = 4 << 30

# DJI_20240101120000_0001_W.JPG, DJI_0001_THRM.JPG, DJI_..._MS_NIR.TIF; MAX_0001.JPG and IRX_0001.JPG (Autel)
_LENS_SUFFIX = re.compile(r"[_\-](WIDE|ZOOM|THRM|THERMAL|TELE|VIS|MS_[A-Z]+|[WZTVDS])$", re.IGNORECASE)
_LENS_PREFIX = re.compile(r"^(IRX|MAX)[_\-]", re.IGNORECASE)
_ROLE_OF_NAME = {
    "W": CameraRole.WIDE,
    "WIDE": CameraRole.WIDE,
    "Z": CameraRole.ZOOM,
    "ZOOM": CameraRole.ZOOM,
    "TELE": CameraRole.ZOOM,
    "T": CameraRole.THERMAL,
    "THRM": CameraRole.THERMAL,
    "THERMAL": CameraRole.THERMAL,
    "IRX": CameraRole.THERMAL,
    "V": CameraRole.VISIBLE,
    "VIS": CameraRole.VISIBLE,
    "D": CameraRole.VISIBLE,
    "MAX": CameraRole.VISIBLE,
}
_ROLE_OF_SOURCE = (
    ("infrared", CameraRole.THERMAL),
    ("thermal", CameraRole.THERMAL),
    ("wide", CameraRole.WIDE),
    ("zoom", CameraRole.ZOOM),
    ("tele", CameraRole.ZOOM),
)
_THERMAL_BANDS = ("lwir", "thermal", "tir")
_THERMAL_SIZES = frozenset({(640, 512), (640, 480), (336, 256), (320, 240), (160, 120), (1280, 1024)})


@dataclass(frozen=True, slots=True)
class Still:
    """A photo without its pixels, and all that its header says; ``problem`` where it cannot be read.

    ``band`` tells the spectral bands of one multispectral camera apart.
    """

    path: Path
    width_px: int = 0
    height_px: int = 0
    exif: ExifFacts = field(default_factory=ExifFacts)
    xmp: XmpFacts = field(default_factory=XmpFacts)
    role: CameraRole = CameraRole.VISIBLE
    band: str = ""
    is_map: bool = False
    problem: str | None = None

    @property
    def make(self) -> str:
        """The camera's maker."""
        return self.exif.make or self.xmp.make

    @property
    def model(self) -> str:
        """The camera's model."""
        return self.exif.model or self.xmp.model

    @property
    def lens(self) -> LensFacts:
        """What the photo says of its lens."""
        role = None if self.role is CameraRole.VISIBLE else self.role
        return LensFacts.of_exif(
            self.exif, make=self.xmp.make, model=self.xmp.model, role=role, calibrations=self.xmp.calibrations
        )


def read_still(path: Path) -> Still:
    """Return what the photo at ``path`` says; a photo that cannot be read comes back with its ``problem``."""
    try:
        header = read_header(path)
    except FrameReadError as error:
        role, band = _role(path, (0, 0), "", XmpFacts())
        why = str(error).removeprefix(f"{path.name}: ")
        return Still(path, role=role, band=band, problem=f"unreadable: {why}")
    if header.width_px * header.height_px > MAX_PIXELS:
        return Still(path, problem=f"unreadable: {header.width_px} x {header.height_px} pixels are too many")
    exif = read_exif(header.tags)
    xmp = read_xmp(header.xmp, exif.make)
    role, band = _role(path, (header.width_px, header.height_px), exif.make, xmp)
    return Still(path, header.width_px, header.height_px, exif, xmp, role, band, header.is_map)


def _role(path: Path, size_px: tuple[int, int], make: str, xmp: XmpFacts) -> tuple[CameraRole, str]:
    """Tell which of a drone's cameras took the photo, and its band: by its own word, its band, its name, its size."""
    source = xmp.source.lower()
    for word, role in _ROLE_OF_SOURCE:
        if word in source:
            return role, ""
    band = xmp.band.lower()
    if band and "," not in band:  # several bands in one raster are a colour camera's
        return (CameraRole.THERMAL, "") if band in _THERMAL_BANDS else (CameraRole.BAND, band)
    found = _LENS_SUFFIX.search(path.stem) or _LENS_PREFIX.search(path.stem)
    if found:
        word = found.group(1).upper()
        if word.startswith("MS_"):
            return CameraRole.BAND, word.removeprefix("MS_").lower()
        # a single letter means a lens in DJI's names only
        if len(word) > 1 or path.stem.upper().startswith("DJI") or make.upper().startswith(("DJI", "HASSELBLAD")):
            return _ROLE_OF_NAME.get(word, CameraRole.VISIBLE), ""
    is_drone = make.upper().startswith(("DJI", "AUTEL", "PARROT", "FLIR")) or bool(xmp.make)
    return (CameraRole.THERMAL if size_px in _THERMAL_SIZES and is_drone else CameraRole.VISIBLE), ""


def read_photo(ref: FrameRef) -> Frame:
    """Return the photo with its pixels: ``(H, W, 3)`` BGR or ``(H, W)`` grey, as stored (EXIF orientation not applied).

    More than eight bits are stretched to eight between the 0.1 and 99.9 percentile. Raises ``FrameReadError``.
    """
    path = Path(ref.source)
    if ref.problem is not None:
        raise FrameReadError(f"{ref.name}: {ref.problem}")
    if ref.width_px * ref.height_px > MAX_PIXELS:
        raise FrameReadError(f"{ref.name}: {ref.width_px} x {ref.height_px} pixels are too many: make it smaller")
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise FrameReadError(f"{ref.name}: the file is larger than 4 GiB: leave it out")
        data = path.read_bytes()
    except OSError as error:
        raise FrameReadError(f"{ref.name}: {error.strerror or error}: check the file {path}") from error
    if not data:
        raise FrameReadError(f"{ref.name}: the file is empty: copy it again")
    if not has_whole_picture(data):
        raise FrameReadError(f"{ref.name}: the file is cut off: copy it again")
    image = _decode(data)
    if image is None:
        raise FrameReadError(f"{ref.name}: the picture cannot be decoded: copy it again or leave it out")
    if ref.width_px and image.shape[:2] != (ref.height_px, ref.width_px):
        found = f"{image.shape[1]} x {image.shape[0]}"
        raise FrameReadError(f"{ref.name}: {found} pixels where {ref.width_px} x {ref.height_px} were: it has changed")
    return Frame(ref, image)


def _decode(data: bytes) -> ImageArray | None:
    """Return eight-bit grey or BGR pixels, ``None`` where OpenCV cannot decode them."""
    buffer = np.frombuffer(data, dtype=np.uint8)
    # JPEG: eight bits, colour or grey as it is. Others unchanged: more bits are stretched here, not cut off by OpenCV.
    is_jpeg = data[:2] == b"\xff\xd8"
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION if is_jpeg else cv2.IMREAD_UNCHANGED
    try:
        image = cv2.imdecode(buffer, flags)
    except cv2.error:
        return None
    if image is None or image.size == 0:
        return None
    if image.dtype != np.uint8:
        image = _to_eight_bits(image)
    if image.ndim == 3:  # two channels are grey with alpha, four are colour with alpha
        image = image[:, :, 0] if image.shape[2] < 3 else image[:, :, :3]
    return np.ascontiguousarray(image)


def _to_eight_bits(image: npt.NDArray[np.generic]) -> ImageArray:
    """Stretch what is between the 0.1 and 99.9 percentile of all channels together to 0..255."""
    values = image.astype(np.float32)
    values = np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
    step = max(1, values.size // 1_000_000)
    low, high = np.percentile(values.reshape(-1)[::step], (0.1, 99.9))
    scaled = (values - low) * (255.0 / max(float(high - low), 1e-6))
    return np.clip(scaled + 0.5, 0, 255).astype(np.uint8)
