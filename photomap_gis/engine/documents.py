"""The documents of jobs; ``docs/protocol.md`` says the same in words. A field is only ever added within one ``API``."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from photomap_gis.server.protocol import API, Document


class EngineReadyDocument(Document):
    """The first and only line on stdout of ``photomap engine``."""

    event: Literal["ready"] = "ready"
    api: int = API
    port: int
    token: str


class EngineDocument(Document):
    """``GET /api`` of an engine."""

    api: int = API
    product: str = "photomap"
    version: str
    missions: list[str]
    engine: bool = True
    kinds: list[str]
    pid: int


class ParameterDocument(Document):
    """A parameter of a command. ``count`` values make one; where it ``repeats``, a list of them may be given."""

    name: str
    type: Literal["string", "path", "integer", "number", "boolean", "choice"]
    role: Literal["argument", "option"]
    required: bool
    repeats: bool
    count: int
    choices: list[str] | None
    minimum: float | None
    maximum: float | None
    default: Any
    metavar: str
    help: str


class CommandDocument(Document):
    """A kind of job and its parameters."""

    kind: str
    summary: str
    help: str
    parameters: list[ParameterDocument]


class CommandsDocument(Document):
    """``GET /commands``."""

    commands: list[CommandDocument]


class JobRequest(BaseModel):
    """The body of ``POST /jobs``. ``folder`` is where relative paths begin; default: the engine's own."""

    model_config = ConfigDict(extra="forbid")

    kind: str = Field(max_length=64)
    arguments: dict[str, Any] = Field(default_factory=dict)
    folder: str | None = Field(default=None, max_length=4096)


class MissionRequest(BaseModel):
    """The body of ``POST /missions``. ``before`` is an older GeoTIFF or mission to swipe against."""

    model_config = ConfigDict(extra="forbid")

    folder: str = Field(min_length=1, max_length=4096)
    before: str | None = Field(default=None, max_length=4096)


class JobState(StrEnum):
    """Where a job is; the last three are ends."""

    RUNNING = "running"
    STOPPING = "stopping"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


ENDS = frozenset({JobState.DONE, JobState.FAILED, JobState.CANCELLED})


class ProgressDocument(Document):
    """How far a stage is: the event ``progress``."""

    stage: str
    done: int | float
    total: int | float
    rate: float | None = None
    eta_s: float | None = None


class JobErrorDocument(Document):
    """Why a job failed. ``error`` is the exit code's name; ``exit_code`` is negative where a signal ended it."""

    error: Literal["usage", "data", "link", "extra", "stopped", "fault", "crashed"]
    message: str
    exit_code: int


class StateDocument(Document):
    """The event ``state``: the job runs, or was asked to stop."""

    state: JobState


class LogDocument(Document):
    """The event ``log``: a line of words for people."""

    line: str


class OutputDocument(Document):
    """The event ``output``: a document that a long command told while it goes on."""

    document: dict[str, Any]


class EndDocument(Document):
    """How a job ended: the event ``end``, the last of its stream."""

    state: JobState
    result: Any = None
    error: JobErrorDocument | None = None


class JobSummaryDocument(Document):
    """A job in ``GET /jobs``."""

    id: str
    kind: str
    state: JobState
    progress: ProgressDocument | None
    started_utc: str
    ended_utc: str | None


class JobDocument(JobSummaryDocument):
    """``GET /jobs/ID``. ``command`` is the line for a shell that does the same; ``log`` the last lines it said."""

    arguments: dict[str, Any]
    command: list[str]
    result: Any = None
    error: JobErrorDocument | None = None
    log: list[str]


class JobsDocument(Document):
    """``GET /jobs``, the newest last."""

    jobs: list[JobSummaryDocument]


EventName = Literal["state", "progress", "log", "output", "end"]
