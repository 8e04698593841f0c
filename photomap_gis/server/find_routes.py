"""The addresses of finds: listed, marked, changed, taken away, exported."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from photomap_gis.core.errors import PhotomapError, UsageError
from photomap_gis.core.find import MarkedFind
from photomap_gis.export.find_files import FindFormat
from photomap_gis.server.find_desk import FindChange, FindDesk, FindRequest, finds_document, finds_file
from photomap_gis.server.host import Host
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.missions import ServedMission

_MOST_BYTES = 16 << 10
Body = TypeVar("Body", bound=BaseModel)


class FindApi:
    """The handlers."""

    def __init__(self, host: Host) -> None:
        self._host = host

    @property
    def routes(self) -> list[Route]:
        """Where they are found."""
        root = "/missions/{mission}/finds"
        return [
            Route(root, self.mark, methods=["POST"]),
            Route(f"{root}.geojson", self.geojson, methods=["GET"]),
            *(Route(f"{root}.{f.value}", self._file(f), methods=["GET"]) for f in FindFormat if f.value != "geojson"),
            Route(f"{root}/{{find}}.jpg", self.snapshot, methods=["GET"]),
            Route(f"{root}/{{find}}", self.change, methods=["PATCH"]),
            Route(f"{root}/{{find}}", self.remove, methods=["DELETE"]),
        ]

    def geojson(self, request: Request) -> Response:
        """All finds, ours and those that others put into the file."""
        mission = self._mission(request)
        document = finds_document(self._desk(mission).store, georeferenced=_georeferenced(mission))
        return Response(
            json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")),
            media_type="application/geo+json",
            headers={"cache-control": "private, no-cache"},
        )

    def snapshot(self, request: Request) -> Response:
        """The picture that was taken when a find was marked."""
        try:
            data = self._desk(self._mission(request)).store.snapshot(request.path_params["find"])
        except KeyError:
            raise HTTPException(404, "no such picture") from None
        return Response(data, media_type="image/jpeg", headers={"cache-control": "private, max-age=86400"})

    async def mark(self, request: Request) -> Response:
        """A new find (``FindRequest``)."""
        mission = self._mission(request)
        wanted = await _body(request, FindRequest)
        desk = self._desk(mission)
        with _told(desk):
            find = await run_in_threadpool(desk.mark, wanted, now=datetime.now(UTC))
        self._host.tell_finds(mission, find.id)
        return _find(find, 201)

    async def change(self, request: Request) -> Response:
        """Other words for a find (``FindChange``)."""
        mission, id = self._mission(request), request.path_params["find"]
        wanted = await _body(request, FindChange)
        desk = self._desk(mission)
        with _told(desk):
            change = desk.store.change
            find = await run_in_threadpool(change, id, kind=wanted.kind, name=wanted.name, note=wanted.note)
        self._host.tell_finds(mission, id)
        return _find(find)

    async def remove(self, request: Request) -> Response:
        """A find less."""
        mission, id = self._mission(request), request.path_params["find"]
        desk = self._desk(mission)
        with _told(desk):
            await run_in_threadpool(desk.store.remove, id)
        self._host.tell_finds(mission, id)
        return Response(status_code=204)

    def _file(self, wanted: FindFormat) -> Any:
        def answer(request: Request) -> Response:
            mission = self._mission(request)
            if not _georeferenced(mission):
                raise HTTPException(404, "this map has no place on Earth, so neither have its finds: see finds.geojson")
            title = f"{_name(mission)}: finds"
            text = finds_file(self._desk(mission).store, wanted, title=title, now=datetime.now(UTC))
            headers = {
                "content-disposition": f'attachment; filename="finds.{wanted.value}"',
                "cache-control": "private, no-cache",
            }
            return Response(text, media_type=wanted.mime, headers=headers)

        return answer

    def _mission(self, request: Request) -> ServedMission | LiveMission:
        try:
            return self._host.get(request.path_params["mission"])
        except KeyError:
            raise HTTPException(404, "no such mission") from None

    def _desk(self, mission: ServedMission | LiveMission) -> FindDesk:
        return self._host.desk_of(mission)


@contextlib.contextmanager
def _told(desk: FindDesk) -> Iterator[None]:
    """Turn what goes wrong into answers; where the mission lies is nobody's business."""
    try:
        yield
    except KeyError:
        raise HTTPException(404, "no such find") from None
    except UsageError as error:
        raise HTTPException(400, str(error)) from error
    except PhotomapError as error:
        words = str(error).replace(f"{desk.store.folder}/", "").replace(str(desk.store.folder), "the mission folder")
        raise HTTPException(500, words) from error


async def _body(request: Request, kind: type[Body]) -> Body:
    """Return the request's JSON, checked; 413 and 400 with words for any other."""
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > _MOST_BYTES:
            raise HTTPException(413, f"a find is at most {_MOST_BYTES >> 10} kB of JSON")
    try:
        return kind.model_validate_json(bytes(data))
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the body"
        raise HTTPException(400, f"{where}: {first['msg']}; see docs/protocol.md") from None
    except RecursionError:
        raise HTTPException(400, "the body is nested too deeply") from None


def _find(find: MarkedFind, status: int = 200) -> Response:
    document = {
        "id": find.id, "kind": find.kind.value, "name": find.name, "note": find.note, "time_utc": find.time_utc,
        "lon_lat": find.lon_lat, "xy_map": find.xy_map, "ce90_m": find.ce90_m, "snapshot": find.snapshot,
    }  # fmt: skip
    return JSONResponse(document, status_code=status, headers={"cache-control": "no-store"})


def _georeferenced(mission: ServedMission | LiveMission) -> bool:
    if isinstance(mission, LiveMission):
        return mission.session.state.map_frame.crs_wkt is not None
    return mission.current().view.georeferenced


def _name(mission: ServedMission | LiveMission) -> str:
    return mission.session.state.name if isinstance(mission, LiveMission) else mission.current().view.name
