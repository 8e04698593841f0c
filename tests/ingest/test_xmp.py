"""XMP of several makers, and packets that mean harm."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.ingest.xmp import XmpFacts, parse_number, read_xmp

from .conftest import xmp_packet

DJI = {
    "drone-dji:AbsoluteAltitude": "+182.45",
    "drone-dji:RelativeAltitude": "+80.10",
    "drone-dji:GpsLatitude": "+52.2296756",
    "drone-dji:GpsLongtitude": "+21.0122287",
    "drone-dji:GimbalRollDegree": "+0.00",
    "drone-dji:GimbalYawDegree": "-87.30",
    "drone-dji:GimbalPitchDegree": "-89.90",
    "drone-dji:FlightRollDegree": "+2.10",
    "drone-dji:FlightYawDegree": "-85.00",
    "drone-dji:FlightPitchDegree": "-12.00",
}


@pytest.mark.parametrize("as_elements", [False, True])
def test_dji_as_attributes_and_as_elements(as_elements):
    found = read_xmp(xmp_packet(elements=DJI) if as_elements else xmp_packet(DJI))
    assert (found.lat_deg, found.lon_deg) == (52.2296756, 21.0122287)
    assert (found.alt_m, found.height_m) == (182.45, 80.10)
    assert found.attitude is not None
    assert math.degrees(found.attitude.yaw_rad) == pytest.approx(-87.3)
    assert math.degrees(found.attitude.off_nadir_rad) == pytest.approx(0.1)


def test_dji_spelt_right_too():
    found = read_xmp(xmp_packet({"drone-dji:GpsLatitude": "1.5", "drone-dji:GpsLongitude": "-2.5"}))
    assert (found.lat_deg, found.lon_deg) == (1.5, -2.5)
    found = read_xmp(xmp_packet({"drone-dji:Latitude": "1.5", "drone-dji:Longitude": "-2.5"}))
    assert (found.lat_deg, found.lon_deg) == (1.5, -2.5)


def test_rtk_sigma_counts_only_with_a_solution():
    rtk = {"drone-dji:RtkFlag": "50", "drone-dji:RtkStdLon": "0.011", "drone-dji:RtkStdLat": "0.034"}
    assert read_xmp(xmp_packet(rtk)).sigma_m == 0.034
    assert read_xmp(xmp_packet(rtk | {"drone-dji:RtkFlag": "0"})).sigma_m is None


def test_gimbal_that_was_never_read_is_unknown():
    zeros = {f"drone-dji:Gimbal{n}Degree": "+0.00" for n in ("Yaw", "Pitch", "Roll")}
    assert read_xmp(xmp_packet(zeros)).attitude is None


def test_height_of_zero_or_below_is_unknown():
    for words in ("+0.00", "-3.20"):
        assert read_xmp(xmp_packet({"drone-dji:RelativeAltitude": words})).height_m is None


def test_a_turned_gimbal_keeps_its_heading():
    """Roll of 180 at nadir turns the picture about the vertical: the heading is yaw and roll together."""
    turned = DJI | {"drone-dji:GimbalRollDegree": "180.00", "drone-dji:GimbalPitchDegree": "-90.00"}
    attitude = read_xmp(xmp_packet(turned)).attitude
    assert attitude is not None
    assert math.degrees(attitude.off_nadir_rad) == pytest.approx(0.0, abs=1e-6)
    assert abs(math.remainder(attitude.heading_rad - math.radians(-87.3 + 180), 2 * math.pi)) < 1e-6


def test_dewarp_data():
    words = "2021-03-04;3678.5,3676.5,12.3,-8.4,-0.2681,0.1131,0.0008,-0.0004,-0.0315"
    (found,) = read_xmp(xmp_packet({"drone-dji:DewarpData": words, "drone-dji:DewarpFlag": "0"})).calibrations
    assert found.focal_px == pytest.approx(3677.5, abs=0.01)
    assert found.centre_offset_xy_px == (12.3, -8.4)
    assert found.radial == (-0.2681, 0.1131, -0.0315)
    (straight,) = read_xmp(xmp_packet({"drone-dji:DewarpData": words, "drone-dji:DewarpFlag": "1"})).calibrations
    assert straight.radial == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("words", ["", "2021;1,2,3", "2021;a,b,c,d,e,f,g,h,i", "2021;0,0,0,0,0,0,0,0,0"])
def test_broken_dewarp_data_is_none(words):
    assert read_xmp(xmp_packet({"drone-dji:DewarpData": words})).calibrations == ()


def test_calibrated_focal_length_in_millimetres_is_none():
    assert read_xmp(xmp_packet({"drone-dji:CalibratedFocalLength": "8.8"})).calibrations == ()


def test_parrot():
    angles = {"Yaw": "176.310745", "Pitch": "-78.362686", "Roll": "-0.322913"}
    packet = xmp_packet(elements={f"drone-parrot:Camera{name}Degree": value for name, value in angles.items()})
    attitude = read_xmp(packet, "Parrot").attitude
    assert attitude is not None
    assert math.degrees(attitude.yaw_rad) == pytest.approx(176.310745)
    assert math.degrees(attitude.off_nadir_rad) == pytest.approx(11.64, abs=0.01)


def _pix4d(pitch: str) -> bytes:
    return (
        b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        b'<rdf:Description xmlns:Camera="http://pix4d.com/camera/1.0/" Camera:Yaw="45/1" Camera:Roll="0"'
        b' Camera:AboveGroundAltitude="120.5" Camera:GPSXYAccuracy="0.05" Camera:Pitch="' + pitch.encode() + b'"/>'
        b"</rdf:RDF></x:xmpmeta>"
    )


def test_fixed_wings_count_pitch_from_nadir():
    found = read_xmp(_pix4d("5"), "senseFly")
    assert found.attitude is not None
    assert math.degrees(found.attitude.off_nadir_rad) == pytest.approx(5.0)
    assert math.degrees(found.attitude.heading_rad) == pytest.approx(45.0, abs=0.5)
    assert (found.height_m, found.sigma_m) == (120.5, 0.05)


def test_others_count_pitch_from_the_horizon():
    for make, pitch, tilt in (("Autel Robotics", "-30", 60.0), ("", "-88", 2.0)):
        attitude = read_xmp(_pix4d(pitch), make).attitude
        assert attitude is not None
        assert math.degrees(attitude.off_nadir_rad) == pytest.approx(tilt)


def test_skydio_nests_its_angles():
    packet = (
        b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        b'<rdf:Description xmlns:s="https://www.skydio.com/drone-skydio/1.0/" s:Latitude="52.1" s:Longitude="21.2">'
        b'<s:VehicleOrientationNED s:Yaw="10" s:Pitch="1" s:Roll="2"/>'
        b'<s:CameraOrientationNED s:Yaw="146.5" s:Pitch="-84" s:Roll="0.2"/>'
        b"</rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    found = read_xmp(packet, "Skydio")
    assert (found.lat_deg, found.lon_deg) == (52.1, 21.2)
    assert found.attitude is not None
    assert math.degrees(found.attitude.yaw_rad) == pytest.approx(146.5)
    assert math.degrees(found.attitude.off_nadir_rad) == pytest.approx(6.0, abs=0.01)


@pytest.mark.parametrize(
    "words, band",
    [
        ("<Camera:BandName>NIR</Camera:BandName>", "NIR"),
        ("<Camera:BandName><rdf:Seq><rdf:li>Green</rdf:li></rdf:Seq></Camera:BandName>", "Green"),
        (
            "<Camera:BandName><rdf:Seq><rdf:li>Red</rdf:li><rdf:li>Green</rdf:li></rdf:Seq></Camera:BandName>",
            "Red, Green",
        ),
    ],
)
def test_lists_are_one_value(words, band):
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:Camera="http://pix4d.com/camera/1.0/">{words}</rdf:Description></rdf:RDF></x:xmpmeta>'
    )
    assert read_xmp(packet.encode()).band == band


def test_bombs_and_rubbish_are_empty_facts():
    bomb = b'<!DOCTYPE x [<!ENTITY a "aaaa">]>' + xmp_packet(DJI).replace(b"+80.10", b"&a;")
    for packet in (b"", b"no xml", bomb, xmp_packet(DJI)[:-60], b"<x:xmpmeta>" + b"<a>" * 10_000 + b"</x:xmpmeta>"):
        assert read_xmp(packet) == XmpFacts()


@given(st.binary(max_size=200))
def test_any_bytes_are_survived(data):
    read_xmp(b"<x:xmpmeta" + data + b"</x:xmpmeta>")


@given(st.text(max_size=30))
def test_any_value_is_survived(words):
    value = parse_number(words)
    assert value is None or math.isfinite(value)


def test_numbers():
    assert parse_number("+12.5") == 12.5
    assert parse_number("-7/2") == -3.5
    assert parse_number("7/0") is None
    assert parse_number("80.1 m") == 80.1
    assert parse_number("1e999") is None
