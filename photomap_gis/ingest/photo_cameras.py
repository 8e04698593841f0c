"""Which of the cameras in a heap of photos to use: photos are grouped by camera, and one group is chosen.

A drone with a wide, a zoom and a thermal camera writes three photos a shot; a map wants one of them. A group is a
camera (maker, model, which of the drone's cameras) at one focal length. Sizes do not part a group: an odd
size among others (a reduced copy, a turned one) is the same camera, unless nothing else could tell two cameras apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from photomap_gis.core.camera import Camera
from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.lenses import camera_for
from photomap_gis.ingest.options import IngestOptions, LensChoice
from photomap_gis.ingest.profiles import CameraRole
from photomap_gis.ingest.stills import Still

_SAME_FOCAL = math.log(1.12)
# A camera with fewer than this part of the largest group's photos took them by accident: it is not what was asked for.
_FEW = 0.2
_VISIBLE_ROLES = frozenset({CameraRole.VISIBLE, CameraRole.WIDE, CameraRole.ZOOM})


@dataclass(frozen=True, slots=True)
class CameraGroup:
    """The photos of one camera at one focal length; ``cameras`` is theirs, in order."""

    name: str
    role: CameraRole
    stills: tuple[Still, ...]
    cameras: tuple[Camera, ...]

    @property
    def hfov_rad(self) -> float | None:
        """The field of view of most of its photos across the raster's long side, ``None`` where unknown."""
        known = sorted(
            2.0 * math.atan(max(c.width_px, c.height_px) / 2.0 / c.focal_px) for c in self.cameras if c.focal_px
        )
        return known[len(known) // 2] if known else None


def group_by_camera(stills: Sequence[Still]) -> list[CameraGroup]:
    """Return the groups of readable photos, each in the order given; the largest group comes first."""
    cameras: dict[tuple[object, ...], Camera] = {}
    members: dict[tuple[str, str, CameraRole, str], list[tuple[Still, Camera]]] = {}
    for still in stills:
        key = (still.lens, still.width_px, still.height_px)
        if key not in cameras:
            cameras[key] = camera_for(still.width_px, still.height_px, still.lens)
        body = (still.make.lower(), still.model.lower(), still.role, still.band)
        members.setdefault(body, []).append((still, cameras[key]))
    groups = [
        CameraGroup(_name(part[0][0], part[0][1]), role, tuple(s for s, _ in part), tuple(c for _, c in part))
        for (_, _, role, _), body in members.items()
        for part in _parts(body)
    ]
    return sorted(_adopt_unknown(groups), key=lambda g: -len(g.stills))


def _name(still: Still, camera: Camera) -> str:
    name = camera.name or "unknown camera"
    known = name.lower()
    if still.role is CameraRole.BAND:
        return f"{name}, {still.band}"
    if still.role is not CameraRole.VISIBLE and still.role.value not in known:
        return f"{name} ({still.role.value})"
    return name


def _parts(body: Sequence[tuple[Still, Camera]]) -> list[list[tuple[Still, Camera]]]:
    """Part one body's photos by focal length; where that is unknown, by sizes that no single camera has."""
    parts: list[tuple[float, float, list[tuple[Still, Camera]]]] = []
    for still, camera in body:
        long = max(still.width_px, still.height_px)
        shape = long / max(min(still.width_px, still.height_px), 1)
        # the focal length against the diagonal of the whole sensor is the same in every reduced copy
        focal = math.log(camera.focal_px / long) if camera.focal_px else math.nan
        for known_focal, known_shape, part in parts:
            same = (
                abs(focal - known_focal) < _SAME_FOCAL
                if not (math.isnan(focal) or math.isnan(known_focal))
                else _could_be_one(shape, known_shape, long, part[0][0])
            )
            if same:
                part.append((still, camera))
                break
        else:
            parts.append((focal, shape, [(still, camera)]))
    return [part for _, _, part in parts]


def _could_be_one(shape: float, known_shape: float, long_px: int, other: Still) -> bool:
    """Whether two sizes without a focal length can be one camera's: the same shape, or nearly the same width."""
    ratio = long_px / max(other.width_px, other.height_px)
    return abs(shape / known_shape - 1.0) < 0.02 or 0.6 < ratio < 1.6


def _adopt_unknown(groups: Sequence[CameraGroup]) -> list[CameraGroup]:
    """Give photos that lost their EXIF to the one camera whose photos have their size."""
    known = [g for g in groups if g.stills[0].model]
    kept = list(known)
    for group in groups:
        if group.stills[0].model:
            continue
        size = (group.stills[0].width_px, group.stills[0].height_px)
        hosts = [i for i, g in enumerate(known) if g.role is group.role and size in _sizes(g)]
        if len(hosts) != 1:
            kept.append(group)
            continue
        host = kept[hosts[0]]
        like = host.cameras[_sizes(host).index(size)]
        kept[hosts[0]] = replace(
            host, stills=host.stills + group.stills, cameras=host.cameras + (like,) * len(group.stills)
        )
    return kept


def _sizes(group: CameraGroup) -> list[tuple[int, int]]:
    return [(s.width_px, s.height_px) for s in group.stills]


def choose_cameras(groups: Sequence[CameraGroup], choice: LensChoice) -> tuple[list[CameraGroup], list[str]]:
    """Return the groups to use and warnings that name the others with their counts.

    ``WIDEST`` is the widest visible camera among those that took a fair part of the photos. Cameras compete only where
    their photos share a folder: drones that flew apart are all used. Raises ``UsageError`` where the wanted camera
    took none.
    """
    if choice is LensChoice.ALL:
        return list(groups), []
    used = _wanted(groups, choice)
    if not used:
        names = ", ".join(f"{g.name} ({len(g.stills)})" for g in groups)
        raise UsageError(f"no {choice} photos among {names}: choose another --lens")
    left = [g for g in groups if not any(g is u for u in used)]
    return used, [
        f"not used: {len(g.stills)} photo{'s' if len(g.stills) != 1 else ''} of {g.name}"
        f"{_words_of_fov(g)}; --lens chooses another camera, --lens all takes every one"
        for g in left
    ]


def override_lens(group: CameraGroup, options: IngestOptions) -> CameraGroup:
    """Return the group with the lens that the user states, itself where they state none."""
    if options.hfov_deg is None and options.focal_35mm is None:
        return group
    cameras = tuple(
        camera_for(s.width_px, s.height_px, s.lens, hfov_deg=options.hfov_deg, focal_35mm=options.focal_35mm)
        for s in group.stills
    )
    return replace(group, cameras=cameras)


def _wanted(groups: Sequence[CameraGroup], choice: LensChoice) -> list[CameraGroup]:
    visible = [g for g in groups if g.role in _VISIBLE_ROLES]
    wide = [g for g in visible if g.role is CameraRole.WIDE]
    if choice is LensChoice.THERMAL:
        return [g for g in groups if g.role is CameraRole.THERMAL]
    if choice is LensChoice.ZOOM:
        return [g for g in visible if g.role is CameraRole.ZOOM] or _narrowest(visible)
    if choice is LensChoice.WIDE and wide:
        return wide
    if wide:  # the zoom beside a wide camera looks at the same ground, in whatever folder its photos lie
        visible = [g for g in visible if g.role is not CameraRole.ZOOM]
    return [g for rivals in _rivals(visible or list(groups)) for g in _widest(rivals)]


def _rivals(groups: Sequence[CameraGroup]) -> list[list[CameraGroup]]:
    """Part the groups into those whose photos share a folder, directly or by way of others."""
    parts: list[tuple[set[Path], list[CameraGroup]]] = []
    for group in groups:
        folders = {s.path.parent for s in group.stills}
        near = [p for p in parts if p[0] & folders]
        parts = [p for p in parts if not p[0] & folders]
        parts.append((folders.union(*(p[0] for p in near)), [*(g for p in near for g in p[1]), group]))
    return [members for _, members in parts]


def _words_of_fov(group: CameraGroup) -> str:
    return f", field of view {math.degrees(group.hfov_rad):.0f}°" if group.hfov_rad else ""


def _widest(groups: Sequence[CameraGroup]) -> list[CameraGroup]:
    """Return the widest of the groups that matter, with every group of the same width (two bodies of one fleet)."""
    most = max(len(g.stills) for g in groups)
    fair = [g for g in groups if len(g.stills) >= _FEW * most]
    if all(g.role is CameraRole.BAND for g in fair):  # one shot of a multispectral camera is one photo a band
        return [min(fair, key=lambda g: (_band_rank(g.stills[0].band), -len(g.stills)))]
    if any(g.hfov_rad is None for g in fair):
        return [max(fair, key=lambda g: (g.role is not CameraRole.ZOOM, len(g.stills)))]
    wide = max(g.hfov_rad or 0.0 for g in fair)
    return [g for g in fair if g.hfov_rad is not None and abs(math.log(g.hfov_rad / wide)) < _SAME_FOCAL]


def _band_rank(band: str) -> int:
    """Green and red show what a map of colours shows."""
    return next((i for i, known in enumerate(("g", "r", "n")) if band.startswith(known) and band != "re"), 3)


def _narrowest(groups: Sequence[CameraGroup]) -> list[CameraGroup]:
    known = [g for g in groups if g.hfov_rad]
    return [min(known, key=lambda g: g.hfov_rad or math.pi)] if len(known) > 1 else []
