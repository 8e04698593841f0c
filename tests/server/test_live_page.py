"""The page of a flight in a real Chromium: it grows, follows, is marked on, loses its server and finds it again."""

from contextlib import contextmanager

import numpy as np
import pytest
from pyproj import Transformer

from photomap_gis.server.live_view import LinkState
from tests.server.live_fake import FakeSession
from tests.server.live_served import live_server, session_in
from tests.server.test_page import browser, needs_page, page_of, pixel_of, screen

__all__ = ["browser"]  # the fixture

BACKGROUND = np.array([0xE6, 0xE3, 0xDF])  # of #map, blue first

WATCH_ALPHA = """([lon, lat]) => {
  const layer = photomap.rasters.get('map'), at = ol.proj.fromLonLat([lon, lat]);
  window.alphas = [];
  layer.on('postrender', e => {
    const [x, y] = photomap.map.getPixelFromCoordinate(at), ratio = e.frameState.pixelRatio;
    const data = e.context.getImageData(Math.round(x * ratio), Math.round(y * ratio), 1, 1).data;
    window.alphas.push(data[3]);
  });
}"""


def head(page, words: str) -> None:
    page.wait_for_function("words => document.getElementById('live-head').textContent === words", arg=words)


def settled(page) -> None:
    """Every tile in sight is as fresh as it can be."""
    page.wait_for_function(
        "() => [...photomap.rasters.values()].every(r => !r.wanted || (r.live.loading.size === 0"
        " && r.getSource().getTileGrid() && ![...r.live.known.values()].some(e => e.stale"
        " && e.tile.getTileCoord()[0] === r.getSource().getTileGrid().getZForResolution("
        "photomap.map.getView().getResolution(), r.getSource().zDirection)"
        " && ol.extent.intersects(photomap.map.getView().calculateExtent(),"
        " r.getSource().getTileGrid().getTileCoordExtent(e.tile.getTileCoord())))))"
    )
    page.evaluate("new Promise(done => { photomap.map.once('rendercomplete', () => done()); photomap.map.render(); })")


def fly(page, session: FakeSession, frames: int) -> None:
    """Fly on, and wait until the page has seen the last frame."""
    for _ in range(0, frames, 6):
        session.step(6)
    page.wait_for_function("f => photomap.live.state.pose?.frame === f", arg=session.frame)


def lives(page, session: FakeSession) -> None:
    """The page says that it is live; on a slow machine only while pictures come: a still one is told."""
    for _ in range(30):
        fly(page, session, 6)
        if page.inner_text("#live-head") == "LIVE":
            return
    head(page, "LIVE")


@contextmanager
def flight_page(browser, tmp_path, size=(1200, 800), page_options=None, **options):
    session = session_in(tmp_path, **options)
    with live_server(session) as served, page_of(browser, served.url, size, **(page_options or {})) as page:
        yield session, page


def colour_at(picture: np.ndarray, x: float, y: float) -> np.ndarray:
    x, y = round(x), round(y)
    return picture[y - 3 : y + 4, x - 3 : x + 4].reshape(-1, 3).mean(axis=0)


def truth_at(session: FakeSession, lon: float, lat: float, side: int = 5) -> np.ndarray:
    g = session.ground
    e, n = Transformer.from_crs(4326, g.crs_wkt, always_xy=True).transform(lon, lat)
    col, row = (e - g.west) / g.pixel_size_m - 0.5, (g.north - n) / g.pixel_size_m - 0.5
    c, r = round(col), round(row)
    return g.colour[r - side : r + side + 1, c - side : c + side + 1].reshape(-1, 3).mean(axis=0)


@needs_page
def test_a_flight_on_a_desktop(browser, tmp_path):
    with flight_page(browser, tmp_path) as (session, page):
        head(page, "STARTING")
        screen(page, tmp_path / "start.png")
        fly(page, session, 60)
        lives(page, session)
        settled(page)
        assert "30 fps" in page.inner_text("#chips") and "GPS" in page.inner_text("#chips")
        place = page.evaluate("photomap.live.state.pose.centre")
        page.evaluate(WATCH_ALPHA, place)
        for _ in range(12):
            fly(page, session, 18)
        settled(page)
        alphas = page.evaluate("window.alphas")
        assert len(alphas) >= 12 and min(alphas) == 255  # what was there is never gone, not for one picture
        page.wait_for_function("() => photomap.live.coverage.share > 0.3")
        assert "% seen" in page.inner_text("#chips")
        mid = screen(page, tmp_path / "mid.png")
        x, y = pixel_of(page, *place)
        assert np.abs(colour_at(mid, x, y) - BACKGROUND).max() > 20
        assert page.evaluate("photomap.live.line.getFeatures().length") >= 1

        page.mouse.move(x + 60, y - 40)
        page.locator("#accuracy-here", has_text="90 % within 1.7 m").wait_for()
        page.keyboard.press("2")
        page.locator("#find-list li", has_text="Victim 1 ± 1.7 m").wait_for()
        page.wait_for_function("() => document.querySelector('#find-list img')?.naturalWidth > 50")
        lon, lat = page.evaluate("photomap.finds.getSource().getFeatures()[0].getGeometry().getCoordinates()")
        wanted = page.evaluate(f"photomap.map.getCoordinateFromPixel([{x + 60}, {y - 40}])")
        assert abs(lon - wanted[0]) < 0.05 and abs(lat - wanted[1]) < 0.05

        session.solve()
        page.wait_for_function(
            "() => photomap.live.state.pose && document.getElementById('toast').textContent.includes('moved')"
        )
        page.wait_for_function(
            "([lon, lat]) => { const c = photomap.finds.getSource().getFeatures()[0]?.getGeometry().getCoordinates();"
            " return c && Math.hypot(c[0] - lon, c[1] - lat) > 1; }", arg=[lon, lat],
        )  # fmt: skip
        settled(page)
        page.evaluate("photomap.live.source.clear(); photomap.finds.setVisible(false);"
                      "photomap.live.groundLayer.setVisible(false);"
                      "photomap.live.lineLayer.setVisible(false); photomap.live.cursor.clear()")  # fmt: skip
        settled(page)
        after = screen(page, tmp_path / "solved.png")
        errors = []
        for dx in range(-6, 7, 2):  # the map shows the true ground where it lies now
            for dy in range(-6, 7, 2):
                at = page.evaluate(
                    f"ol.proj.toLonLat(photomap.map.getCoordinateFromPixel([{x + 10 * dx}, {y + 10 * dy}]))"
                )
                errors.append(np.abs(colour_at(after, x + 10 * dx, y + 10 * dy) - truth_at(session, *at)).mean())
        assert np.median(errors) < 12


@needs_page
def test_layers_follow_and_the_end(browser, tmp_path):
    with flight_page(browser, tmp_path) as (session, page):
        fly(page, session, 120)
        page.check("#show-sigma")
        assert page.locator("#layers .legend:visible").count() == 1
        settled(page)
        lit = screen(page, tmp_path / "sigma.png")
        x, y = pixel_of(page, *page.evaluate("photomap.live.state.pose.centre"))
        colour = colour_at(lit, x + 45, y + 30)
        assert np.abs(colour - truth_at(session, *session._lon_lat([(0, 0)])[0])).max() > 10
        page.uncheck("#show-sigma")
        page.click("#follow")
        fly(page, session, 150)
        page.wait_for_function(
            "() => { const at = ol.proj.fromLonLat(photomap.live.state.pose.drone);"
            " const [x, y] = photomap.map.getPixelFromCoordinate(at);"
            " const [w, h] = photomap.map.getSize(); return Math.abs(x / w - .5) < .2 && Math.abs(y / h - .5) < .2; }"
        )
        session.lose()
        session.step(1)
        head(page, "VIDEO LOST")
        assert "is the drone in range" in page.inner_text("#live-words")
        session.find_again()
        lives(page, session)
        page.click("#finish")
        assert session.finalised == 0
        page.click("#finish")
        head(page, "FINISHING")
        assert session.finalised == 1
        session.progress(0.42)
        page.locator("#live-words", has_text="42 %").wait_for()


@needs_page
def test_the_stabilised_view_is_beside_the_map_and_is_marked_on(browser, tmp_path):
    with flight_page(browser, tmp_path) as (session, page):
        fly(page, session, 30)
        page.wait_for_function("() => photomap.live.view.running && !document.getElementById('view').hidden")
        while not session.watchers:  # it asks for pictures: so they are made
            page.evaluate("1")
        fly(page, session, 30)
        page.wait_for_function("() => Number(document.getElementById('view-picture').dataset.sequence) > 0")
        box = page.locator("#view-picture").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        corners = page.evaluate("photomap.live.view.corners")
        page.keyboard.press("1")
        page.locator("#find-list li", has_text="Intruder 1").wait_for()
        lon, lat = page.evaluate(
            "ol.proj.toLonLat(photomap.finds.getSource().getFeatures()[0].getGeometry().getCoordinates())"
        )
        assert [lon, lat] == pytest.approx(np.mean(corners, axis=0), abs=1e-6)
        page.click("#view-toggle")
        assert not page.is_visible("#view-picture")
        page.wait_for_function("() => !photomap.live.view.running", timeout=15000)


@needs_page
def test_a_phone_marks_by_touch(browser, tmp_path):
    options = {"has_touch": True, "is_mobile": True}
    with flight_page(browser, tmp_path, (390, 780), options) as (session, page):
        fly(page, session, 150)
        settled(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for selector in ("#title", "#place", "#menu", "#view", "#mark-open"):
            box = page.locator(selector).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["y"] + box["height"] <= 780, selector
        screen(page, tmp_path / "phone.png")
        x, y = pixel_of(page, *page.evaluate("photomap.live.state.pose.centre"))
        page.tap("#mark-open")
        page.tap("#arm-kinds button[data-kind=hazard]")
        screen(page, tmp_path / "phone-arm.png")
        page.touchscreen.tap(x, y - 30)
        page.locator("#toast", has_text="Hazard 1 marked").wait_for()
        assert not page.is_visible("#arm")
        page.tap("#menu")
        row = page.locator("#find-list li")
        row.locator("input").fill("<img src=x onerror=alert(1)>")
        row.locator("input").press("Enter")
        page.wait_for_function("() => photomap.finds.getSource().getFeatures()[0].get('note').startsWith('<img')")
        assert page.query_selector("#find-list img[src=x]") is None
        screen(page, tmp_path / "phone-menu.png")
        row.locator(".away").tap()
        row.locator(".away").tap()
        page.wait_for_function("() => document.querySelectorAll('#find-list li').length === 0")


@needs_page
def test_before_any_fix_the_map_is_relative_and_then_snaps(browser, tmp_path):
    with flight_page(browser, tmp_path, georeferenced=False) as (session, page):
        fly(page, session, 90)
        assert "not georeferenced" in page.inner_text("#note")
        settled(page)
        picture = screen(page, tmp_path / "relative.png")
        x, y = page.evaluate("photomap.map.getPixelFromCoordinate(photomap.live.state.pose.centre)")
        assert picture[round(y) - 60 : round(y) + 60, round(x) - 60 : round(x) + 60].std() > 8
        page.mouse.move(x, y)
        page.keyboard.press("f")
        page.locator("#find-list li", has_text="Other 1").wait_for()
        session.snap()
        page.wait_for_function("() => window.photomap?.georeferenced && document.body.dataset.ready")
        page.locator("#toast", has_text="found its place on Earth").wait_for()
        assert page.is_hidden("#note")
        page.locator("#find-list li", has_text="Other 1 ±").wait_for()
        fly(page, session, 12)
        settled(page)
        screen(page, tmp_path / "snapped.png")


@needs_page
def test_several_watchers_see_each_others_finds(browser, tmp_path):
    session = session_in(tmp_path)
    with live_server(session) as served:
        pages = [page_of(browser, served.url, (800, 600)) for _ in range(3)]
        first, *others = [p.__enter__() for p in pages]
        fly(first, session, 48)
        x, y = pixel_of(first, *first.evaluate("photomap.live.state.pose.centre"))
        first.mouse.move(x, y)
        first.keyboard.press("3")
        for page in others:
            page.wait_for_function("f => photomap.live.state.pose?.frame === f", arg=session.frame)
            page.locator("#find-list li", has_text="Hazard 1").wait_for()
        for p in pages:
            p.__exit__(None, None, None)


@needs_page
def test_a_lost_server_is_told_and_found_again_by_itself(browser, tmp_path):
    session = session_in(tmp_path)
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    page = context.new_page()
    with live_server(session) as served:
        port = int(served.url.rstrip("/").rpartition(":")[2])
        page.goto(served.url)
        page.wait_for_selector("body[data-ready]")
        fly(page, session, 60)
        settled(page)
    head(page, "SERVER LOST")
    screen(page, tmp_path / "lost.png")
    session.step(120)  # nobody hears of it
    with live_server(session, port=port):
        page.wait_for_function("f => photomap.live.state.pose?.frame === f", arg=session.frame, timeout=20000)
        lives(page, session)
        place = session._lon_lat([session.truth(session.frame - 20).translation])[0]
        settled(page)
        back = screen(page, tmp_path / "back.png")
        x, y = pixel_of(page, float(place[0]), float(place[1]))
        assert np.abs(colour_at(back, x, y) - BACKGROUND).max() > 20
        context.close()


@needs_page
def test_a_flight_that_has_ended_with_its_server_is_not_lost(browser, tmp_path):
    session = session_in(tmp_path)
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    page = context.new_page()
    with live_server(session) as served:
        page.goto(served.url)
        page.wait_for_selector("body[data-ready]")
        fly(page, session, 40)
        session.finalise()
        session.progress(0.9)
        page.locator("#live-words", has_text="90 %").wait_for()
        page.evaluate("() => photomap.live.events.dispatchEvent(new MessageEvent('ended', "
                      "{ data: JSON.stringify({ event: 'ended', progress: 1, words: '' }) }))")  # fmt: skip
    head(page, "LANDED")
    page.locator("#live-words", has_text="photomap serve").wait_for()
    context.close()


@needs_page
def test_a_waiting_map_shows_the_drone_in_grey(browser, tmp_path):
    with flight_page(browser, tmp_path) as (session, page):
        fly(page, session, 30)
        session.lose(LinkState.WAITING)
        session.step(3)
        head(page, "MAP WAITS")
        drone = "photomap.live.source.getFeatures().find(f => f.get('role') === 'drone').get('placed')"
        assert page.evaluate(drone) is False
        assert page.evaluate("photomap.live.source.getFeatures().some(f => f.get('role') === 'footprint')") is False


@needs_page
def test_who_came_with_the_token_watches_and_marks(browser, tmp_path):
    session = session_in(tmp_path)
    with (
        live_server(session, token="correct-horse") as served,
        page_of(browser, f"{served.url}?token=correct-horse") as page,
    ):
        assert "token" not in page.url
        fly(page, session, 30)
        settled(page)
        page.mouse.move(*pixel_of(page, *page.evaluate("photomap.live.state.pose.centre")))
        page.keyboard.press("2")
        page.locator("#find-list li", has_text="Victim 1 ±").wait_for()
        page.wait_for_function("() => document.querySelector('#find-list img')?.naturalWidth > 50")
