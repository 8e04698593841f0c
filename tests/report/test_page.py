"""The page: everything in it, nothing beside it, and every word harmless."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from photomap_gis.report import FlightTimes, MapPicture, PackedFile, Page, page_html

JPEG = bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffd9")


def page(**changes):
    fields = {
        "title": "Photo map", "facts": {"Mission": "m"}, "picture": MapPicture(JPEG, 230.0), "accuracy": ["CE90 3 m"],
        "times": [FlightTimes("flight <1>", 660.0, 240.0, 1320.0)], "times_missing": "", "frames": {"used": "31"},
        "finds": [], "files": [PackedFile("map.tif", 12_000_000, "the map")], "lost": [], "warnings": [],
        "made_by": "photomap",
    }  # fmt: skip
    return Page(**(fields | changes))


def test_it_tells_the_papers_table():
    html = page_html(page())
    assert all(word in html for word in ("11:00", "4:00", "22:00", "12.0 MB", "50 m"))


def test_it_needs_nothing_from_anywhere():
    html = page_html(page())
    assert "<script" not in html
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!data:)", html)


def test_words_of_a_mission_are_no_markup():
    html = page_html(page(title="<img src=x onerror=alert(1)>", warnings=["<b>bold</b>"]))
    assert "<img src=x" not in html and "<b>bold</b>" not in html and "flight &lt;1&gt;" in html


@pytest.mark.parametrize(("width_m", "label"), [(230.0, "50 m"), (4.0, "1 m"), (9000.0, "2 km"), (3.0, "0.5 m")])
def test_the_bar_is_a_round_length_of_at_most_a_quarter(width_m, label):
    found, percent = MapPicture(JPEG, width_m).bar
    assert found == label and 5.0 <= percent <= 25.0


def test_it_prints_on_one_page(tmp_path):
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("Chromium is not installed")
    path = tmp_path / "summary.html"
    many = [PackedFile(f"file-{n}.tif", 1000, "a file") for n in range(7)]
    path.write_text(page_html(page(files=many, lost=["pixels", "map.kmz"])), encoding="utf-8")
    out = tmp_path / "page.pdf"
    words = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    subprocess.run([*words, f"--print-to-pdf={out}", path.as_uri()], check=True, capture_output=True, timeout=60)
    assert len(re.findall(rb"/Type\s*/Page\b", Path(out).read_bytes())) == 1
