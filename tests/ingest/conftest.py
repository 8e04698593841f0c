"""Photos made for tests: any EXIF, any XMP, in a temporary folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

EXIF_IFD, GPS_IFD = 0x8769, 0x8825

DJI_XMP = """<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="DJI Meta Data" xmlns:tiff="http://ns.adobe.com/tiff/1.0/"
 xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
 xmlns:drone-parrot="http://www.parrot.com/drone-parrot/1.0/" {attributes}>
{elements}</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>"""


def dms(degrees: float, denominator: int = 10_000) -> tuple[IFDRational, IFDRational, IFDRational]:
    """Return degrees, minutes, seconds as rationals; seconds in steps of 1 / denominator."""
    total = round(abs(degrees) * 3600 * denominator)
    whole, rest = divmod(total, 3600 * denominator)
    minutes, seconds = divmod(rest, 60 * denominator)
    return IFDRational(whole, 1), IFDRational(minutes, 1), IFDRational(seconds, denominator)


def xmp_packet(attributes: Mapping[str, Any] | None = None, elements: Mapping[str, Any] | None = None) -> bytes:
    """Return a packet with the given attributes and elements (names with their prefix)."""
    return DJI_XMP.format(
        attributes=" ".join(f'{k}="{v}"' for k, v in (attributes or {}).items()),
        elements="".join(f"<{k}>{v}</{k}>" for k, v in (elements or {}).items()),
    ).encode()


PhotoMaker = Callable[..., Path]


@pytest.fixture
def make_photo(tmp_path: Path) -> PhotoMaker:
    """Return a function that writes a JPEG (or what the suffix says) and returns its path.

    ``main``, ``exif`` and ``gps`` are tags by number; ``lat`` and ``lon`` fill the GPS tags; ``taken`` is
    DateTimeOriginal; ``xmp`` a packet.
    """

    def make(
        name: str = "IMG_0001.jpg",
        *,
        size: tuple[int, int] = (64, 48),
        make: str | None = "DJI",
        model: str | None = "FC6310",
        taken: str | None = None,
        focal_mm: float | None = None,
        lat: float | None = None,
        lon: float | None = None,
        main: Mapping[int, Any] | None = None,
        exif: Mapping[int, Any] | None = None,
        gps: Mapping[int, Any] | None = None,
        xmp: bytes | None = None,
        mode: str = "RGB",
    ) -> Path:
        tags = Image.Exif()
        if make is not None:
            tags[0x10F] = make
        if model is not None:
            tags[0x110] = model
        tags.update(dict(main or {}))
        details = dict(exif or {})
        if taken is not None:
            details[0x9003] = taken
        if focal_mm is not None:
            f = Fraction(focal_mm).limit_denominator(100)
            details[0x920A] = IFDRational(f.numerator, f.denominator)
        place = dict(gps or {})
        if lat is not None and lon is not None:
            place = {1: "N" if lat >= 0 else "S", 2: dms(lat), 3: "E" if lon >= 0 else "W", 4: dms(lon)} | place
        if details:
            tags.get_ifd(EXIF_IFD).update(details)
        if place:
            tags.get_ifd(GPS_IFD).update(place)
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        ramp = np.add.outer(np.arange(size[1]), np.arange(size[0])) % 256
        picture = Image.fromarray(ramp.astype(np.uint8)).convert(mode)
        extra = {"xmp": xmp} if xmp is not None else {}
        picture.save(path, exif=tags.tobytes(), **extra)
        return path

    return make
