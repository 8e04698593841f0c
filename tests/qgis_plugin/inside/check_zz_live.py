import os, sys, time
from check_live import *
from check_live import _connect, _caught_up, _share_of_ground
from qgis.PyQt.QtCore import Qt
from qgis.gui import QgsLayerTreeMapCanvasBridge
for n in [n for n in dir() if n.startswith("test_")]: del globals()[n]
def test_shot(dock, canvas, hand, fly, wait_until, said):
    bridge = QgsLayerTreeMapCanvasBridge(QgsProject.instance().layerTreeRoot(), canvas)
    window = canvas.window(); window.setCentralWidget(canvas)
    window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, dock); dock.show()
    window.resize(1300, 850); QCoreApplication.processEvents()
    flight = fly(); print("fly", flush=True)
    flight.do("step 110")
    flight.do("solve")
    _connect(dock, flight, wait_until); print("conn", flush=True)
    told=flight.do("step 60")
    lon, lat = flight.do("ask")["lon_lat"]
    dock._feed.ask(lambda c: c.mark("victim", (lon-0.0001, lat), "waves"), lambda d: print(d), lambda w: print(w))
    t=time.monotonic(); wait_until(lambda: time.monotonic()-t>8, "time")
    print(dock.screen.heard, told, dock.screen.rasters["map"].resting, list(dock.screen.overlay.layers), flush=True)
    t=time.monotonic(); wait_until(lambda: not canvas.isDrawing() or time.monotonic()-t > 6, "d")
    window.grab().save('/tmp/qp/live1.png'); print("shot", flush=True)
    lows=[]
    raster=dock.screen.rasters["map"]
    root = QgsProject.instance().layerTreeRoot()
    for node in root.findLayers(): node.setItemVisibilityChecked(node.layerId()==raster.layer.id())
    t=time.monotonic(); wait_until(lambda: time.monotonic()-t>3, "time")
    base=_share_of_ground(canvas.grab().toImage()); s0=raster.swaps
    for k in range(4):
        flight.do("step 8")
        t=time.monotonic()
        def sample():
            lows.append(_share_of_ground(canvas.grab().toImage())); return time.monotonic()-t>2
        wait_until(sample,"s")
    print("base", base, "min", min(lows), "max", max(lows), "n", len(lows), "swaps", raster.swaps-s0, flush=True)
