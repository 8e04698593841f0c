"""The summary of sources as a value, and in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple


class Range(NamedTuple):
    """The smallest, the middle and the largest of some values."""

    low: float
    median: float
    high: float


class Bounds(NamedTuple):
    """A box in WGS84 degrees."""

    west_deg: float
    south_deg: float
    east_deg: float
    north_deg: float


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """A camera, what is known of its lens and from where, and how many frames it took."""

    name: str
    frames: int
    width_px: int
    height_px: int
    focal_px: float | None
    hfov_deg: float | None
    focal_sigma_percent: float | None
    origin: str


@dataclass(frozen=True, slots=True)
class FlightInfo:
    """One flight: its frames, its time, its way; ``None`` where nothing is known.

    ``interval_s`` and ``spacing_m`` are the medians between consecutive frames, ``overlap`` the part of a frame that
    the next one sees again (estimated from fixes, height and lens).
    """

    id: int
    name: str
    kind: str
    camera: str
    frames: int
    track_source: str | None
    start_utc_s: float | None
    duration_s: float | None
    interval_s: float | None
    fixes: int
    length_m: float | None
    speed_m_s: float | None
    spacing_m: float | None
    height_m: Range | None
    overlap: float | None


@dataclass(frozen=True, slots=True)
class SourceInfo:
    """What the sources hold. Angles in degrees; ``gsd_m_per_px`` is expected from heights and lens."""

    frames: int
    photos: int
    video_frames: int
    usable: int
    sizes_px: tuple[tuple[int, int], ...]
    cameras: tuple[CameraInfo, ...]
    flights: tuple[FlightInfo, ...]
    fixes: int
    attitudes: int
    bounds: Bounds | None
    height_m: Range | None
    off_nadir_deg: Range | None
    oblique: int
    gsd_m_per_px: float | None
    problems: tuple[str, ...]

    def __str__(self) -> str:
        return "\n".join(_lines(self))

    def as_dict(self) -> dict[str, Any]:
        """Return the summary as plain values for JSON."""
        plain = asdict(self)
        plain["bounds"] = self.bounds._asdict() if self.bounds else None
        for holder, source in ((plain, self), *zip(plain["flights"], self.flights, strict=True)):
            for name in ("height_m", "off_nadir_deg"):
                if name in holder:
                    value = getattr(source, name)
                    holder[name] = value._asdict() if value else None
        return plain


def _lines(info: SourceInfo) -> Iterator[str]:
    """Yield the summary's lines, a word and what is known of it; what is not known is left out."""
    kinds = [f"{n} {word}" for n, word in ((info.photos, "photos"), (info.video_frames, "frames of video")) if n]
    unreadable = f", {info.frames - info.usable} unreadable" if info.usable < info.frames else ""
    yield f"{'frames':<12}{' and '.join(kinds) or 'none'}{unreadable}"
    yield f"{'size':<12}{', '.join(f'{w} x {h}' for w, h in info.sizes_px[:4])} pixels"
    for camera in info.cameras[:6]:
        yield f"{'camera':<12}{camera.name}: {_lens(camera)} ({camera.frames} frames)"
    for flight in info.flights:
        yield f"{'flight':<12}{flight.name}: {', '.join(_flight_words(flight))}"
    positions = f"{info.fixes} of {info.frames} frames" if info.fixes else "none"
    yield f"{'positions':<12}{positions}"
    if info.bounds is not None:
        b = info.bounds
        yield f"{'bounds':<12}{b.south_deg:.5f} to {b.north_deg:.5f} N, {b.west_deg:.5f} to {b.east_deg:.5f} E"
    if info.height_m is not None:
        yield f"{'height':<12}{_span(info.height_m)} m above take-off or ground"
    if info.off_nadir_deg is not None:
        oblique = f", {info.oblique} oblique" if info.oblique else ""
        yield f"{'off nadir':<12}{_span(info.off_nadir_deg)}° ({info.attitudes} attitudes{oblique})"
    if info.gsd_m_per_px is not None:
        yield f"{'pixel':<12}{100.0 * info.gsd_m_per_px:.1f} cm on the ground, expected"
    for problem in info.problems:
        yield f"{'note':<12}{problem}"


def _lens(camera: CameraInfo) -> str:
    if camera.hfov_deg is None:
        return "lens unknown"
    sigma = f" ± {camera.focal_sigma_percent:.1f} %" if camera.focal_sigma_percent is not None else ""
    return f"{camera.hfov_deg:.1f}° across the width{sigma}, from {camera.origin}"


def _flight_words(flight: FlightInfo) -> Iterator[str]:
    yield f"{flight.frames} {'photos' if flight.kind == 'photos' else 'frames'}"
    if flight.start_utc_s is not None:
        yield datetime.fromtimestamp(flight.start_utc_s, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    if flight.duration_s is not None:
        every = f", one every {flight.interval_s:.1f} s" if flight.interval_s is not None else ""
        yield f"{flight.duration_s:.0f} s{every}"
    if flight.length_m is not None:
        speed = f" at {flight.speed_m_s:.1f} m/s" if flight.speed_m_s is not None else ""
        yield f"{flight.length_m:.0f} m{speed}"
    if flight.overlap is not None:
        yield f"neighbours overlap by {100.0 * flight.overlap:.0f} %"
    if flight.track_source is not None:
        yield f"track {flight.track_source}"


def _span(span: Range) -> str:
    return f"{span.low:.0f} to {span.high:.0f} (middle {span.median:.0f})"
