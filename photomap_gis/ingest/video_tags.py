"""What a video container's tags tell of the camera and its clock: every maker writes them elsewhere. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from photomap_gis.ingest.telemetry.text import unix_s_of_iso

_OLDEST_START_S = 946_684_800.0  # the year 2000: earlier stamps are clocks that were never set


def start_utc_s(*metadata: Mapping[str, str]) -> float | None:
    """Return when the recording began: the stamp that names its zone first."""
    for key in ("com.apple.quicktime.creationdate", "creation_time", "date", "ICRD"):
        for tags in metadata:
            stamp = tags.get(key, "").strip()
            moment = unix_s_of_iso(_with_colon(stamp)) if len(stamp) > 10 else None  # a day alone is no beginning
            if moment is not None and moment[0] > _OLDEST_START_S:
                return moment[0]
    return None


def _with_colon(stamp: str) -> str:
    """``...+0200`` as ``...+02:00``."""
    return f"{stamp[:-2]}:{stamp[-2:]}" if len(stamp) > 5 and stamp[-5] in "+-" and stamp[-4:].isdigit() else stamp


def make_and_model(*metadata: Mapping[str, str]) -> tuple[str, str]:
    """Return the camera's maker and model where the container tells them, else what its marks imply."""
    tags = {k.lower(): v.strip() for m in reversed(metadata) for k, v in m.items()}
    make = next((tags[k] for k in ("com.apple.quicktime.make", "make", "com.android.manufacturer") if tags.get(k)), "")
    model = next((tags[k] for k in ("com.apple.quicktime.model", "model", "com.android.model") if tags.get(k)), "")
    marks = " ".join(tags.get(k, "") for k in ("encoder", "handler_name", "comment", "title"))
    for known in ("DJI", "GoPro", "Autel", "Parrot", "Skydio", "Yuneec", "Hasselblad"):
        if not make and known.lower() in marks.lower():
            make = known
    encoder = tags.get("encoder", "")
    if not model and make and encoder.lower().startswith(make.lower()):
        model = encoder[len(make) :].strip(" .-_")
        model = "" if model.lower() in ("avc", "hevc", "avc encoder", "hevc encoder") else model
    return make, model


def rotation_deg(tags: Mapping[str, str]) -> int:
    """Return the turn that players apply, from the tag that older muxers write."""
    try:
        return int(float(tags.get("rotate", "0"))) % 360
    except (ValueError, OverflowError):
        return 0
