"""The legs on which the camera is on, as lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from photomap_gis.core.plan import Sortie, Waypoint

Line = tuple[Waypoint, ...]


def lanes_of(sortie: Sortie) -> Iterator[Line]:
    """Yield the stretches of waypoints between camera on and off (one that hovers is a lane with its neighbours)."""
    line: list[Waypoint] = []
    for waypoint in sortie.waypoints:
        if line:
            line.append(waypoint)
        if waypoint.trigger is not None and not line:
            line = [waypoint]
        elif waypoint.trigger is None and line:
            yield tuple(line)
            line = []
    if len(line) > 1:
        yield tuple(line)


def cut_at_antimeridian(lon_lat: Sequence[tuple[float, float]]) -> list[list[list[float]]]:
    """Return the parts of a line of (longitude, latitude), which goes the short way round [RFC 7946, 3.1.9]."""
    parts: list[list[list[float]]] = [[]]
    before: tuple[float, float] | None = None
    for lon, lat in lon_lat:
        if before is not None and abs(lon - before[0]) > 180.0:
            edge = 180.0 if before[0] > 0 else -180.0
            ahead = lon + 2 * edge
            share = (edge - before[0]) / (ahead - before[0]) if ahead != before[0] else 0.0
            crossing = before[1] + share * (lat - before[1])
            parts[-1].append([edge, crossing])
            parts.append([[-edge, crossing]])
        parts[-1].append([lon, lat])
        before = (lon, lat)
    return [part for part in parts if len(part) > 1]
