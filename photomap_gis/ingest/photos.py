"""Photos to footage: read every header, choose the camera, set the clock, part the flights, judge the fixes."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import DataError
from photomap_gis.core.frame import Flight, Footage, FrameRef
from photomap_gis.ingest.options import IngestOptions
from photomap_gis.ingest.photo_cameras import CameraGroup, choose_cameras, group_by_camera, override_lens
from photomap_gis.ingest.photo_clock import read_clock
from photomap_gis.ingest.photo_fixes import judge_fixes, read_fix, says_one_place
from photomap_gis.ingest.photo_flights import Shot, natural_key, split_flights
from photomap_gis.ingest.profiles import CameraRole
from photomap_gis.ingest.stills import Still, read_still
from photomap_gis.parallel import map_jobs

logger = logging.getLogger(__name__)

_SAYS_NOTHING = re.compile(r"images?|photos?|pictures|dcim|\d{3}\w{0,6}|rgb|jpe?g", re.IGNORECASE)
_NAMED = 5  # how many photos a warning names before it counts the rest


def photo_footage(
    paths: Sequence[Path], options: IngestOptions, *, on_progress: Callable[[int, int], None] | None = None
) -> Footage:
    """Return the footage of photo files: indices and flights from 0, ordered by flight, then time, then name.

    Unreadable photos keep their place with a ``problem``. Raises ``DataError`` where no photo can be used.
    """
    stills = list(map_jobs(read_still, list(paths), on_progress=on_progress))
    warnings: list[str] = []
    maps = [s for s in stills if s.is_map]
    if maps:
        warnings.append(f"left out, they are maps (GeoTIFF) and no photos: {_names(maps)}")
        stills = [s for s in stills if not s.is_map]
    good = [s for s in stills if s.problem is None]
    bad = [s for s in stills if s.problem is not None]
    if not good:
        why = f"{bad[0].path.name}: {bad[0].problem}" if bad else _names(maps)
        raise DataError(f"none of the {len(paths)} photos can be used ({why}): check the files")
    warnings += [f"{s.path.name}: {s.problem}" for s in bad[:_NAMED]]
    if len(bad) > _NAMED:
        warnings.append(f"{len(bad) - _NAMED} more photos are unreadable, too")
    groups, left_out = choose_cameras(group_by_camera(good), options.lens)
    frames, flights = _frames([override_lens(g, options) for g in groups], bad, warnings)
    return Footage(tuple(frames), tuple(flights), tuple(warnings + left_out))


def _names(stills: Sequence[Still]) -> str:
    names = ", ".join(s.path.name for s in stills[:_NAMED])
    return names + (f" and {len(stills) - _NAMED} more" if len(stills) > _NAMED else "")


def _frames(
    groups: Sequence[CameraGroup], bad: Sequence[Still], warnings: list[str]
) -> tuple[list[FrameRef], list[Flight]]:
    """Lay the chosen groups out as flights; unreadable photos go to the flight of their folder."""
    found: list[tuple[list[tuple[Still, Camera | None, float | None]], str]] = []
    homeless = list(bad)
    for group in groups:
        for body in _bodies(group):
            here = [s for s in homeless if any(s.path.parent == g.path.parent for g, _ in body) and _could_be(s, group)]
            homeless = [s for s in homeless if s not in here]
            members: list[tuple[Still, Camera | None]] = sorted(
                [*body, *((s, None) for s in here)], key=lambda pair: natural_key(pair[0].path)
            )
            clock = read_clock([s for s, _ in members])
            warnings += [w for w in clock.warnings if w not in warnings]
            shots = [Shot(i, s.path, t) for i, ((s, _), t) in enumerate(zip(members, clock.times_s, strict=True))]
            found += [
                ([(*members[shot.at], shot.time_s) for shot in flight], group.name) for flight in split_flights(shots)
            ]
    if found:
        found[0][0].extend((s, None, None) for s in homeless if s.role is CameraRole.VISIBLE)
    found.sort(key=lambda f: min((t for _, _, t in f[0] if t is not None), default=float("inf")))
    names = _unique_names([s.path for flight, _ in found for s, _, _ in flight])
    frames: list[FrameRef] = []
    flights: list[Flight] = []
    for flight, camera_name in found:
        flights.append(Flight(len(flights), _folder_name(flight[0][0].path.parent), camera_name))
        frames += _flight_frames(flight, names, warnings, first_index=len(frames), number=flights[-1].id)
    return frames, _name_apart(flights)


def _folder_name(folder: Path) -> str:
    """Name a flight by its folder; one that says nothing (images, 100MEDIA) with the folder above it."""
    if _SAYS_NOTHING.fullmatch(folder.name) and folder.parent.name:
        return f"{folder.parent.name}/{folder.name}"
    return folder.name or "photos"


def _could_be(unreadable: Still, group: CameraGroup) -> bool:
    """Whether a photo that only its name tells of can be one of the group's."""
    return unreadable.role in (group.role, CameraRole.VISIBLE)


def _bodies(group: CameraGroup) -> list[list[tuple[Still, Camera]]]:
    """Part a group's photos by the camera's or drone's serial number: two drones of one model fly at the same time.

    Photos without a serial number stay with the body of most photos.
    """
    serials = [s.exif.serial or s.xmp.serial for s in group.stills]
    counts = Counter(s for s in serials if s)
    usual = counts.most_common(1)[0][0] if counts else ""
    parts: dict[str, list[tuple[Still, Camera]]] = {}
    for serial, still, camera in zip(serials, group.stills, group.cameras, strict=True):
        parts.setdefault(serial or usual, []).append((still, camera))
    return list(parts.values())


def _flight_frames(
    members: Sequence[tuple[Still, Camera | None, float | None]],
    names: dict[Path, str],
    warnings: list[str],
    *,
    first_index: int,
    number: int,
) -> list[FrameRef]:
    """Return one flight's frames, its fixes judged together."""
    raw = [read_fix(s) for s, _, _ in members]
    times = [t for _, _, t in members]
    has_xmp = [s.xmp.lat_deg is not None for s, _, _ in members]
    steps = [0.0 if x else s.exif.step_deg for x, (s, _, _) in zip(has_xmp, members, strict=True)]
    if says_one_place(raw):
        warnings.append(
            f"all photos of {members[0][0].path.parent.name} carry the same position: it is not used; "
            "--track FILE gives them theirs"
        )
        raw = [None] * len(raw)
    fixes = judge_fixes(raw, times, steps)
    return [
        FrameRef(
            index=first_index + i,
            name=names[still.path],
            source=str(still.path),
            width_px=still.width_px,
            height_px=still.height_px,
            flight=number,
            time_s=time_s,
            fix=fixes[i],
            attitude=still.xmp.attitude,
            height_m=still.xmp.height_m,
            camera=camera,
            problem=still.problem,
        )
        for i, (still, camera, time_s) in enumerate(members)
    ]


def _unique_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Name photos by their file; where two folders hold the same name, by folder and file, or as much as it takes."""
    names = {p: p.name for p in paths}
    for depth in range(2, 8):
        counts = Counter(names.values())
        if all(n == 1 for n in counts.values()):
            break
        names = {p: "/".join(p.parts[-depth:]) if counts[name] > 1 else name for p, name in names.items()}
    return names


def _name_apart(flights: list[Flight]) -> list[Flight]:
    counts = Counter(f.name for f in flights)
    seen: Counter[str] = Counter()
    named = []
    for flight in flights:
        seen[flight.name] += 1
        apart = counts[flight.name] > 1
        named.append(replace(flight, name=f"{flight.name}-{seen[flight.name]}") if apart else flight)
    return named
