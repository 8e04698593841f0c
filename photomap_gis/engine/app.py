"""The engine as an ASGI application: jobs and opened missions beside all that the server answers."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from photomap_gis import __version__
from photomap_gis.engine.documents import (
    CommandsDocument,
    EngineDocument,
    JobRequest,
    JobsDocument,
    MissionRequest,
)
from photomap_gis.engine.job import Job
from photomap_gis.engine.jobs import MOST_RUNNING, Jobs, TooManyJobs
from photomap_gis.server import Access, Host, create_app
from photomap_gis.server.documents import mission_document

MAX_BODY_BYTES = 1 << 20
_MOST_MISSIONS = 64

M = TypeVar("M", bound=BaseModel)


def create_engine(
    host: Host, jobs: Jobs, access: Access, *, on_stop: Callable[[], None] = lambda: None, watch_s: float = 1.0
) -> Starlette:
    """Return the application; its end is the end of its jobs. ``on_stop`` is called when a client asks for that.

    ``access`` must ask for a token: jobs write files.
    """
    if access.token is None or not access.loopback_only:
        raise ValueError("an engine answers on loopback only, and asks for a token")
    engine = _Engine(host, jobs, on_stop)
    routes = [
        Route("/api", engine.about, methods=["GET"]),
        Route("/commands", engine.commands, methods=["GET"]),
        Route("/jobs", engine.jobs, methods=["GET"]),
        Route("/jobs", engine.start, methods=["POST"]),
        Route("/jobs/{job}", engine.job, methods=["GET"]),
        Route("/jobs/{job}", engine.stop, methods=["DELETE"]),
        Route("/jobs/{job}/events", engine.events, methods=["GET"]),
        Route("/stop", engine.end, methods=["POST"]),
        Route("/missions", engine.open_mission, methods=["POST"]),
        Route("/missions/{mission}", engine.close_mission, methods=["DELETE"]),
    ]
    return create_app(host, access, watch_s=watch_s, further=routes, on_close=jobs.close)


class _Engine:
    """The handlers."""

    def __init__(self, host: Host, jobs: Jobs, on_stop: Callable[[], None]) -> None:
        self._host, self._jobs, self._on_stop = host, jobs, on_stop

    def about(self, request: Request) -> Response:
        document = EngineDocument(version=__version__, missions=self._host.ids, kinds=self._jobs.kinds, pid=os.getpid())
        return _json(document)

    def commands(self, request: Request) -> Response:
        return _json(CommandsDocument(commands=self._jobs.commands()))

    def jobs(self, request: Request) -> Response:
        return _json(JobsDocument(jobs=[job.summary() for job in self._jobs.all()]))

    async def start(self, request: Request) -> Response:
        asked = await _body(request, JobRequest)
        folder = Path(asked.folder) if asked.folder else Path.cwd()

        def begin() -> Response:
            try:
                job = self._jobs.start(asked.kind, asked.arguments, folder)
            except TooManyJobs:
                raise HTTPException(429, f"{MOST_RUNNING} jobs are running: wait for one to end, or stop one") from None
            return _json(job.document(), 201)

        return await run_in_threadpool(begin)

    def job(self, request: Request) -> Response:
        return _json(self._job(request).document())

    def stop(self, request: Request) -> Response:
        job = self._job(request)
        job.stop(at_once=request.query_params.get("force", "") in ("1", "true"))
        return _json(job.summary(), 202)

    def end(self, request: Request) -> Response:
        return Response(status_code=202, background=BackgroundTask(self._on_stop))

    async def events(self, request: Request) -> Response:
        history = self._job(request).history
        text = request.headers.get("last-event-id") or request.query_params.get("after", "0")
        if not (text.isascii() and text.isdigit() and len(text) <= 15):
            raise HTTPException(400, "Last-Event-ID is a number: that of the last event that was read")
        told, closed = history.after(int(text))
        if closed and not told:
            return Response(status_code=204)  # tells an EventSource not to come again
        return StreamingResponse(
            history.stream(int(text)), media_type="text/event-stream", headers={"cache-control": "no-cache"}
        )

    async def open_mission(self, request: Request) -> Response:
        asked = await _body(request, MissionRequest)

        def opened() -> Response:
            if len(self._host.ids) >= _MOST_MISSIONS:
                raise HTTPException(429, f"{_MOST_MISSIONS} missions are open: close one")
            mission = self._host.open(Path(asked.folder), None if asked.before is None else Path(asked.before))
            return _json(mission_document(mission, mission.current()), 201)

        return await run_in_threadpool(opened)

    def close_mission(self, request: Request) -> Response:
        try:
            self._host.close_mission(request.path_params["mission"])
        except KeyError:
            raise HTTPException(404, "no such mission") from None
        return Response(status_code=204)

    def _job(self, request: Request) -> Job:
        try:
            return self._jobs.get(request.path_params["job"])
        except KeyError:
            raise HTTPException(404, "no such job; only the last ones are remembered") from None


async def _body(request: Request, model: Callable[..., M] | type[M]) -> M:
    """Return the request's document; 413 where it is too large, 400 with words where it is not one."""
    read = bytearray()
    async for chunk in request.stream():
        read += chunk
        if len(read) > MAX_BODY_BYTES:
            raise HTTPException(413, f"a request holds at most {MAX_BODY_BYTES >> 10} kB: put large things into a file")
    try:
        return model.model_validate_json(bytes(read))  # type: ignore[union-attr]
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise HTTPException(400, f"{where}: {first['msg']}" if where else first["msg"]) from error


def _json(document: BaseModel, status: int = 200) -> Response:
    return Response(
        document.model_dump_json(),
        status_code=status,
        media_type="application/json",
        headers={"cache-control": "no-store"},
    )
