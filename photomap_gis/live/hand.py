"""What is done with a key frame behind the loop's back: kept, told to the graph, pasted, shown; in this order.

One owner works it: a thread of its own in real time, the loop itself where time does not matter. Commands are numbered,
and the render journal says between which of them tiles were drawn anew.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from photomap_gis.core.errors import FrameReadError, OutputError, PhotomapError
from photomap_gis.core.frame import Frame, FrameRef, ImageArray
from photomap_gis.core.grid import TileIndex, ground_per_unit
from photomap_gis.core.live import Picture
from photomap_gis.core.placement import FramePlacement
from photomap_gis.core.similarity import FloatArray
from photomap_gis.ingest import read_frame
from photomap_gis.live.canvas import LiveCanvas
from photomap_gis.live.chart import Chart
from photomap_gis.live.flush import CanvasFolder, write_quickly
from photomap_gis.live.graph import KeyNews
from photomap_gis.live.graph_desk import GraphDesk
from photomap_gis.live.journal import LineLog
from photomap_gis.live.lattice import LiveLattice
from photomap_gis.live.light import Light
from photomap_gis.live.look import Look
from photomap_gis.live.painter import Painter, Redrawn
from photomap_gis.live.steps import NewKey, Tie
from photomap_gis.store import Mission, MissionPaths

logger = logging.getLogger(__name__)

JPEG_QUALITY = 95
LITTLE_PX = 0.25
"""Key frames that a solution moves by less keep the placement that they were drawn by."""


@dataclass(frozen=True, slots=True, eq=False)
class Lay:
    """Begin a canvas on a lattice."""

    lattice: LiveLattice
    epoch: str


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """Take a key frame: keep it, tell the graph, paste it (unless it looks too far off the plumb line)."""

    key: NewKey
    picture: Picture
    placement: FramePlacement
    paste: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Again:
    """Paste a key frame that is kept (on a new canvas)."""

    key: int
    time_s: float
    placement: FramePlacement


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """Take the placements of a chart over, for all of its key frames or some."""

    chart: Chart
    revision: int
    keys: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """Tell the graph that a segment was recognised."""

    tie: Tie


Command = Lay | Take | Again | Look | Move | Told


class KeptPixels:
    """Reads key frames' rasters: from the mission where they are kept, else from the photo itself."""

    def __init__(self, paths: MissionPaths, ref_of: Callable[[int], FrameRef]) -> None:
        self._paths, self._ref_of = paths, ref_of
        self.renamed: dict[str, str] = {}
        """Photos that have another name by now."""
        self._read = lru_cache(maxsize=4)(self._read_now)

    def __call__(self, key: int) -> ImageArray:
        """Return ``(h, w, 3)`` BGR; ``FrameReadError`` where it is gone."""
        return self._read(key)

    def grey(self, key: int) -> ImageArray:
        """Return ``(h, w)``."""
        image = self._read_now(key)
        return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)

    def _read_now(self, key: int) -> ImageArray:
        ref = self._ref_of(key)
        path = self._paths.video_frame_path(key)
        if path.is_file():
            image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_COLOR)
            if image is not None:
                return np.asarray(image, np.uint8)
        if ref.frame_number is not None:
            raise FrameReadError(f"{path} is missing or damaged")
        return read_frame(replace(ref, source=self.renamed.get(ref.source, ref.source))).image


class Hand:
    """Carries commands out in their order; ``idle`` does a little of what can wait."""

    def __init__(
        self,
        mission: Mission,
        graph: GraphDesk | None,
        pixels: KeptPixels,
        log: LineLog,
        on_tiles: Callable[[], None] = lambda: None,
        on_moved: Callable[[int, float], None] = lambda revision, px: None,
        on_canvas: Callable[[LiveCanvas, str], None] = lambda canvas, epoch: None,
    ) -> None:
        self._mission, self._graph, self._pixels, self._log = mission, graph, pixels, log
        self._on_tiles, self._on_moved, self._on_canvas = on_tiles, on_moved, on_canvas
        self._done = 0
        self._revision = 0
        self._rows: FloatArray = np.zeros((0, 4))
        self._map_px = 1.0
        self._light = Light()
        self.painter: Painter | None = None
        self._folder: CanvasFolder | None = None
        self.pasted = self.looks = 0
        self.is_cut = False
        """The disk takes no more key frames: they are shown, but the mission ends before the first that is missing."""

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be drawn anew."""
        return self.painter is None or self.painter.is_idle

    def do(self, command: Command) -> None:
        """Carry out the next command."""
        self._done += 1
        match command:
            case Lay():
                self._lay(command)
            case Take():
                self._take(command)
            case Again():
                if self.painter is not None:
                    self.painter.paste(command.key, command.placement, None, command.time_s)
                    self._on_tiles()
            case Look():
                self._look(command)
            case Move():
                self._revision = command.revision
                if self.painter is not None and not self.is_cut:
                    keys = self._moved_keys(command.chart) if command.keys is None else command.keys
                    chart = command.chart
                    self._on_moved(command.revision, self.painter.adopt(chart.placement, keys, len(chart)))
            case Told():
                if self._graph is not None:
                    self._graph.tell(command.tie)

    def idle(self) -> bool:
        """Draw a little of what a solution has moved; return whether more is left."""
        if self.painter is None or self.painter.is_idle:
            return False
        left = self.painter.step()
        self._on_tiles()
        return left or not self.painter.is_idle

    def redraw(self, tiles: tuple[tuple[int, int], ...], keys: tuple[int, ...]) -> None:
        """Draw tiles anew as a journal says."""
        if self.painter is not None:
            self.painter.redraw([TileIndex(*t) for t in tiles], keys)

    def flush(self) -> None:
        """Write the map's tiles that have changed."""
        if self._folder is not None:
            self._folder.flush(self._revision)

    @property
    def done(self) -> int:
        """How many commands were carried out."""
        return self._done

    def _moved_keys(self, chart: Chart) -> Sequence[int]:
        """Return the key frames that a solution moves by more than a little, and those that only hang on it.

        Told by its numbers alone: an hour's flight has ten thousand of them, and few are moved.
        """
        solution = chart.solution
        if solution is None or self.painter is None:
            return range(len(chart))
        n = min(len(solution), len(chart))
        if len(self._rows) < n:
            self._rows = np.concatenate([self._rows, np.full((n - len(self._rows), 4), np.nan)])
        old, new = self._rows[:n], solution.drawn[:n]
        reach = np.exp(new[:, 3]) * max(chart.refs[0].width_px, chart.refs[0].height_px)
        d = np.abs(new - old)
        moved = ~(d[:, 0] + d[:, 1] + reach * (d[:, 2] + d[:, 3]) < LITTLE_PX * self._map_px)
        old[moved] = new[moved]
        return [*np.flatnonzero(moved).tolist(), *range(n, len(chart))]

    def _lay(self, command: Lay) -> None:
        planes = self._mission.folder / "cache" / "live" / command.epoch
        canvas = LiveCanvas(command.lattice, planes)
        self._folder = CanvasFolder(self._mission.mosaic_folder(), canvas, f"live-{command.epoch}")
        self.painter = Painter(canvas, self._pixels, self._redrawn, self._light)
        self._rows = np.zeros((0, 4))
        middle = canvas.lattice.grid.to_crs([[0.0, 0.0]])[0]
        self._map_px = canvas.lattice.grid.pixel_size * ground_per_unit(middle, canvas.lattice.frame)
        self._on_canvas(canvas, command.epoch)

    def _take(self, command: Take) -> None:
        key = command.key
        ref = key.ref
        image = command.picture.bgr
        try:
            if self.is_cut:
                return  # pasted all the same
            if ref.frame_number is not None:
                self._keep(Frame(ref, image))
            self._mission.frames.append(ref)
            if self._graph is not None:
                self._graph.tell(KeyNews(ref, key.grey, key.belief.T_map_plane, key.tie))
        except PhotomapError as error:
            logger.warning("%s", error)
            self.is_cut = True
            raise
        finally:
            if self.painter is not None and command.paste:
                self.painter.paste(ref.index, command.placement, image, key.stream_time_s)
                self.pasted += 1
                self._on_tiles()

    def _look(self, command: Look) -> None:
        if self.painter is None or command.witness.is_spoilt():
            return
        self.painter.look(command.key, command.placement, command.picture.bgr, command.time_s)
        self.looks += 1
        self._on_tiles()

    def _keep(self, frame: Frame) -> None:
        ok, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if not ok:
            raise OutputError(f"cannot encode frame {frame.ref.name}")
        write_quickly(self._mission.video_frame_path(frame.ref.index), jpeg.tobytes())

    def _redrawn(self, what: Redrawn) -> None:
        self._log.write("redraw", after=self._done, tiles=[list(t) for t in what.tiles], keys=list(what.keys))


def canvas_digest(canvas: LiveCanvas) -> str:
    """Return the SHA-256 of all pixels of a canvas and of which key frame each shows."""
    digest = hashlib.sha256()
    for tile in canvas.tiles():
        window = canvas.window_of(tile)
        digest.update(f"{tile.row},{tile.col};".encode())
        digest.update(np.ascontiguousarray(canvas.read(window, lambda p: p.rgba(), 0)).tobytes())
        digest.update(np.ascontiguousarray(canvas.read(window, lambda p: p.shown, -1)).tobytes())
    return digest.hexdigest()
