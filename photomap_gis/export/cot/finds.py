"""A mission's find as Cursor on Target has it: one way for files and for pushes, so that devices show it once."""

from __future__ import annotations

from datetime import UTC, datetime

from photomap_gis.export.cot.events import CotFind, stable_uid
from photomap_gis.export.finds import Find

_ARGB = {"intruder": -65536, "victim": -22016, "hazard": -6912, "other": -16737844}
"""Signed numbers, as ATAK writes them; other kinds are red."""


def cot_find(find: Find) -> CotFind:
    """Return a find's value; its identifier is that of the find, whatever else was marked or taken away."""
    parts = (find.id,) if find.id else (find.name, find.lon_deg, find.lat_deg)
    what = find.kind.capitalize() if find.kind and not find.name.lower().startswith(find.kind) else ""
    return CotFind(
        stable_uid("find", *parts), find.name, find.lat_deg, find.lon_deg, find.ce90_m,
        remarks="; ".join(w for w in (what, find.remarks) if w), seen_utc=_moment(find.time_utc),
        argb=_ARGB.get(find.kind, _ARGB["intruder"]),
    )  # fmt: skip


def _moment(text: str | None) -> datetime | None:
    try:
        moment = None if text is None else datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        return None
    return moment if moment is None or moment.tzinfo else moment.replace(tzinfo=UTC)
