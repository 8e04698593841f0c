"""Which video files are pieces of one recording: drones cut at about 4 GB or after some minutes. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence

from photomap_gis.ingest.decode import VideoInfo

_GAP_S = 3.0
"""Clocks in the files have whole seconds, and starting the next file takes a moment."""

_CUT_BYTES = (2**31, 2**32)
"""File systems and firmware cut at 2 or 4 GiB, give or take a few percent."""

_CUT_SLACK = 0.07
_GOPRO = re.compile(r"^(G[HXP])(\d{2})(\d{4})$", re.IGNORECASE)
_FIRST_GOPRO = re.compile(r"^GOPR(\d{4})$", re.IGNORECASE)
_LAST_NUMBER = re.compile(r"^(.*?)(\d{1,9})(\D*)$")


def group_splits(infos: Sequence[VideoInfo]) -> list[list[VideoInfo]]:
    """Return the recordings in order, each as its pieces in order.

    A file continues the one before it where folder, camera, size and name follow on, and either the clocks meet (start
    plus duration is the next start) or, where a start is unknown, the file before was cut at a full 2 or 4 GB.
    """
    groups: list[list[VideoInfo]] = []
    for info in sorted(infos, key=_order):
        group = next((g for g in groups if _continues(g[-1], info)), None)
        if group is not None:
            group.append(info)
        else:
            groups.append([info])
    return groups


def _order(info: VideoInfo) -> tuple[str, str, int, str]:
    family, number = _name(info)
    return str(info.path.parent), family, number, info.path.name


def _name(info: VideoInfo) -> tuple[str, int]:
    """Return what the pieces of a recording share in their names, and the piece's number."""
    stem = info.path.stem
    if (gopro := _GOPRO.match(stem)) is not None:  # GX010123, GX020123: the chapter stands before the recording
        return f"gopro {gopro.group(3)}", int(gopro.group(2))
    if (gopro := _FIRST_GOPRO.match(stem)) is not None:  # GOPR0123, then GP010123
        return f"gopro {gopro.group(1)}", 0
    if (dated := re.match(r"^(DJI)_\d{14}_(\d{3,6})(.*)$", stem, re.IGNORECASE)) is not None:
        return f"{dated.group(1).lower()}{dated.group(3).lower()}", int(dated.group(2))  # DJI_20220807134040_0012_V
    if (numbered := _LAST_NUMBER.match(stem)) is not None:
        return f"{numbered.group(1)}#{numbered.group(3)}".lower(), int(numbered.group(2))
    return stem.lower(), 0


def _continues(before: VideoInfo, after: VideoInfo) -> bool:
    (family, number), (next_family, next_number) = _name(before), _name(after)
    if before.path.parent != after.path.parent or family != next_family or next_number != number + 1:
        return False
    if (before.width_px, before.height_px, before.model) != (after.width_px, after.height_px, after.model):
        return False
    if before.rate_hz and after.rate_hz and abs(before.rate_hz / after.rate_hz - 1.0) > 0.02:
        return False
    if family.startswith("gopro "):
        return True  # chapters of one recording share its number; their clocks all tell its beginning
    if before.start_utc_s is not None and after.start_utc_s is not None and before.duration_s:
        gap_s = after.start_utc_s - before.start_utc_s - before.duration_s
        if abs(gap_s) <= _GAP_S:
            return True
        # Some cameras stamp every piece with the beginning of the recording, or all with the end.
        return abs(after.start_utc_s - before.start_utc_s) < 1.0 and _is_full(before)
    return _is_full(before)


def _is_full(info: VideoInfo) -> bool:
    return any(-_CUT_SLACK * cut <= info.size_bytes - cut <= 0.01 * cut for cut in _CUT_BYTES)
