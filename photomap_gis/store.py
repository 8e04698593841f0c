"""The mission folder: all that is needed to resume a mapping run, to extend it or to export it again.

::

    MISSION/
      mission.json          what was asked for, and where the map frame lies (replaced whole)
      frames.jsonl          one FrameRef a line, with the flights (journals: only ever appended)
      tracks.jsonl          the track of a flight a line, where a log gave the frames their places
      prepared.jsonl        one verdict a frame: usable or not, and where its working image lies in its plane
      registrations.jsonl   one registration a line, whether accepted or not
      references.json       frames found in existing imagery, with where it shows them (replaced whole)
      control.json          ground control, picks and nudges (replaced whole); the file given lies beside it verbatim
      solution.json         the placements of the newest solution, and every frame's status (replaced whole)
      cache/working/        small levelled grey images, one a frame; can be made again
      cache/frames/         the frames taken out of videos
      mosaic/               the rendered tiles of the map (mosaic-2, ... for further segments of a map without GPS)
      map.tif, map.kmz ...  what was exported

A killed run leaves at worst a journal whose last line is cut: it is dropped when the journal is opened again.
"""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from photomap_gis.core.control import ControlPoint, Nudge
from photomap_gis.core.errors import DataError, OutputError, UsageError
from photomap_gis.core.frame import Flight, FlightTrack, Footage, FrameRef, FrameStatus
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.ground import HeightField
from photomap_gis.core.measurement import Registration, TiePoints
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import FloatArray, Similarity2D
from photomap_gis.core.tie import ReferenceTies
from photomap_gis.publish import write_file

T = TypeVar("T")

SCHEMA = 1
"""Counts incompatible changes of the folder's layout."""


@dataclass(frozen=True, slots=True)
class MissionHeader:
    """What was asked for, and where the internal map frame lies; ``settings`` are the corridor's, opaque here.

    ``warnings`` are what ingest had to say about the sources.
    """

    sources: tuple[str, ...]
    settings: dict[str, Any]
    map_frame: MapFrame
    created_utc: str
    product: str
    warnings: tuple[str, ...] = ()
    schema: int = SCHEMA


@dataclass(frozen=True, slots=True)
class PreparedFrame:
    """What preparation found: why a frame is not ``usable``, and where its working image lies in its plane.

    ``is_suspect`` tells that a video's decoder lost data since the last key frame: parts may be its guess.
    """

    frame: int
    usable: bool
    reason: str | None = None
    T_plane_work: Similarity2D = field(default_factory=Similarity2D)
    is_suspect: bool = False


@dataclass(frozen=True, slots=True)
class RegistrationRecord:
    """A registration as the journal keeps it, in pixels of the working images; covariance row by row."""

    a: int
    b: int
    kind: EdgeKind
    T_a_b: Similarity2D
    covariance: tuple[float, ...]
    probability: float
    size_b_px: tuple[int, int]
    model_sigma_px: float
    accepted: bool
    method: str
    overlap: float
    correlation: float
    alternatives: tuple[Similarity2D, ...] = ()
    H_a_b: tuple[float, ...] | None = None
    ties: str | None = None

    @classmethod
    def of(cls, r: Registration, kind: EdgeKind) -> RegistrationRecord:
        """Return the record of a registration; the ties of one that was not accepted are of no use."""
        return cls(
            r.a, r.b, kind, r.T_a_b, tuple(float(v) for v in r.covariance.ravel()), float(r.probability), r.size_b_px,
            float(r.model_sigma_px), bool(r.accepted), r.method, float(r.overlap), float(r.correlation), r.alternatives,
            None if r.H_a_b is None else tuple(float(v) for v in r.H_a_b.ravel()),
            _packed(r.ties) if r.ties is not None and r.accepted else None,
        )  # fmt: skip

    @property
    def registration(self) -> Registration:
        """The registration itself."""
        return Registration(
            self.T_a_b, _square(self.covariance), self.probability, self.size_b_px, self.model_sigma_px, self.accepted,
            self.method, self.overlap, self.correlation, self.alternatives, self.a, self.b,
            None if self.H_a_b is None else np.array(self.H_a_b).reshape(3, 3),
            None if self.ties is None else _unpacked(self.ties),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class PosedRecord:
    """A camera in space: centre (x, y, height up) in map units, ``R_map_camera`` row by row, and its lens as found."""

    centre: tuple[float, ...]
    R_map_camera: tuple[float, ...]
    focal_px: float
    k1: float


@dataclass(frozen=True, slots=True)
class GroundRecord:
    """The ground's surface: heights row by row on a lattice of the map frame (see ``HeightField``)."""

    origin_xy: tuple[float, float]
    cell: float
    columns: int
    up: tuple[float, ...]
    sigma: float

    @classmethod
    def of(cls, ground: HeightField) -> GroundRecord:
        """Return the record of a surface."""
        up = tuple(round(float(v), 4) for v in ground.up.ravel())
        return cls(ground.origin_xy, ground.cell, ground.up.shape[1], up, ground.sigma)

    @property
    def height_field(self) -> HeightField:
        """The surface itself."""
        return HeightField(self.origin_xy, self.cell, np.array(self.up).reshape(-1, self.columns), self.sigma)


@dataclass(frozen=True, slots=True)
class LensRecord:
    """What a flight told of its lens; sigmas are of the focal length's logarithm and of k1, as they are now."""

    name: str
    focal_px: float
    focal_before_px: float
    focal_sigma_rel: float
    focal_observed: bool
    k1: float
    k1_before: float
    k1_sigma: float
    k1_observed: bool


@dataclass(frozen=True, slots=True)
class PlacementRecord:
    """A frame's placement in a solution; matrices row by row, ``None`` with the pose where it is not placed."""

    frame: int
    status: FrameStatus
    reason: str = ""
    segment: int | None = None
    method: str = ""
    T_map_plane: Similarity2D | None = None
    covariance: tuple[float, ...] | None = None
    R_level_camera: tuple[float, ...] | None = None
    ground_slope: tuple[float, float] = (0.0, 0.0)
    posed: PosedRecord | None = None

    @property
    def covariance_matrix(self) -> FloatArray:
        """``(4, 4)`` covariance of the pose on the plane, ``(6, 6)`` of one in space."""
        if self.covariance is None:
            raise ValueError(f"frame {self.frame} is not placed")
        return _square(self.covariance)


@dataclass(frozen=True, slots=True)
class SolutionRecord:
    """The newest solution: one placement record a frame, and the numbers of the summary."""

    revision: int
    placements: tuple[PlacementRecord, ...]
    summary: dict[str, Any]
    ground: GroundRecord | None = None
    lenses: tuple[LensRecord, ...] = ()


@dataclass(frozen=True, slots=True)
class ControlRecord:
    """What people say of the map's place: control points of a file, points picked on the map, corrections by hand.

    ``source`` is the file's name as it was given; ``check`` what was said of check points. ``picks`` name their
    pictures by index (``#12``); those named in ``check_picks`` test the map and have no part in its fit.
    """

    points: tuple[ControlPoint, ...] = ()
    source: str = ""
    check: tuple[str, ...] = ()
    picks: tuple[ControlPoint, ...] = ()
    nudges: tuple[Nudge, ...] = ()
    check_picks: tuple[str, ...] = ()


class Journal(Generic[T]):
    """A file of JSON lines that is only ever appended to; a cut last line is dropped when it is opened."""

    def __init__(self, path: Path, kind: type[T]) -> None:
        self._path = path
        self._adapter: TypeAdapter[T] = _adapter(kind)
        self._file: IO[bytes] | None = None

    def __iter__(self) -> Iterator[T]:
        """Yield every whole record; raise ``DataError`` where a line in the middle is damaged."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                if not line.endswith(b"\n"):
                    return  # the line that a killed run was writing
                try:
                    yield self._adapter.validate_json(line)
                except ValidationError as error:
                    raise DataError(
                        f"{self._path}, line {number}, is damaged: delete the mission folder and map again"
                    ) from error

    def extend(self, records: Iterable[T]) -> None:
        """Append records and hand them to the operating system; they outlive the process from here on."""
        lines = b"".join(self._adapter.dump_json(r) + b"\n" for r in records)
        try:
            if self._file is None:
                self._file = self._open_whole()
            self._file.write(lines)
            self._file.flush()
        except OSError as error:
            raise OutputError(f"cannot write {self._path}: {error.strerror}; free or choose another disk") from error

    def replace(self, records: Iterable[T]) -> None:
        """Put other records in the place of all; whole or not at all."""
        self.close()
        write_file(self._path, b"".join(self._adapter.dump_json(r) + b"\n" for r in records))

    def append(self, record: T) -> None:
        """Append one record."""
        self.extend((record,))

    def keep(self, wanted: Callable[[T], bool]) -> None:
        """Leave out the records that are not ``wanted``; the file is replaced whole, and only where that changes it."""
        records = list(self)
        kept = [r for r in records if wanted(r)]
        if len(kept) < len(records):
            self.close()
            write_file(self._path, b"".join(self._adapter.dump_json(r) + b"\n" for r in kept))

    def close(self) -> None:
        """Bring what was appended onto the disk; ``OutputError`` where that is full."""
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            with file:
                os.fsync(file.fileno())
        except OSError as error:
            raise OutputError(f"cannot write {self._path}: {error.strerror}; free or choose another disk") from error

    def _open_whole(self) -> IO[bytes]:
        """Open for appending, cut back to the end of the last whole line."""
        file = self._path.open("ab+")
        file.seek(0, os.SEEK_END)
        end = file.tell()
        while end > 0:
            start = max(0, end - 65536)
            file.seek(start)
            newline = file.read(end - start).rfind(b"\n")
            if newline >= 0:
                end = start + newline + 1
                break
            end = start
        file.truncate(end)
        file.seek(0, os.SEEK_END)
        return file


@dataclass(frozen=True, slots=True)
class MissionPaths:
    """Where a mission keeps its pictures: all that a worker on another machine needs to know of it."""

    folder: Path

    def work_image_path(self, frame: int) -> Path:
        """Where a frame's working image lies."""
        return self.folder / "cache" / "working" / f"{frame:06d}.png"

    def video_frame_path(self, frame: int) -> Path:
        """Where a frame taken out of a video lies."""
        return self.folder / "cache" / "frames" / f"{frame:06d}.jpg"


class Mission:
    """A mission folder and its single writer; use it as a context manager."""

    def __init__(self, folder: Path, header: MissionHeader) -> None:
        self.folder = folder
        self.header = header
        self.flights: Journal[Flight] = Journal(folder / "flights.jsonl", Flight)
        self.tracks: Journal[FlightTrack] = Journal(folder / "tracks.jsonl", FlightTrack)
        self.frames: Journal[FrameRef] = Journal(folder / "frames.jsonl", FrameRef)
        self.prepared: Journal[PreparedFrame] = Journal(folder / "prepared.jsonl", PreparedFrame)
        self.registrations: Journal[RegistrationRecord] = Journal(folder / "registrations.jsonl", RegistrationRecord)

    @classmethod
    def create(cls, folder: Path, header: MissionHeader, footage: Footage) -> Mission:
        """Make a new mission folder, or raise ``UsageError`` where one stands already."""
        if cls.exists(folder):
            raise UsageError(f"{folder} holds a mission already: extend it by --add, or choose another folder by -o")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "cache" / "working").mkdir(parents=True, exist_ok=True)
            (folder / "cache" / "frames").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot write {folder}: {error.strerror}; choose another folder by -o") from error
        mission = cls(folder, header)
        for stale in (
            "flights",
            "tracks",
            "frames",
            "prepared",
            "registrations",
        ):  # of a run killed before it had a header
            (folder / f"{stale}.jsonl").unlink(missing_ok=True)
        mission.add_footage(footage)
        mission.save_header(header)  # last: a folder with a header has its frames
        return mission

    @classmethod
    def open(cls, folder: Path) -> Mission:
        """Open a mission folder; ``DataError`` where there is none or it comes from another version."""
        path = folder / "mission.json"
        if not path.is_file():
            raise DataError(f"{folder} is no mission folder (no mission.json): name one made by 'photomap map'")
        try:
            header = _adapter(MissionHeader).validate_json(path.read_bytes())
        except (ValidationError, OSError) as error:
            raise DataError(f"{path} cannot be read: it is damaged or comes from another version") from error
        if header.schema != SCHEMA:
            raise DataError(f"{folder} has layout {header.schema}, this version reads {SCHEMA}: map again")
        return cls(folder, header)

    @staticmethod
    def exists(folder: Path) -> bool:
        """Whether a folder holds a mission."""
        return (folder / "mission.json").is_file()

    def __enter__(self) -> Mission:
        return self

    def __exit__(self, *_: object) -> None:
        for journal in (self.flights, self.tracks, self.frames, self.prepared, self.registrations):
            journal.close()

    def save_header(self, header: MissionHeader) -> None:
        """Replace ``mission.json``."""
        write_file(self.folder / "mission.json", _adapter(MissionHeader).dump_json(header, indent=1))
        self.header = header

    def add_footage(self, footage: Footage) -> None:
        """Append flights, tracks and frames."""
        self.flights.extend(footage.flights)
        self.tracks.extend(footage.tracks)
        self.frames.extend(footage.frames)

    def save_solution(self, solution: SolutionRecord) -> None:
        """Replace ``solution.json``."""
        write_file(self.folder / "solution.json", _adapter(SolutionRecord).dump_json(solution))

    def load_solution(self) -> SolutionRecord:
        """Return the newest solution; ``DataError`` where the mission was never solved."""
        path = self.folder / "solution.json"
        if not path.is_file():
            raise DataError(f"{self.folder} has no solution yet: run 'photomap map' on its sources again to finish it")
        try:
            return _adapter(SolutionRecord).validate_json(path.read_bytes())
        except (ValidationError, OSError) as error:
            raise DataError(f"{path} is damaged: run 'photomap map' on its sources again") from error

    @property
    def references(self) -> tuple[ReferenceTies, ...]:
        """What is known from existing imagery; empty where none was given. ``DataError`` where it is damaged."""
        path = self.folder / "references.json"
        if not path.is_file():
            return ()
        try:
            return _adapter(tuple[ReferenceTies, ...]).validate_json(path.read_bytes())
        except (ValidationError, OSError) as error:
            raise DataError(f"{path} is damaged: delete it and give --reference again") from error

    def save_references(self, references: Iterable[ReferenceTies]) -> None:
        """Replace ``references.json``."""
        adapter = _adapter(tuple[ReferenceTies, ...])
        write_file(self.folder / "references.json", adapter.dump_json(tuple(references), indent=1))

    def save_control(self, control: ControlRecord, text: str | None = None) -> None:
        """Replace ``control.json``, and with ``text`` the copy of the file that the points were read from."""
        if text is not None:
            write_file(self.folder / "control-points.txt", text.encode())
        write_file(self.folder / "control.json", _adapter(ControlRecord).dump_json(control, indent=1))

    def load_control(self) -> ControlRecord:
        """Return what is known of ground control; nothing where none was given."""
        path = self.folder / "control.json"
        if not path.is_file():
            return ControlRecord()
        try:
            return _adapter(ControlRecord).validate_json(path.read_bytes())
        except (ValidationError, OSError) as error:
            raise DataError(f"{path} is damaged: delete it and give the control points again by --gcp") from error

    @property
    def paths(self) -> MissionPaths:
        """Where its pictures lie, wherever it is opened."""
        return MissionPaths(self.folder.absolute())

    def work_image_path(self, frame: int) -> Path:
        """Where a frame's working image lies."""
        return self.paths.work_image_path(frame)

    def video_frame_path(self, frame: int) -> Path:
        """Where a frame taken out of a video lies."""
        return self.paths.video_frame_path(frame)

    def mosaic_folder(self, segment: int = 0) -> Path:
        """Where a map's tiles lie; segments beyond the first occur in maps without GPS only."""
        return self.folder / ("mosaic" if segment == 0 else f"mosaic-{segment + 1}")


def _adapter(kind: type[T]) -> TypeAdapter[T]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}  # building one takes milliseconds


_TIE = np.dtype([("xy_a", "<f4", 2), ("xy_b", "<f4", 2), ("sigma", "<f2", 2), ("correlation", "<f2"), ("place", "u1")])
"""A tie as the journal packs it: sigmas along x and y and their correlation say what the covariance does."""


MOST_SIGMA_PX = 1e4
"""Wider sigmas would not fit the journal's short numbers, and say nothing anyhow."""


def _packed(ties: TiePoints) -> str:
    """Return tie points as base64: a journal of text would be five times that."""
    table = np.zeros(len(ties), _TIE)
    xx, xy, yy = ties.covariance_a_px2.T
    table["xy_a"], table["xy_b"], table["place"] = ties.xy_a_px, ties.xy_b_px, ties.place
    table["sigma"] = np.minimum(np.sqrt(np.stack([xx, yy], axis=1)), MOST_SIGMA_PX)
    table["correlation"] = xy / np.sqrt(xx * yy)
    return base64.b64encode(table.tobytes()).decode("ascii")


def _unpacked(text: str) -> TiePoints:
    table = np.frombuffer(base64.b64decode(text), _TIE)
    sx, sy = table["sigma"].astype(np.float64).T
    r = np.clip(table["correlation"].astype(np.float64), -0.999, 0.999)
    covariance = np.stack([sx * sx, r * sx * sy, sy * sy], axis=1)
    xy_a, xy_b = table["xy_a"].astype(np.float64), table["xy_b"].astype(np.float64)
    return TiePoints(xy_a, xy_b, covariance, table["place"].astype(np.intp))


def _square(row_by_row: tuple[float, ...]) -> FloatArray:
    side = math.isqrt(len(row_by_row))
    return np.array(row_by_row, dtype=np.float64).reshape(side, side)
