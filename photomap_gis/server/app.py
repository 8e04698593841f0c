"""The server as an ASGI application: which address gives what. ``docs/protocol.md`` says it in words."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any
from urllib.parse import quote

from pydantic import BaseModel
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from photomap_gis import __version__
from photomap_gis.core.errors import PhotomapError, UsageError
from photomap_gis.export.encode import TileFormat
from photomap_gis.server import vectors
from photomap_gis.server.access import Access, AccessMiddleware, problem
from photomap_gis.server.documents import mission_document, tile_json
from photomap_gis.server.find_routes import FindApi
from photomap_gis.server.host import Host
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.live_routes import LiveApi
from photomap_gis.server.live_tiles import live_tile, live_tile_json, live_value
from photomap_gis.server.missions import ServedMission, Snapshot
from photomap_gis.server.page import PageAssets
from photomap_gis.server.protocol import (
    EventDocument,
    MissionDocument,
    MissionsDocument,
    ServerDocument,
    ValueDocument,
)
from photomap_gis.server.wmts import capabilities

_NO_FRAMES: dict[str, Any] = {"type": "FeatureCollection", "features": []}
_WATCH_S = 1.0
_CACHE_FOR_EVER = "private, max-age=31536000, immutable"


def create_app(
    host: Host,
    access: Access,
    *,
    watch_s: float = _WATCH_S,
    further: Sequence[BaseRoute] = (),
    on_close: Callable[[], None] | None = None,
) -> Starlette:
    """Return the application over a host's missions.

    ``further`` are addresses of whoever builds on it, asked before our own; ``on_close`` is called when it ends.
    """
    page = PageAssets()

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        host.attach(asyncio.get_running_loop())
        watcher = asyncio.create_task(_watch(host, watch_s))
        try:
            yield
        finally:
            watcher.cancel()
            host.close_streams()
            if on_close is not None:
                await run_in_threadpool(on_close)
            await run_in_threadpool(host.close)

    api = _Api(host, access)
    routes = [
        *further,
        Route("/", page.index),
        Route("/assets/{name}", page.asset),
        Route("/api", api.server),
        Route("/events", api.events),
        Route("/missions", api.missions, methods=["GET"]),
        Route("/missions/{mission}", api.mission, methods=["GET"]),
        Route("/missions/{mission}/frames.geojson", api.geojson(vectors.frames_document)),
        Route("/missions/{mission}/track.geojson", api.geojson(vectors.track_document)),
        *FindApi(host).routes,
        *LiveApi(host).routes,
        Route("/missions/{mission}/wmts.xml", api.wmts),
        Route("/missions/{mission}/layers/{layer}/tiles.json", api.tilejson),
        Route("/missions/{mission}/layers/{layer}/value", api.value),
        Route("/missions/{mission}/layers/{layer}/{z}/{x}/{y}.{format}", api.tile),
        # The short names of the first mission, for people who type.
        Route("/tiles.json", api.tilejson),
        Route("/wmts.xml", api.wmts),
        Route("/tiles/{z}/{x}/{y}.{format}", api.tile),
    ]
    app = Starlette(
        routes=routes,
        lifespan=lifespan,
        middleware=[Middleware(AccessMiddleware, access=access)],
        exception_handlers={
            HTTPException: _http_problem,
            PhotomapError: _our_problem,
            OSError: _file_problem,
            ClientDisconnect: lambda request, error: Response(status_code=400),
        },
    )
    app.state.end_streams = host.close_streams  # see run.BoundServer
    return app


class _Api:
    """The handlers. Plain functions run in threads, since they draw and read; coroutines only pass on."""

    def __init__(self, host: Host, access: Access) -> None:
        self._host, self._access = host, access

    def server(self, request: Request) -> Response:
        return _json(ServerDocument(version=__version__, missions=self._host.ids))

    def missions(self, request: Request) -> Response:
        return _json(MissionsDocument(missions=[_document_of(m) for m in self._host.all()]))

    def mission(self, request: Request) -> Response:
        return _json(_document_of(self._mission(request)))

    def geojson(self, make: Callable[[Any], dict[str, Any]]) -> Callable[[Request], Response]:
        def answer(request: Request) -> Response:
            mission = self._mission(request)
            if isinstance(mission, LiveMission):
                document = mission.track_document() if make is vectors.track_document else _NO_FRAMES
                return JSONResponse(document, media_type="application/geo+json", headers={"cache-control": "no-store"})
            snapshot = mission.current()
            etag = f'"{snapshot.epoch}"'
            headers = {"etag": etag, "cache-control": "private, no-cache"}
            if request.headers.get("if-none-match") == etag:
                return Response(status_code=304, headers=headers)
            text = json.dumps(make(snapshot.view), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
            return Response(text, media_type="application/geo+json", headers=headers)

        return answer

    def tile(self, request: Request) -> Response:
        mission = self._mission(request)
        if isinstance(mission, LiveMission):
            return live_tile(mission, request)
        snapshot = mission.current()
        layer = request.path_params.get("layer", "map")
        zoom, x, y = (_whole(request.path_params[k]) for k in "zxy")
        wanted = request.path_params["format"].lower()
        if wanted not in [f.value for f in TileFormat]:
            raise HTTPException(404, f"tiles are {', '.join(f.value for f in TileFormat)}")
        asked, pictures = request.query_params.get("epoch"), snapshot.pictures
        etag = f'"{pictures}"'
        headers = {"etag": etag, "cache-control": _CACHE_FOR_EVER if asked == pictures else "private, no-cache"}
        if request.headers.get("if-none-match") == etag:
            return Response(status_code=304, headers=headers)
        try:
            data = self._host.tile(mission, snapshot, layer, zoom, x, y, TileFormat(wanted))
        except KeyError:
            raise HTTPException(404, "no such layer") from None
        except UsageError as error:
            raise HTTPException(404, str(error)) from error
        return Response(data, media_type=TileFormat(wanted).mime, headers=headers)

    def tilejson(self, request: Request) -> Response:
        mission = self._mission(request)
        snapshot = mission if isinstance(mission, LiveMission) else mission.current()
        layer = self._layer(request, snapshot)
        if layer.scheme.kind != "webmercator":
            raise HTTPException(404, "this map has no place on Earth: only the page can show it")
        url = self._url(request, f"missions/{mission.id}/layers/{layer.id}/") + "{z}/{x}/{y}.png" + self._key()
        if isinstance(mission, LiveMission):
            return JSONResponse(live_tile_json(mission, layer, url))
        return JSONResponse(tile_json(mission, mission.current(), layer, url))

    def wmts(self, request: Request) -> Response:
        mission = self._mission(request)
        root, key = self._url(request, f"missions/{mission.id}/"), self._key()
        self_url = f"{root}wmts.xml{key}"

        def tile_url(layer: Any) -> str:
            return f"{root}layers/{layer.id}/{{TileMatrix}}/{{TileCol}}/{{TileRow}}.png{key}"

        if isinstance(mission, LiveMission):
            if mission.session.state.map_frame.crs_wkt is None:
                raise HTTPException(404, "the map has not found its place on Earth yet: only the page can show it")
            mission.look_at_ranges()
            text = capabilities(mission.session.state.name, mission.layers, self_url, tile_url, grows=True)
        else:
            snapshot = mission.current()
            if not snapshot.view.georeferenced:
                raise HTTPException(404, "this map has no place on Earth: only the page can show it")
            text = capabilities(snapshot.view.name, snapshot.layers, self_url, tile_url)
        return Response(text, media_type="application/xml")

    def value(self, request: Request) -> Response:
        mission = self._mission(request)
        snapshot = mission if isinstance(mission, LiveMission) else mission.current()
        layer = self._layer(request, snapshot)
        try:
            x, y = (float(request.query_params[k]) for k in "xy")
        except (KeyError, ValueError):
            raise HTTPException(400, "give the place by ?x=LON&y=LAT (a local map: its units)") from None
        if not (abs(x) < 1e12 and abs(y) < 1e12):
            raise HTTPException(400, "x and y must be finite numbers")
        if isinstance(snapshot, LiveMission):
            return _json(live_value(snapshot, layer, (x, y)))
        place = snapshot.place_in(layer, (x, y))
        found = None if place is None else layer.value_at(place)
        return _json(ValueDocument(value=found, units="" if layer.values is None else layer.values.units))

    async def events(self, request: Request) -> Response:
        first = [EventDocument(event="hello")]
        snapshots = await run_in_threadpool(self._host.epochs)
        first += [EventDocument(event="mission", mission=id, epoch=epoch) for id, epoch in snapshots]
        return StreamingResponse(
            self._host.events.stream(first), media_type="text/event-stream", headers={"cache-control": "no-cache"}
        )

    def _mission(self, request: Request) -> ServedMission | LiveMission:
        try:
            return self._host.get(request.path_params.get("mission"))
        except KeyError:
            raise HTTPException(404, "no such mission") from None

    def _layer(self, request: Request, snapshot: Snapshot | LiveMission) -> Any:
        try:
            return snapshot.layer(request.path_params.get("layer", "map"))
        except KeyError:
            raise HTTPException(404, "no such layer") from None

    def _url(self, request: Request, path: str) -> str:
        return f"{request.url.scheme}://{request.url.netloc}/{path}"

    def _key(self) -> str:
        return "" if self._access.token is None else f"?token={quote(self._access.token)}"


def _document_of(mission: ServedMission | LiveMission) -> MissionDocument:
    if isinstance(mission, LiveMission):
        return mission.mission_document()
    return mission_document(mission, mission.current())


async def _watch(host: Host, every_s: float) -> None:
    """Tell listeners of missions whose files have changed."""
    known: dict[str, str] = {}
    while True:
        for id, epoch in await run_in_threadpool(host.epochs):
            if known.setdefault(id, epoch) != epoch:
                known[id] = epoch
                host.events.send(EventDocument(event="mission", mission=id, epoch=epoch))
        await asyncio.sleep(every_s)


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise HTTPException(404, "no such tile")
    return int(text)


def _json(document: BaseModel, status: int = 200) -> Response:
    return Response(
        document.model_dump_json(),
        status_code=status,
        media_type="application/json",
        headers={"cache-control": "private, no-cache"},
    )


def _http_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    names = {400: "request", 404: "not_found", 405: "method", 413: "too_large", 429: "busy"}
    return problem(error.status_code, names.get(error.status_code, "http"), error.detail)


def _file_problem(request: Request, error: Exception) -> Response:
    return problem(503, "changing", "the mission's files are being replaced, or are gone: ask again in a moment")


def _our_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, PhotomapError)
    return problem(400 if isinstance(error, UsageError) else 422, type(error).__name__, str(error))
