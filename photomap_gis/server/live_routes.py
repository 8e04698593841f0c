"""The addresses of a flight that is under way; ``docs/protocol.md`` says them in words."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from photomap_gis.server.host import Host
from photomap_gis.server.live_documents import EllipseDocument
from photomap_gis.server.live_mission import LiveMission, ellipse
from photomap_gis.server.live_view import LivePicture
from photomap_gis.server.placer import Placer
from photomap_gis.server.protocol import Document

_WAIT_S = 10.0
_BOUNDARY = "photomap-frame"
_NO_STORE = {"cache-control": "no-store"}


class AccuracyDocument(Document):
    """``GET /missions/ID/live/accuracy``: how sure the map is at a place, ``null`` where nothing was seen."""

    ellipse: EllipseDocument | None


class LiveApi:
    """The handlers of live missions; for a finished one they answer 404."""

    def __init__(self, host: Host) -> None:
        self._host = host

    @property
    def routes(self) -> list[Route]:
        """Where they are found."""
        root = "/missions/{mission}/live"
        return [
            Route(root, self.state, methods=["GET"]),
            Route(f"{root}/events", self.events),
            Route(f"{root}/coverage.geojson", self.coverage),
            Route(f"{root}/accuracy", self.accuracy),
            Route(f"{root}/view.jpg", self.view),
            Route(f"{root}/view.mjpg", self.views),
            Route(f"{root}/finalise", self.finalise, methods=["POST"]),
        ]

    def state(self, request: Request) -> Response:
        """The flight at this moment (``LiveDocument``)."""
        return Response(self._mission(request).live_document().model_dump_json(), media_type="application/json",
                        headers=_NO_STORE)  # fmt: skip

    async def events(self, request: Request) -> Response:
        """Server-sent events, the state first; taken up again by ``Last-Event-ID``."""
        mission = self._mission(request)
        stream = mission.hub.stream(mission.live_document, request.headers.get("last-event-id"))
        return StreamingResponse(stream, media_type="text/event-stream", headers=_NO_STORE)

    def coverage(self, request: Request) -> Response:
        """What is covered, and the gaps in what is to be."""
        coverage = self._host.coverage_of(self._mission(request))
        epoch, version = coverage.key()
        headers = {"etag": f'"{epoch}-{version}"', "cache-control": "private, no-cache"}
        if request.headers.get("if-none-match") == headers["etag"]:
            return Response(status_code=304, headers=headers)
        text = json.dumps(coverage.document(), allow_nan=False, separators=(",", ":"))
        return Response(text, media_type="application/geo+json", headers=headers)

    def accuracy(self, request: Request) -> Response:
        """How sure the map is at a place."""
        mission = self._mission(request)
        try:
            x, y = (float(request.query_params[k]) for k in "xy")
        except (KeyError, ValueError):
            raise HTTPException(400, "give the place by ?x=LON&y=LAT (a local map: its units)") from None
        xy = mission.placer.to_map((x, y))
        found = None if xy is None else ellipse(mission.session.covariance_at(xy))
        return Response(AccuracyDocument(ellipse=found).model_dump_json(), media_type="application/json",
                        headers=_NO_STORE)  # fmt: skip

    async def view(self, request: Request) -> Response:
        """One picture of the stabilised view, newer than ``after``; 204 where none comes for ten seconds."""
        mission = self._mission(request)
        after = request.query_params.get("after", "-1")
        if not (after.lstrip("-").isascii() and after.lstrip("-").isdigit() and len(after) < 16):
            raise HTTPException(400, "after is the sequence number of the last picture")
        picture = await mission.views.after(int(after), _WAIT_S)
        if picture is None:
            return Response(status_code=204, headers=_NO_STORE)
        words = json.dumps(_view_document(mission, picture), separators=(",", ":"))
        return Response(picture.jpeg, media_type="image/jpeg", headers={**_NO_STORE, "photomap-view": words})

    async def views(self, request: Request) -> Response:
        """The stabilised view as multipart JPEG, for players and other pages."""
        stream = self._parts(self._mission(request))
        return StreamingResponse(
            stream, media_type=f"multipart/x-mixed-replace; boundary={_BOUNDARY}", headers=_NO_STORE
        )

    async def finalise(self, request: Request) -> Response:
        """End the flight as the operator's ``q`` does."""
        mission = self._mission(request)
        await run_in_threadpool(mission.session.finalise)
        return JSONResponse({"finalising": True}, status_code=202)

    async def _parts(self, mission: LiveMission) -> AsyncIterator[bytes]:
        sequence = -1
        while not mission.ended:
            picture = await mission.views.after(sequence, _WAIT_S)
            if picture is None:
                if mission.views.closed:
                    return
                continue
            sequence = picture.sequence
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture.jpeg)}\r\n\r\n"
            yield head.encode() + picture.jpeg + b"\r\n"

    def _mission(self, request: Request) -> LiveMission:
        try:
            mission = self._host.get(request.path_params["mission"])
        except KeyError:
            raise HTTPException(404, "no such mission") from None
        if not isinstance(mission, LiveMission):
            raise HTTPException(404, "this mission is not being flown: see /missions")
        return mission


def _view_document(mission: LiveMission, picture: LivePicture) -> dict[str, Any]:
    """Return where a picture's corners lie (north-west first, clockwise), so that a click in it is a place."""
    g, frame = picture.grid, mission.session.state.map_frame
    corners = [[-0.5, -0.5], [g.width - 0.5, -0.5], [g.width - 0.5, g.height - 0.5], [-0.5, g.height - 0.5]]
    placed = None
    if g.crs_wkt == frame.crs_wkt:
        placed = Placer(frame)(frame.from_crs(g.to_crs(corners)))
    return {
        "sequence": picture.sequence, "frame": picture.frame, "time_s": round(picture.time_s, 3), "corners": placed,
    }  # fmt: skip
