"""What servers see of a flight: documents, tiles in the place of the map's own pixels, anchors, the still view."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from photomap_gis.core.grid import Window
from photomap_gis.export.encode import TileFormat
from photomap_gis.live.lattice import TILE_PX
from photomap_gis.live.still import BRIGHTNESS
from photomap_gis.live.view import LiveView
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.live_view import LivePose, LiveSnapped, LiveSolution, LiveTiles, RasterKind
from tests.live.conftest import Flown, frame_of

COUNT = 70


def test_the_flight_as_the_world_sees_it(fly, flown: Flown) -> None:
    flight = fly(frame_of(flown, k) for k in range(COUNT))
    view = flight.view

    # four rasters on one lattice, versions that grow, and every pixel's numbers
    rasters = {r.kind: r for r in view.rasters}
    assert list(rasters) == list(RasterKind)
    extent = rasters[RasterKind.MAP].extent()
    assert extent is not None and rasters[RasterKind.MAP].version_in(extent) > 0
    assert rasters[RasterKind.MAP].version_in(Window(10**7, 10**7, 256, 256)) == 0
    seen = rasters[RasterKind.MAP].read(extent)[..., 3] > 0
    for kind in (RasterKind.AGE, RasterKind.SIGMA, RasterKind.SEARCHED):
        values = rasters[kind].read(extent)
        assert values.dtype == np.float32
        np.testing.assert_array_equal(np.isfinite(values), seen)
    age = rasters[RasterKind.AGE].read(extent)
    assert np.nanmin(age) >= 0.0 and np.nanmax(age) <= COUNT / 8.0
    gsd = float(np.nanmedian(rasters[RasterKind.SEARCHED].read(extent)))
    assert gsd == pytest.approx(flown.truth.gsd_m_per_px, rel=0.1)

    # an anchor is a place in a key frame, and leads back to where it is
    chart = flight.session.loop.chart
    xy = tuple(float(v) for v in chart.placement(len(chart) // 2).centre_xy_map_m)
    anchor = view.anchor_at(xy)
    assert anchor is not None
    back = view.place_of(anchor)
    assert back == pytest.approx(xy, abs=0.5 * gsd)
    covariance = view.covariance_at(xy)
    assert covariance is not None and 0.01 < np.sqrt(np.trace(covariance)) < 20.0
    picture = view.picture_at(anchor)
    assert picture is not None and picture.ndim == 3
    assert view.anchor_at((1e6, 1e6)) is None and view.covariance_at((1e6, 1e6)) is None
    assert len(view.track().xy_map_m) == len(chart)

    # the page's tile is the map's own pixels
    mission = LiveMission("1", view, lambda one: None)
    document = mission.mission_document()
    assert document.georeferenced and document.layers[0].id == "map"
    painter = flight.session.hand.painter
    assert painter is not None
    canvas, lattice = painter.canvas, painter.canvas.lattice
    zoom = round(np.log2(2.0 * 20037508.342789244 / TILE_PX / lattice.grid.pixel_size))
    tile = max(canvas.tiles(), key=lambda t: int((canvas.read(canvas.window_of(t), lambda p: p.shown, -1) >= 0).sum()))
    made = mission.layer("map").tile(
        zoom, lattice.first_tile.col + tile.col, lattice.first_tile.row + tile.row, TileFormat.PNG
    )
    shown = cv2.cvtColor(cv2.imdecode(np.frombuffer(made.data, np.uint8), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)
    own = rasters[RasterKind.MAP].read(canvas.window_of(tile))
    opaque = (own[..., 3] > 0) & (shown[..., 3] > 0)
    assert opaque.mean() > 0.9
    assert np.abs(own[opaque].astype(int) - shown[opaque]).mean() < 1.0
    mission.close()

    # the stabilised view shows the ground where the map shows it
    key = len(chart) - 1
    number = int(chart.refs[key].frame_number or 0)
    still = view.still.picture(number, number / 8.0, frame_of(flown, number).picture, chart.placement(key), canvas)
    assert still is not None
    got = cv2.imdecode(np.frombuffer(still.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    grid = still.grid
    scale = grid.pixel_size / lattice.grid.pixel_size
    x0, y0 = lattice.grid.to_px([grid.to_crs([[0.0, 0.0]])[0]])[0]
    window = Window(int(x0), int(y0), int(grid.width * scale), int(grid.height * scale))
    ground = cv2.cvtColor(rasters[RasterKind.MAP].read(window)[..., :3], cv2.COLOR_RGB2GRAY).astype(np.float32)
    ground = cv2.resize(ground, (grid.width, grid.height), interpolation=cv2.INTER_AREA)
    outline = grid.to_px(lattice.frame.to_crs(chart.placement(key).outline_xy_map_m()))
    frame = cv2.fillPoly(np.zeros(got.shape, np.uint8), [np.round(outline).astype(np.int32)], 1)
    inside, around = (cv2.erode(part, np.ones((5, 5), np.uint8)) * (ground > 0) > 0 for part in (frame, 1 - frame))
    assert inside.mean() > 0.2 and around.mean() > 0.05
    assert np.corrcoef(got[inside], ground[inside])[0, 1] > 0.8
    # around it lies the map, dimmed
    assert np.corrcoef(got[around], ground[around])[0, 1] > 0.9
    assert np.median(got[around] / np.maximum(ground[around], 1.0)) == pytest.approx(BRIGHTNESS, abs=0.05)


def test_events_come_in_an_order_that_can_be_followed(fly, flown: Flown, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[object] = []
    monkeypatch.setattr(LiveView, "tell", lambda self, event: told.append(event))
    fly(frame_of(flown, k) for k in range(40))
    poses = [e for e in told if isinstance(e, LivePose)]
    assert [p.frame for p in poses] == list(range(40))
    snapped = [k for k, e in enumerate(told) if isinstance(e, LiveSnapped)]
    assert len(snapped) == 2  # the map began, and found its place
    assert any(isinstance(e, LiveTiles) for e in told[snapped[0] :])
    assert any(isinstance(e, LiveSolution) for e in told)
