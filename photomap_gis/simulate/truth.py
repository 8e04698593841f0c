"""What is true of a simulated flight, apart from what its files say: written beside them, read by the evaluation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError, OutputError
from photomap_gis.core.frame import GpsFix
from photomap_gis.core.similarity import FloatArray
from photomap_gis.simulate.breakage import Breakage
from photomap_gis.simulate.ground import Ground, read_ground, write_ground
from photomap_gis.simulate.pose import CameraPose

TRUTH_FILE = "truth.json"
GROUND_FILE = "ground.tif"
HEIGHT_FILE = "height.tif"


@dataclass(frozen=True, slots=True, eq=False)
class TrueFrame:
    """A frame as it truly was: pose of its middle row, ground height under it, footprint ``(N, 2)`` easting, northing.

    ``fix`` is what its file reports, ``None`` in a dropout. ``breakage`` says how it was spoilt, ``None`` where whole.
    """

    index: int
    name: str
    time_s: float
    pose: CameraPose
    ground_height_m: float
    footprint_en_m: FloatArray
    fix: GpsFix | None
    breakage: Breakage | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """A simulated flight's truth; the ground itself lies in ``folder`` and is read by ``ground``."""

    folder: Path
    crs_wkt: str
    camera: Camera
    frames: tuple[TrueFrame, ...]
    spec: Mapping[str, Any]

    @property
    def gsd_m_per_px(self) -> float:
        """Median native ground sampling of the whole frames, at the image centre's depth."""
        focal = self.camera.focal_px or 1.0
        return float(np.median([(f.pose.height_m - f.ground_height_m) / focal for f in self.frames]))

    def ground(self) -> Ground:
        """Read the true ground."""
        return read_ground(self.folder / GROUND_FILE, self.folder / HEIGHT_FILE)


def write_truth(truth: Truth, ground: Ground) -> None:
    """Write ground and poses into ``truth.folder``."""
    try:
        truth.folder.mkdir(parents=True, exist_ok=True)
        write_ground(ground, truth.folder / GROUND_FILE, truth.folder / HEIGHT_FILE)
        document = {
            "version": 1,
            "crs_wkt": truth.crs_wkt,
            "ground": GROUND_FILE,
            "height": HEIGHT_FILE if ground.height_m is not None else None,
            "axes": "R_grid_camera takes camera axes (x right, y down, z optical axis) into grid north, east, down; "
            "height_m is in the heights of the ground raster",
            "gsd_m_per_px": truth.gsd_m_per_px,
            "camera": asdict(truth.camera),
            "spec": dict(truth.spec),
            "frames": [_frame_document(f) for f in truth.frames],
        }
        part = truth.folder / (TRUTH_FILE + ".part")
        part.write_text(json.dumps(document, indent=1), encoding="utf-8")
        part.replace(truth.folder / TRUTH_FILE)
    except OSError as error:
        raise OutputError(f"cannot write the truth to {truth.folder}: {error.strerror or error}") from error


def read_truth(folder: Path | str) -> Truth:
    """Read what ``write_truth`` wrote, from a simulation's folder or its ``truth`` folder; ``DataError`` if none."""
    folder = Path(folder)
    if not (folder / TRUTH_FILE).is_file() and (folder / "truth" / TRUTH_FILE).is_file():
        folder = folder / "truth"
    try:
        document = json.loads((folder / TRUTH_FILE).read_text(encoding="utf-8"))
        return Truth(
            folder,
            document["crs_wkt"],
            Camera(**document["camera"]),
            tuple(_frame_of(d) for d in document["frames"]),
            document["spec"],
        )
    except FileNotFoundError as error:
        raise DataError(f"no {TRUTH_FILE} in {folder}: give the folder that 'photomap simulate' wrote") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"cannot read {folder / TRUTH_FILE}: {error}") from error


def _frame_document(frame: TrueFrame) -> dict[str, Any]:
    pose = frame.pose
    return {
        "index": frame.index,
        "name": frame.name,
        "time_s": frame.time_s,
        "easting_m": pose.easting_m,
        "northing_m": pose.northing_m,
        "height_m": pose.height_m,
        "ground_height_m": frame.ground_height_m,
        "R_grid_camera": np.asarray(pose.R_grid_camera).tolist(),
        "footprint_en_m": np.round(frame.footprint_en_m, 3).tolist(),
        "fix": None if frame.fix is None else asdict(frame.fix),
        "breakage": frame.breakage,
    }


def _frame_of(d: Mapping[str, Any]) -> TrueFrame:
    return TrueFrame(
        d["index"],
        d["name"],
        d["time_s"],
        CameraPose(d["easting_m"], d["northing_m"], d["height_m"], np.array(d["R_grid_camera"], dtype=np.float64)),
        d["ground_height_m"],
        np.array(d["footprint_en_m"], dtype=np.float64).reshape(-1, 2),
        None if d["fix"] is None else GpsFix(**d["fix"]),
        None if d["breakage"] is None else Breakage(d["breakage"]),
    )
