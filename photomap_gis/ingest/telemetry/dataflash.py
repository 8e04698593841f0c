"""ArduPilot's onboard logs (.bin): self-describing binary records.

Each record is ``A3 95 type`` and a body whose layout an earlier FMT record gave. Only the bodies of the few wanted
kinds are kept, as bytes, and read as numpy records at the end: 27 MB take 0.3 s. The record layout is that of
ArduPilot's ``LogStructure.h``; GPS weeks count in GPS time, which runs ahead of UTC by the leap seconds.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photomap_gis.core.errors import DataError
from photomap_gis.ingest.telemetry.assemble import Positions, Turns, points_of
from photomap_gis.ingest.telemetry.clean import clean_triggers
from photomap_gis.ingest.telemetry.modes import COPTER_MODES, PLANE_MODES
from photomap_gis.ingest.telemetry.rotations import (
    BODY_SIGMA_TILT_RAD,
    attitudes_of_quaternions,
    belly_camera,
    quaternions_of_euler,
)
from photomap_gis.ingest.telemetry.track import Clock, ModeChange, Track, Trigger

HEAD = b"\xa3\x95"
_FMT_TYPE, _FMT_LENGTH = 128, 89
_WANTED = frozenset({"GPS", "GPS2", "GPA", "ATT", "POS", "CAM", "TRIG", "MNT", "MODE", "MSG"})
_GPS_EPOCH_UNIX_S = 315_964_800.0
_WEEK_S = 604_800.0
_LEAPS_UNIX_S = (  # when UTC fell another second behind GPS time, from 1999 on (13 s before)
    1_136_073_600, 1_230_768_000, 1_341_100_800, 1_435_708_800, 1_483_228_800,
)  # fmt: skip
_3D_FIX = 3

# Format letter -> numpy type and the factor to plain units (degrees, metres, ...).
_LETTERS: dict[str, tuple[str, float]] = {
    "b": ("i1", 1), "B": ("u1", 1), "M": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1), "I": ("<u4", 1),
    "q": ("<i8", 1), "Q": ("<u8", 1), "f": ("<f4", 1), "d": ("<f8", 1), "g": ("<f2", 1), "c": ("<i2", 0.01),
    "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "n": ("S4", 1), "N": ("S16", 1),
    "Z": ("S64", 1), "a": ("(32,)<i2", 1),
}  # fmt: skip


@dataclass(slots=True)
class _Kind:
    """One kind of record: where its fields lie, and the bodies found."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]
    bodies: list[bytes]

    def read(self) -> dict[str, np.ndarray]:
        """Return ``(N,)`` arrays by column, in plain units."""
        dtype = np.dtype({"names": list(self.columns), "formats": [_LETTERS[c][0] for c in self.letters]})
        if dtype.itemsize != self.length - 3:
            return {}
        records = np.frombuffer(b"".join(self.bodies), dtype=dtype)
        out = {}
        for name, letter in zip(self.columns, self.letters, strict=True):
            factor = _LETTERS[letter][1]
            is_plain = records[name].dtype.kind in "iuf" and records[name].ndim == 1
            out[name] = records[name].astype(np.float64) * factor if is_plain else records[name]
        return out


def read_dataflash(path: Path) -> Track:
    """Return the track of an onboard log; a damaged or cut one gives what it holds and a warning."""
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            kinds, skipped = _scan(data)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as an onboard log ({error}); check the file") from error
    tables: dict[str, dict[str, np.ndarray]] = {}
    for kind in kinds:
        if kind.bodies and (table := kind.read()):
            tables[kind.name] = table
    warnings = [f"{path.name}: {skipped} damaged bytes were stepped over"] if skipped else []
    gps = _best_receiver(tables.get("GPS") or tables.get("GPS2"))
    boot_to_utc_s = _boot_to_utc_s(gps)
    body = _body(tables.get("ATT"), boot_to_utc_s or 0.0)
    gimbal = _gimbal(tables.get("MNT"), body, boot_to_utc_s or 0.0)
    points, dropped = points_of(_positions(tables, gps, boot_to_utc_s or 0.0), body, gimbal)
    triggers = _triggers(tables.get("CAM") or tables.get("TRIG"), boot_to_utc_s or 0.0)
    if not points and not triggers:
        raise DataError(f"{path}: it holds no GPS positions; did the vehicle have a fix while it logged?")
    if boot_to_utc_s is None:
        warnings.append(f"{path.name}: it never learned the time of day; give --track-offset SECONDS")
    warnings += [f"{path.name}: {w}" for w in dropped]
    clock = Clock.BOOT if boot_to_utc_s is None else Clock.UTC
    modes = _modes(tables.get("MODE"), tables.get("MSG"), boot_to_utc_s or 0.0)
    return Track(points, clock, str(path), triggers=triggers, modes=modes, warnings=tuple(warnings))


def _scan(data: mmap.mmap) -> tuple[list[_Kind], int]:
    """Walk over the records, learn the kinds, keep the wanted bodies; also how many bytes made no sense."""
    lengths: list[int] = [0] * 256
    lengths[_FMT_TYPE] = _FMT_LENGTH
    wanted: dict[int, _Kind] = {}
    at, skipped, size = 0, 0, len(data)
    while at + 3 <= size:
        if data[at] != 0xA3 or data[at + 1] != 0x95 or not (length := lengths[data[at + 2]]):
            found = data.find(HEAD, at + 1)
            found = size if found < 0 else found
            skipped += found - at
            at = found
            continue
        if at + length > size:
            skipped += size - at
            break
        kind_id = data[at + 2]
        if kind_id == _FMT_TYPE:
            kind = _format(data[at + 3 : at + length])
            if kind is not None:
                new_id, new = kind
                lengths[new_id] = new.length if new_id != _FMT_TYPE else _FMT_LENGTH
                if new.name in _WANTED and new_id not in wanted:
                    wanted[new_id] = new
        elif kind_id in wanted and wanted[kind_id].length == length:
            wanted[kind_id].bodies.append(data[at + 3 : at + length])
        at += length
    return list(wanted.values()), skipped


def _format(body: bytes) -> tuple[int, _Kind] | None:
    """Read the body of an FMT record; ``None`` where it cannot be one."""
    name, letters, columns = (
        body[a:b].split(b"\0", 1)[0].decode("ascii", errors="replace") for a, b in ((2, 6), (6, 22), (22, 86))
    )
    names = tuple(columns.split(",")) if columns else ()
    kind_id, length = body[0], body[1]
    if length < 3:
        return None
    understood = all(c in _LETTERS for c in letters) and len(names) == len(letters) == len(set(names))
    if name in _WANTED and not understood:
        name = ""  # its length is known, its content is not
    return kind_id, _Kind(name, length, letters, names, [])


def _boot_to_utc_s(gps: dict[str, np.ndarray] | None) -> float | None:
    """What to add to the vehicle's seconds since boot to reach UTC; ``None`` where it never had GPS time."""
    if gps is None:
        return None
    weeks, weeks_s = gps.get("GWk", gps.get("Week")), gps.get("GMS", gps.get("TimeMS"))
    if weeks is None or weeks_s is None or "TimeUS" not in gps:
        return None
    good = (gps["Status"] >= _3D_FIX) & (weeks > 1000) & (weeks < 10_000)
    if not good.any():
        return None
    gps_s = _GPS_EPOCH_UNIX_S + weeks[good] * _WEEK_S + weeks_s[good] / 1e3
    # the list is in UTC: on GPS time each fell so much later as GPS time was ahead by then
    fallen = [(gps_s >= leap + 14.0 + k).astype(float) for k, leap in enumerate(_LEAPS_UNIX_S)]
    utc_s = gps_s - 13.0 - sum(fallen)
    # The message is written up to a navigation interval after its moment: the least delayed ones tell best.
    return float(np.quantile(utc_s - gps["TimeUS"][good] / 1e6, 0.99))


def _best_receiver(gps: dict[str, np.ndarray] | None) -> dict[str, np.ndarray] | None:
    """Return the rows of one receiver: the one that was used most, where several share the table."""
    if gps is None or "Status" not in gps:
        return None
    if "I" not in gps or len(np.unique(gps["I"])) < 2:
        return gps
    score = gps["U"] if "U" in gps else gps["Status"] >= _3D_FIX
    best = max(np.unique(gps["I"]), key=lambda i: float(score[gps["I"] == i].sum()))
    return {name: column[gps["I"] == best] for name, column in gps.items()}


def _positions(
    tables: dict[str, dict[str, np.ndarray]], gps: dict[str, np.ndarray] | None, boot_to_utc_s: float
) -> Positions:
    """Return the estimator's positions (POS) while the receiver has a fix; the receiver's where there are none."""
    nothing = np.empty(0)
    if gps is None or "Lat" not in gps or "TimeUS" not in gps:
        return Positions.of(nothing, nothing, nothing)
    gps_s = gps["TimeUS"] / 1e6 + boot_to_utc_s
    fixed = gps["Status"] >= _3D_FIX
    sigma = _accuracy(tables.get("GPA"), gps, gps_s, boot_to_utc_s)
    pos = tables.get("POS")
    if pos is None or "RelHomeAlt" not in pos or not len(pos["Lat"]):
        lat = np.where(fixed, gps["Lat"], np.nan)
        height = gps.get("RAlt", gps.get("RelAlt"))
        return Positions.of(gps_s, lat, gps["Lng"], alt_m=gps.get("Alt"), height_m=height, sigma_m=sigma)
    times_s = pos["TimeUS"] / 1e6 + boot_to_utc_s
    order = np.argsort(gps_s, kind="stable")
    nearest = order[np.clip(np.searchsorted(gps_s[order], times_s), 0, len(gps_s) - 1)]
    lat = np.where(fixed[nearest], pos["Lat"], np.nan)
    return Positions.of(times_s, lat, pos["Lng"], alt_m=pos["Alt"], height_m=pos["RelHomeAlt"], sigma_m=sigma[nearest])


def _accuracy(
    gpa: dict[str, np.ndarray] | None, gps: dict[str, np.ndarray], gps_s: np.ndarray, boot_to_utc_s: float
) -> np.ndarray:
    """``(N,)`` reported horizontal one-sigma at the receiver's moments; NaN where it tells none."""
    if gpa is None or "HAcc" not in gpa or "TimeUS" not in gpa:
        return np.full(len(gps_s), np.nan)
    if "I" in gpa and "I" in gps and len(gps["I"]):
        mine = gpa["I"] == gps["I"][0]
        gpa = {name: column[mine] for name, column in gpa.items()}
    if not len(gpa["HAcc"]):
        return np.full(len(gps_s), np.nan)
    accuracy = np.where(gpa["HAcc"] > 0, gpa["HAcc"], np.nan)
    order = np.argsort(gpa["TimeUS"], kind="stable")
    at_fixes: np.ndarray = np.interp(gps_s, gpa["TimeUS"][order] / 1e6 + boot_to_utc_s, accuracy[order])
    return at_fixes


def _body(att: dict[str, np.ndarray] | None, boot_to_utc_s: float) -> Turns:
    if att is None or not {"TimeUS", "Roll", "Pitch", "Yaw"} <= att.keys():
        return Turns(np.empty(0), np.empty((0, 4)))
    return Turns.of_euler(
        att["TimeUS"] / 1e6 + boot_to_utc_s,
        roll_rad=np.radians(att["Roll"]),
        pitch_rad=np.radians(att["Pitch"]),
        yaw_rad=np.radians(att["Yaw"]),
    )


def _gimbal(mnt: dict[str, np.ndarray] | None, body: Turns, boot_to_utc_s: float) -> Turns | None:
    """Return the first gimbal's attitude; roll and pitch are to the earth, yaw to the body or the earth."""
    if mnt is None or not {"TimeUS", "Roll", "Pitch"} <= mnt.keys():
        return None
    if "I" in mnt and len(mnt["I"]):
        mnt = {name: column[mnt["I"] == mnt["I"].min()] for name, column in mnt.items()}
    times_s = mnt["TimeUS"] / 1e6 + boot_to_utc_s
    unknown = np.full(len(times_s), np.nan)
    earth = mnt.get("YawE", mnt.get("Yaw", unknown))
    to_body = np.degrees(body.yaw_rad(times_s)) + mnt.get("YawB", unknown)
    yaw = np.where(np.isfinite(earth), earth, to_body)
    good = np.isfinite(mnt["Roll"] + mnt["Pitch"] + yaw)
    if not good.any() or not (np.any(mnt["Roll"][good]) or np.any(mnt["Pitch"][good])):
        return None  # a mount that reports nothing, or zeros only
    return Turns.of_euler(
        times_s[good],
        roll_rad=np.radians(mnt["Roll"][good]),
        pitch_rad=np.radians(mnt["Pitch"][good]),
        yaw_rad=np.radians(yaw[good]),
    )


def _triggers(cam: dict[str, np.ndarray] | None, boot_to_utc_s: float) -> tuple[Trigger, ...]:
    """Return the shots (CAM: confirmed; TRIG where there is no feedback from the camera)."""
    needed = ("TimeUS", "Lat", "Lng", "Alt", "RelAlt")
    if cam is None or not set(needed) <= cam.keys():
        return ()
    count = len(cam["TimeUS"])
    angles = [cam.get(name, cam.get(long, np.full(count, np.nan)))
              for name, long in (("Y", "Yaw"), ("P", "Pitch"), ("R", "Roll"))]  # fmt: skip
    attitudes = attitudes_of_quaternions(
        belly_camera(quaternions_of_euler(*(np.radians(a) for a in angles))), sigma_tilt_rad=BODY_SIGMA_TILT_RAD
    )
    indices = cam.get("Img", np.arange(count))
    return clean_triggers(
        Trigger(t / 1e6 + boot_to_utc_s, int(i), lat, lon, alt, height, a)
        for t, lat, lon, alt, height, i, a in zip(*(cam[n].tolist() for n in needed), indices, attitudes, strict=True)
    )


def _modes(
    mode: dict[str, np.ndarray] | None, words: dict[str, np.ndarray] | None, boot_to_utc_s: float
) -> tuple[ModeChange, ...]:
    """Return the changes of the flight mode; the log's first words say which kind of vehicle counts them."""
    if mode is None or not {"TimeUS", "Mode"} <= mode.keys():
        return ()
    told = () if words is None else words.get("Message", ())
    names = PLANE_MODES if any(bytes(w).startswith((b"ArduPlane", b"APM:Plane")) for w in told) else COPTER_MODES
    return tuple(
        ModeChange(t / 1e6 + boot_to_utc_s, names.get(int(m), f"mode {int(m)}"))
        for t, m in zip(mode["TimeUS"].tolist(), mode["Mode"].tolist(), strict=True)
    )
