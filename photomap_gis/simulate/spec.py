"""What a simulated flight is asked to be: frozen configurations with defaults of an ordinary small drone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import UsageError


@dataclass(frozen=True, slots=True)
class GpsError:
    """How positions lie: white noise, a Gauss-Markov walk, a constant bias (all metres per axis), dropouts.

    ``dropout_share`` of the frames carry no fix, in runs of ``dropout_run`` frames. ``rate_hz`` is how often the
    receiver gives a new position (it repeats in between); ``None``: with every frame.
    """

    white_sigma_m: float = 0.2
    walk_sigma_m: float = 2.0
    walk_tau_s: float = 60.0
    bias_east_m: float = 0.0
    bias_north_m: float = 0.0
    dropout_share: float = 0.0
    dropout_run: int = 4
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True)
class Motion:
    """How unsteadily the drone flies; sigmas.

    ``tilt_deg`` is that of roll and of pitch, 30 % of its variance white from frame to frame, the rest a sway of
    ``tilt_tau_s``; ``lean_deg`` is how far the camera always looks ahead of the plumb line. ``height_sigma_m`` and
    ``wander_sigma_m`` are slow changes of height and sideways place.
    """

    tilt_deg: float = 0.0
    tilt_tau_s: float = 1.5
    yaw_deg: float = 0.5
    height_sigma_m: float = 0.6
    wander_sigma_m: float = 0.6
    slow_tau_s: float = 25.0
    lean_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Imaging:
    """What happens between light and file.

    ``exposure_drift`` is the sigma of the logarithm of the gain; ``vignetting`` the loss at the corners; ``noise`` in
    grey levels; ``exposure_ms`` smears moving ground; ``error_share`` of the frames are broken.
    """

    exposure_drift: float = 0.06
    vignetting: float = 0.25
    noise: float = 2.0
    exposure_ms: float = 1.0
    rolling_shutter_ms: float = 0.0
    thermal: bool = False
    error_share: float = 0.0
    jpeg_quality: int = 92


@dataclass(frozen=True, slots=True)
class FlightSpec:
    """One flight over a ground: a lawnmower pattern, the camera, and everything that goes a little wrong.

    ``altitude_m`` above the land under the pattern; ``None`` chooses the height at which the frames just fill the
    ground. ``headings_deg`` are the strips' directions from grid north: more than one flies the pattern again, turned.
    ``nose_follows_track`` turns the drone at each strip's end; otherwise it flies backwards and sideways.
    ``video_rate_hz`` and ``speed_m_s`` rule a video's overlap, ``front_overlap`` that of photos.
    """

    frames: int = 80
    altitude_m: float | None = None
    hfov_deg: float = math.degrees(2.0 * math.atan(0.75))
    width_px: int = 1600
    height_px: int = 1200
    k1: float = 0.0
    k2: float = 0.0
    front_overlap: float = 0.75
    side_overlap: float = 0.65
    speed_m_s: float = 6.0
    headings_deg: tuple[float, ...] = (0.0,)
    nose_follows_track: bool = True
    video_rate_hz: float = 5.0
    bitrate_bit_s: int = 4_000_000
    report_attitude: bool = True
    attitude_sigma_deg: float = 0.0
    report_height: bool = True
    barometer_sigma_m: float = 0.3
    report_calibration: bool = True
    start_unix_s: float = 1_781_517_600.0
    motion: Motion = field(default_factory=Motion)
    gps: GpsError = field(default_factory=GpsError)
    imaging: Imaging = field(default_factory=Imaging)
    seed: int = 0

    def __post_init__(self) -> None:
        checks = (
            (self.frames >= 1, "frames must be at least 1"),
            (16 <= self.width_px <= 20000 and 16 <= self.height_px <= 20000, "the frame must be 16-20000 pixels wide"),
            (5.0 <= self.hfov_deg <= 150.0, "the field of view must lie within 5-150 degrees"),
            (self.altitude_m is None or 1.0 <= self.altitude_m <= 10_000.0, "the altitude must lie within 1-10000 m"),
            (0.0 <= self.front_overlap <= 0.98, "the front overlap must lie within 0-0.98"),
            (0.0 <= self.side_overlap <= 0.98, "the side overlap must lie within 0-0.98"),
            (0.1 <= self.speed_m_s <= 100.0, "the speed must lie within 0.1-100 m/s"),
            (0.1 <= self.video_rate_hz <= 120.0, "the video's rate must lie within 0.1-120 Hz"),
            (len(self.headings_deg) >= 1, "at least one heading is needed"),
            (0.0 <= self.motion.tilt_deg <= 20.0, "the jitter must lie within 0-20 degrees"),
            (abs(self.motion.lean_deg) <= 40.0, "the lean must lie within 40 degrees"),
            (0.0 <= self.imaging.error_share < 1.0, "the share of error frames must lie within 0-1"),
            (0.0 <= self.gps.dropout_share < 1.0, "the share of dropouts must lie within 0-1"),
        )
        for good, words in checks:
            if not good:
                raise UsageError(f"simulate: {words}")

    @property
    def camera(self) -> Camera:
        """The true camera."""
        ideal = Camera.of_hfov(self.width_px, self.height_px, math.radians(self.hfov_deg))
        return Camera(
            self.width_px, self.height_px, ideal.focal_px, k1=self.k1, k2=self.k2,
            name="photomap simulated", origin="simulation", focal_sigma_rel=0.0,
        )  # fmt: skip

    @property
    def focal_35mm(self) -> float:
        """The 35 mm equivalent of the focal length: CIPA DC-008 compares diagonals, of the sensor.

        A frame wider than 3:2 is taken for the full width of a 3:2 sensor, as drones crop their videos.
        """
        sensor_height = max(self.height_px, self.width_px / 1.5)
        return (self.camera.focal_px or 1.0) * math.hypot(36.0, 24.0) / math.hypot(self.width_px, sensor_height)
