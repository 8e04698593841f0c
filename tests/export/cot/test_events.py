"""CoT documents: golden ones, and laws for any values."""

from __future__ import annotations

import math
import sys
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from defusedxml import ElementTree
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.export.cot import CotDrone, CotFind, CotFootprint, encode, encode_removal, stable_uid

NOW = datetime(2026, 5, 1, 10, 15, 30, 250_000, UTC)
GOLDEN = Path(__file__).with_name("golden")
DOCUMENTS = {
    "drone": encode(
        CotDrone("uid-1", "photomap <drone> & \"co\"", 51.5, 7.4, 182.25, 3.4, 6.0, 271.26, 5.004, "AUTO"), NOW
    ),
    "drone-unknown": encode(CotDrone("uid-1", "d", -51.5, 187.4), NOW),
    "footprint": encode(
        CotFootprint("uid-2", "view", [(51.5, 7.4), (51.501, 7.4), (51.501, 7.402), (51.5, 7.402)], 3.4), NOW
    ),
    "find": encode(
        CotFind("uid-3", "victim 1", 51.50012345, 7.4, 2.5, None, "waves\x00 with a red cloth",
                NOW - timedelta(minutes=2)),
        NOW,
    ),
    "removal": encode_removal("uid-3", NOW),
}  # fmt: skip


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents_are_as_reviewed(name: str) -> None:
    """``python tests/export/cot/test_events.py`` writes them anew, to be reviewed as a diff."""
    assert DOCUMENTS[name] == (GOLDEN / f"{name}.xml").read_bytes()


@pytest.mark.parametrize("name", DOCUMENTS)
def test_documents_have_the_schemas_order(name: str) -> None:
    event = ElementTree.fromstring(DOCUMENTS[name])
    assert event.tag == "event" and [c.tag for c in event] == ["point", "detail"]
    assert list(event.attrib) == ["version", "uid", "type", "time", "start", "stale", "how"]
    assert list(event[0].attrib) == ["lat", "lon", "hae", "ce", "le"]
    assert event.attrib["time"] == "2026-05-01T10:15:30.250Z" < event.attrib["stale"]


texts = st.text(max_size=3000)
lats, lons = st.floats(-90, 90), st.floats(-720, 720)


@given(texts, lats, lons, st.one_of(st.none(), st.floats(allow_nan=True)), st.one_of(st.none(), st.floats(-1e3, 1e3)))
def test_any_text_and_number_gives_xml_that_is_read_again(
    text: str, lat: float, lon: float, ce: float | None, course: float | None
) -> None:
    drone = ElementTree.fromstring(encode(CotDrone("u", text, lat, lon, ce90_m=ce, course_deg=course), NOW))
    find = ElementTree.fromstring(encode(CotFind("u", text, lat, lon, ce, remarks=text), NOW))
    for event in (drone, find):
        assert math.isclose(float(event[0].attrib["lat"]), lat, abs_tol=1e-7)
        assert abs(math.remainder(float(event[0].attrib["lon"]) - lon, 360.0)) < 1e-6
        assert math.isfinite(float(event[0].attrib["ce"]))
    if course is not None:
        assert 0.0 <= float(drone.find("detail/track").attrib["course"]) <= 360.0


@pytest.mark.parametrize("lat, lon", [(math.nan, 0.0), (91.0, 0.0), (0.0, math.inf)])
def test_a_place_that_is_none_is_refused(lat: float, lon: float) -> None:
    with pytest.raises(ValueError, match="must"):
        encode(CotDrone("u", "d", lat, lon), NOW)
    with pytest.raises(ValueError, match="3 corners"):
        encode(CotFootprint("u", "v", [(0.0, 0.0), (1.0, 1.0)]), NOW)


def test_a_footprint_across_the_date_line_has_its_centre_there() -> None:
    event = ElementTree.fromstring(
        encode(CotFootprint("u", "v", [(0.0, 179.999), (0.0, -179.999), (0.001, -179.999), (0.001, 179.999)]), NOW)
    )
    assert abs(abs(float(event[0].attrib["lon"])) - 180.0) < 1e-6


def test_times_are_utc_and_uids_stable() -> None:
    there = NOW.astimezone(timezone(timedelta(hours=5, minutes=45)))
    assert encode(CotDrone("u", "d", 0.0, 0.0), there) == encode(CotDrone("u", "d", 0.0, 0.0), NOW)
    assert stable_uid("m", "find", 1) == stable_uid("m", "find", 1) != stable_uid("m", "find", 2)


if __name__ == "__main__":
    for name, document in DOCUMENTS.items():
        (GOLDEN / f"{name}.xml").write_bytes(document)
        sys.stdout.write(document.decode() + "\n")
