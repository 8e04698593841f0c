"""What is known of a frame before anyone looks at its pixels, and the frame with them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from photomap_gis.core.camera import Camera
from photomap_gis.core.similarity import FloatArray

ImageArray = npt.NDArray[np.uint8]


class FrameStatus(StrEnum):
    """What became of a frame."""

    REGISTERED = "registered"
    GPS_ONLY = "gps_only"
    OBLIQUE = "oblique"
    ERROR_FRAME = "error_frame"
    UNPLACED = "unplaced"


@dataclass(frozen=True, slots=True)
class GpsFix:
    """A position in WGS84 degrees.

    ``sigma_m`` is the reported or implied (quantisation) horizontal one-sigma per axis, ``None`` where nothing is
    known and the solver's default holds. ``alt_m`` is as reported: its datum is uncertain and it is **never** a height
    above ground.
    """

    lat_deg: float
    lon_deg: float
    alt_m: float | None = None
    sigma_m: float | None = None

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0):
            raise ValueError(f"lat/lon must lie within ±90/±180 degrees, got {self.lat_deg}, {self.lon_deg}")


@dataclass(frozen=True, slots=True)
class Attitude:
    """How the **camera** stands: gimbal angles, yaw then pitch then roll, in north-east-down axes.

    ``pitch_rad`` is -pi/2 where the camera looks straight down; ``yaw_rad`` is then the heading (clockwise from true
    north) of the image's upper edge. Camera axes at zero: optical axis north, image right east, image down down.
    """

    yaw_rad: float
    pitch_rad: float
    roll_rad: float = 0.0
    sigma_yaw_rad: float = math.radians(8.0)
    sigma_tilt_rad: float = math.radians(1.0)

    @classmethod
    def of_body_camera(
        cls,
        *,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
        sigma_yaw_rad: float = math.radians(8.0),
        sigma_tilt_rad: float = math.radians(1.5),
    ) -> Attitude:
        """Return the attitude of a camera under a vehicle's belly, image top to the nose, from the vehicle's angles."""
        # Keep the body's rotation and look down in body axes: R_ned_body @ Ry(-90 deg), read as yaw-pitch-roll again.
        r = _ned_from_euler(yaw_rad, pitch_rad, roll_rad) @ _ned_from_euler(0.0, -math.pi / 2, 0.0)
        pitch = -math.asin(max(-1.0, min(1.0, float(r[2, 0]))))
        if math.hypot(float(r[0, 0]), float(r[1, 0])) < 1e-9:  # gimbal lock: all the turn is yaw
            return cls(math.atan2(-float(r[0, 1]), float(r[1, 1])), pitch, 0.0, sigma_yaw_rad, sigma_tilt_rad)
        return cls(
            math.atan2(float(r[1, 0]), float(r[0, 0])),
            pitch,
            math.atan2(float(r[2, 1]), float(r[2, 2])),
            sigma_yaw_rad,
            sigma_tilt_rad,
        )

    @property
    def R_ned_camera(self) -> FloatArray:
        """``(3, 3)``: takes camera axes (x image right, y image down, z optical axis) into north, east, down."""
        gimbal_from_camera = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        return _ned_from_euler(self.yaw_rad, self.pitch_rad, self.roll_rad) @ gimbal_from_camera

    @property
    def off_nadir_rad(self) -> float:
        """The angle between the optical axis and straight down."""
        return math.acos(max(-1.0, min(1.0, float(self.R_ned_camera[2, 2]))))

    @property
    def heading_rad(self) -> float:
        """Heading of the image's upper edge, after the optical axis is brought to nadir by the shortest turn."""
        level = self.R_ned_camera @ level_rotation(self.R_ned_camera).T
        up = level @ np.array([0.0, -1.0, 0.0])
        return math.atan2(float(up[1]), float(up[0]))


def level_rotation(R_ned_camera: FloatArray) -> FloatArray:
    """``(3, 3)`` ``R_level_camera``: the shortest rotation that brings the plumb line to the optical axis.

    A ray d in camera axes is ``R_level_camera @ d`` for a camera that looks straight down from the same place; the
    image's turn about the vertical (its heading) stays in the image.
    """
    down = R_ned_camera.T @ np.array([0.0, 0.0, 1.0])
    z = np.array([0.0, 0.0, 1.0])
    v = np.cross(down, z)
    c = float(down @ z)
    if c < -1.0 + 1e-9:
        raise ValueError("a camera that looks straight up cannot be levelled")
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + k + k @ k / (1.0 + c)


@dataclass(frozen=True, slots=True)
class FrameRef:
    """One input frame, without its pixels: light, picklable, unique by ``index`` within a mission.

    ``source`` is the photo's or the video's path; ``frame_number`` and ``pts_s`` are set for frames of a video only.
    ``time_s`` is UTC in Unix seconds, or ``None``. ``width_px`` and ``height_px`` are those of the stored raster (EXIF
    orientation is **not** applied), 0 where unreadable. ``height_m`` is the reported height above take-off or ground.
    ``problem`` says why the pixels cannot be used, ``None`` where they can.
    """

    index: int
    name: str
    source: str
    width_px: int
    height_px: int
    flight: int = 0
    frame_number: int | None = None
    pts_s: float | None = None
    time_s: float | None = None
    fix: GpsFix | None = None
    attitude: Attitude | None = None
    height_m: float | None = None
    camera: Camera | None = None
    problem: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A frame with its pixels: ``image`` is ``(H, W, 3)`` BGR or ``(H, W)`` grey, uint8, read-only.

    ``is_suspect`` tells that a video's decoder lost data since the last key frame: parts may be its guess.
    """

    ref: FrameRef
    image: ImageArray
    is_suspect: bool = False

    def __post_init__(self) -> None:
        if self.image.dtype != np.uint8 or self.image.ndim not in (2, 3):
            raise ValueError(f"image must be uint8 (H, W) or (H, W, 3), got {self.image.dtype} {self.image.shape}")
        view = self.image.view()
        view.setflags(write=False)
        object.__setattr__(self, "image", view)


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight: its frames share a clock, a GPS receiver (one bias) and a camera.

    ``track_offset_s`` is what was added to the track's clock to reach the camera's.
    """

    id: int
    name: str
    camera_name: str
    kind: str = "photos"
    track_source: str | None = None
    track_offset_s: float = 0.0


@dataclass(frozen=True, slots=True)
class TrackFix:
    """One record of a track: where the camera was, by its frames' clock (``FrameRef.time_s``, else ``pts_s``)."""

    time_s: float
    fix: GpsFix
    height_m: float | None = None
    attitude: Attitude | None = None


@dataclass(frozen=True, slots=True)
class FlightTrack:
    """The track of one flight, kept so that its frames can be given their places anew when clocks prove apart."""

    flight: int
    points: tuple[TrackFix, ...]


@dataclass(frozen=True, slots=True)
class Footage:
    """What ingest found: every frame in order of flight and time, and what the user should know about it."""

    frames: tuple[FrameRef, ...]
    flights: tuple[Flight, ...]
    warnings: tuple[str, ...] = field(default=())
    tracks: tuple[FlightTrack, ...] = field(default=())


def _ned_from_euler(yaw: float, pitch: float, roll: float) -> FloatArray:
    """``Rz(yaw) @ Ry(pitch) @ Rx(roll)``, the aerospace order."""
    cy, sy, cp, sp, cr, sr = (f(v) for v in (yaw, pitch, roll) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
