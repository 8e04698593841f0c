"""The page in a real Chromium, from ``photomap serve`` as people start it; its coordinates against PROJ and mgrs."""

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import httpx2
import mgrs
import numpy as np
import pytest
import rasterio
from pyproj import Geod, Transformer

from photomap_gis.server.page import is_built
from tests.server.clients import client_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
needs_page = pytest.mark.skipif(
    CHROMIUM is None or not is_built(), reason="needs chromium, and OpenLayers (python hatch_build.py)"
)


@contextmanager
def served(*arguments: object) -> Iterator[dict]:
    """``photomap serve`` in a process of its own; gives what it prints when it is ready."""
    command = [sys.executable, "-m", "photomap_gis.cli", "serve", *map(str, arguments), "--port", "0", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        assert line, process.stderr.read()
        yield json.loads(line)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@contextmanager
def page_of(browser, url: str, size: tuple[int, int] = (1200, 800), **options) -> Iterator:
    """A page that has drawn everything, has asked nobody else for anything, and ran without an error."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
    page = context.new_page()
    trouble: list[str] = []
    root = url.partition("?")[0]
    page.on("console", lambda m: trouble.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda e: trouble.append(str(e)))
    page.on("request", lambda r: trouble.append(r.url) if not r.url.startswith((root, "data:", "blob:")) else None)
    page.goto(url)
    page.wait_for_selector("body[data-ready]")
    drawn(page)
    yield page
    assert trouble == []
    context.close()


def drawn(page) -> None:
    page.evaluate("new Promise(done => { photomap.map.once('rendercomplete', () => done()); photomap.map.render(); })")


def screen(page, path: Path) -> np.ndarray:
    page.screenshot(path=str(path))
    return cv2.imread(str(path))


def pixel_of(page, lon: float, lat: float) -> list[float]:
    return page.evaluate(f"photomap.map.getPixelFromCoordinate(ol.proj.fromLonLat([{lon}, {lat}]))")


@pytest.fixture(scope="module")
def old_map(mission, tmp_path_factory) -> Path:
    """The same ground in negative, as if it had changed."""
    path = tmp_path_factory.mktemp("old") / "old.tif"
    with rasterio.open(mission / "map.tif") as d:
        pixels, profile = d.read(), d.profile
    pixels[:3] = 255 - pixels[:3]
    profile.update(driver="GTiff", photometric="RGB", compress="deflate", alpha="yes")
    with rasterio.open(path, "w", **profile) as d:
        d.write(pixels)
    return path


@needs_page
def test_a_mission_on_a_desktop(mission, old_map, browser, tmp_path):
    with served(mission, "--before", old_map) as ready, page_of(browser, ready["url"]) as page:
        assert page.title() == "mission - photomap"
        assert "Predicted: CE90" in page.inner_text("#accuracy")
        before = screen(page, tmp_path / "swipe.png")
        page.evaluate("document.getElementById('show-before').click()")
        drawn(page)
        now = screen(page, tmp_path / "now.png")
        with rasterio.open(mission / "map.tif") as d:
            centre = (d.bounds.left + d.bounds.right) / 2, (d.bounds.bottom + d.bounds.top) / 2
            lon, lat = Transformer.from_crs(d.crs, 4326, always_xy=True).transform(*centre)
        x, y = (round(v) for v in pixel_of(page, lon, lat))
        handle = 600
        left, right = slice(handle - 90, handle - 30), slice(handle + 60, handle + 120)
        band = slice(y - 120, y - 60)
        difference = before[band].astype(int) + now[band]
        assert abs(np.median(difference[:, left]) - 255) < 12  # the negative, in its place
        assert np.abs(before[band, right].astype(int) - now[band, right]).mean() < 1

        page.mouse.move(x, y)
        words = page.inner_text("#coordinates")
        shown = [float(v) for v in re.findall(r"-?\d+\.\d{6}", words)]
        size_deg = 3e-5  # a pixel of the window
        assert abs(shown[0] - lat) < size_deg and abs(shown[1] - lon) < size_deg
        assert "UTM 32" in words and "MGRS 32" in words

        page.fill("#moment", "2")
        assert page.inner_text("#moment-words").startswith("Frame 3 of 6")
        assert page.is_checked("#show-frames")
        styled = "photomap.frames.getSource().getFeatures().filter(f => photomap.frames.getStyle()(f)).length"
        assert page.evaluate(styled) == 3
        page.check("#show-layer-sigma")
        drawn(page)
        assert page.locator("#layers .legend:visible").count() == 1
        page.mouse.click(x, y)
        page.locator("#picked", has_text="Sigma").wait_for()
        screen(page, tmp_path / "sigma.png")
        page.keyboard.press("Escape")

        page.click("#length")
        ends = [(x - 150, y), (x + 150, y)]
        page.mouse.click(*ends[0])
        page.mouse.dblclick(*ends[1])
        at = [page.evaluate(f"ol.proj.toLonLat(photomap.map.getCoordinateFromPixel([{a}, {b}]))") for a, b in ends]
        _, _, wanted = Geod(ellps="WGS84").inv(*at[0], *at[1])
        measured = page.inner_text("#measured")
        assert abs(float(measured.split()[0]) - wanted) < 0.06, measured
        screen(page, tmp_path / "measured.png")


@needs_page
def test_a_phone(mission, browser, tmp_path):
    with served(mission) as ready, page_of(browser, ready["url"], (390, 780), has_touch=True, is_mobile=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert not page.is_visible("#side")
        page.tap("#menu")
        assert page.is_visible("#side")
        for selector in ("#title", "#place", "#time", "#side", "#menu"):
            box = page.locator(selector).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["y"] + box["height"] <= 780, selector
        screen(page, tmp_path / "phone-menu.png")
        page.tap("#menu")
        page.touchscreen.tap(195, 400)
        page.locator("#coordinates", has_text="MGRS").wait_for()
        page.locator("#picked", has_text="Seen best by").wait_for()
        screen(page, tmp_path / "phone.png")


@needs_page
def test_a_map_without_a_place_says_so(relative, browser, tmp_path):
    with served(relative) as ready, page_of(browser, ready["url"]) as page:
        assert "not georeferenced" in page.inner_text("#note")
        page.mouse.move(500, 400)
        assert "pixels of the first frame" in page.inner_text("#coordinates")
        assert page.inner_text("#scale-words").endswith("px")
        picture = screen(page, tmp_path / "relative.png")
        assert picture[300:500, 400:600].std() > 10  # a map, not the empty ground


@needs_page
def test_finds_come_while_the_page_is_open_and_are_text(mission, browser):
    path = mission / "finds.geojson"
    with rasterio.open(mission / "map.tif") as d:
        centre = (d.bounds.left + d.bounds.right) / 2, (d.bounds.bottom + d.bounds.top) / 2
        lon, lat = Transformer.from_crs(d.crs, 4326, always_xy=True).transform(*centre)
    point = {"type": "Point", "coordinates": [lon, lat]}
    find = {"type": "Feature", "geometry": point, "properties": {"name": "<img src=x onerror=alert(1)>"}}
    try:
        with served(mission) as ready, page_of(browser, ready["url"]) as page:
            assert not page.is_visible("#finds-row")
            path.write_text(json.dumps({"type": "FeatureCollection", "features": [find]}))
            page.wait_for_selector("#finds-row", state="visible")
            assert page.inner_text("#finds-count") == "(1)"
            drawn(page)
            page.mouse.click(*pixel_of(page, lon, lat))
            page.locator("#picked", has_text="<img src=x").wait_for()
            assert page.query_selector("#picked img") is None
    finally:
        path.unlink(missing_ok=True)


@needs_page
def test_with_a_token_the_page_works_and_hides_it(mission, browser):
    with served(mission, "--token", "correct-horse") as ready:
        assert ready["url"].endswith("?token=correct-horse")
        with page_of(browser, ready["url"]) as page:
            assert "token" not in page.url


@needs_page
def test_utm_mgrs_lengths_and_areas_agree_with_proj_and_mgrs(mission, browser, rng):
    lon = rng.uniform(-180, 180, 300)
    lat = rng.uniform(-79.9, 83.9, 300)
    special = [
        (5.0, 60.0),
        (2.9, 60.0),
        (8.0, 75.0),
        (20.9, 75.0),
        (33.1, 75.0),
        (-179.99, -0.01),
        (179.99, 0.01),
        (0, 0),
    ]
    places = [*zip(lon.tolist(), lat.tolist(), strict=True), *special]
    with served(mission) as ready, page_of(browser, ready["url"]) as page:
        found = page.evaluate(
            "async places => { const c = await import('/assets/coordinates.js');"
            " return places.map(([x, y]) => ({...c.utm(x, y), mgrs: c.mgrs(x, y)})); }",
            places,
        )
        ring = [[9.0, 48.0], [9.02, 48.001], [9.018, 48.015], [8.999, 48.012]]
        length, area = page.evaluate(
            "async r => { const c = await import('/assets/coordinates.js'); return [c.lengthM(r), c.areaM2(r)]; }", ring
        )
        assert page.evaluate("import('/assets/coordinates.js').then(c => c.utm(0, 85))") is None
    peer = mgrs.MGRS()
    for (x, y), u in zip(places, found, strict=True):
        crs = f"EPSG:{(32600 if y >= 0 else 32700) + u['zone']}"
        e, n = Transformer.from_crs(4326, crs, always_xy=True).transform(x, y)
        assert abs(u["easting"] - e) < 1e-3 and abs(u["northing"] - n) < 1e-3, (x, y)
        assert u["mgrs"].replace(" ", "") == peer.toMGRS(y, x, MGRSPrecision=5).rjust(15, "0"), (x, y)
    geod = Geod(ellps="WGS84")
    xs, ys = zip(*ring, strict=True)
    assert length == pytest.approx(geod.line_length(xs, ys), abs=1e-3)
    assert area == pytest.approx(abs(geod.polygon_area_perimeter(xs, ys)[0]), rel=1e-5)


def test_where_openlayers_is_absent_the_page_says_what_to_do(mission, monkeypatch, tmp_path):
    monkeypatch.setattr("photomap_gis.server.page.BUILT", tmp_path)
    with client_of(mission) as client:
        answer = client.get("/")
        assert answer.status_code == 503 and "hatch_build.py" in answer.text and "wmts.xml" in answer.text
        assert client.get("/assets/ol.js").status_code == 404
        assert client.get("/assets/page.js").status_code == 200


def test_gdal_reads_the_wmts_and_the_map_lies_where_the_geotiff_has_it(mission):
    """A peer that knows the standard: GDAL's WMTS client warps the served map back onto map.tif."""
    with rasterio.open(mission / "map.tif") as d:
        wanted, crs, transform, shape = d.read(), d.crs, d.transform, d.shape
    with served(mission) as ready, rasterio.open(f"WMTS:{ready['url']}wmts.xml,layer=map") as wmts:
        assert wmts.crs.to_epsg() == 3857 and wmts.count == 4
        found = np.zeros((4, *shape), np.uint8)
        for band in range(4):
            rasterio.warp.reproject(
                rasterio.band(wmts, band + 1), found[band], dst_crs=crs, dst_transform=transform,
                resampling=rasterio.warp.Resampling.bilinear,
            )  # fmt: skip
    seen = (found[3] > 250) & (wanted[3] > 0)
    assert seen.mean() > 0.8 * (wanted[3] > 0).mean()
    a, b = (np.where(seen, v[1], v[1][seen].mean()).astype(np.float64) for v in (found, wanted))
    (dx, dy), _ = cv2.phaseCorrelate(a, b)
    assert np.hypot(dx, dy) < 0.1


def test_a_server_for_the_network_asks_for_a_token(mission):
    with served(mission, "--host", "0.0.0.0") as ready:
        assert len(ready["token"]) >= 20 and ready["url"].endswith(f"/?token={ready['token']}")
        root = f"http://127.0.0.1:{ready['port']}/api"
        assert httpx2.get(root, trust_env=False).status_code == 401
        assert httpx2.get(root, params={"token": ready["token"]}, trust_env=False).status_code == 200
