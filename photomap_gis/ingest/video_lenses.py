"""Which of a drone's cameras to use where it recorded with several at once: by DJI's suffixes _W, _Z, _T, _V. Pure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from photomap_gis.core.errors import UsageError
from photomap_gis.ingest.decode import VideoInfo
from photomap_gis.ingest.options import LensChoice
from photomap_gis.ingest.profiles import CameraRole

_SUFFIX = re.compile(r"^DJI_.*_(W|WIDE|Z|ZOOM|T|THRM|V|S)$", re.IGNORECASE)
_ROLES = {
    "W": CameraRole.WIDE,
    "WIDE": CameraRole.WIDE,
    "Z": CameraRole.ZOOM,
    "ZOOM": CameraRole.ZOOM,
    "T": CameraRole.THERMAL,
    "THRM": CameraRole.THERMAL,
}
_WIDEST_FIRST = (CameraRole.WIDE, CameraRole.VISIBLE, CameraRole.ZOOM, CameraRole.THERMAL)


def role_of(info: VideoInfo) -> CameraRole:
    """Return which of the drone's cameras recorded a video, by its name; ``VISIBLE`` where it does not tell."""
    suffix = _SUFFIX.match(info.path.stem)
    return _ROLES.get(suffix.group(1).upper(), CameraRole.VISIBLE) if suffix else CameraRole.VISIBLE


def choose_videos(infos: Sequence[VideoInfo], choice: LensChoice) -> tuple[list[VideoInfo], list[str]]:
    """Return the videos of the wanted camera, and warnings that name the others.

    Without a wish the widest of the cameras of each folder is used. Raises ``UsageError`` where the wanted camera
    recorded nothing.
    """
    roles = {info: role_of(info) for info in infos}
    if choice is LensChoice.ALL:
        return list(infos), []
    if choice in (LensChoice.ZOOM, LensChoice.THERMAL):
        wanted = CameraRole(choice.value)
        used = [i for i in infos if roles[i] is wanted]
        if not used:
            names = ", ".join(i.path.name for i in list(infos)[:3])
            raise UsageError(f"no {choice} video among {names}: choose another --lens")
    else:
        best = {
            folder: min((roles[i] for i in infos if i.path.parent == folder), key=_WIDEST_FIRST.index)
            for folder in {i.path.parent for i in infos}
        }
        used = [i for i in infos if roles[i] is best[i.path.parent]]
    left = Counter(roles[i] for i in infos if i not in used)
    return used, [
        f"not used: {count} video{'s' if count != 1 else ''} of the {role} camera; --lens chooses another, --lens all "
        "takes every one"
        for role, count in left.items()
    ]
