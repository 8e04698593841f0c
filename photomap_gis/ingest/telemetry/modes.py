"""Flight modes by the autopilots' numbers, and which of them fly by themselves."""

from __future__ import annotations

PLANE_MODES = {
    0: "MANUAL", 1: "CIRCLE", 2: "STABILIZE", 3: "TRAINING", 4: "ACRO", 5: "FBWA", 6: "FBWB", 7: "CRUISE",
    8: "AUTOTUNE", 10: "AUTO", 11: "RTL", 12: "LOITER", 13: "TAKEOFF", 15: "GUIDED", 17: "QSTABILIZE", 18: "QHOVER",
    19: "QLOITER", 20: "QLAND", 21: "QRTL",
}  # fmt: skip
COPTER_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    16: "POSHOLD", 17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 27: "AUTO_RTL",
}  # fmt: skip
"""ArduPilot's numbers, by its kinds of vehicle."""

_PX4_MAIN = {
    1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 8: "RATTITUDE",
}  # fmt: skip
_PX4_AUTO = {
    1: "AUTO_READY", 2: "AUTO_TAKEOFF", 3: "AUTO_LOITER", 4: "AUTO_MISSION", 5: "AUTO_RTL", 6: "AUTO_LAND",
    8: "AUTO_FOLLOW", 9: "AUTO_PRECLAND",
}  # fmt: skip
_PX4_AUTO_MAIN = 4

_BY_ITSELF = frozenset(
    {"AUTO", "GUIDED", "GUIDED_NOGPS", "RTL", "SMART_RTL", "LAND", "CIRCLE", "TAKEOFF", "QLAND", "QRTL", "OFFBOARD",
     "ORBIT", "BRAKE", "AVOID_ADSB"}
)  # fmt: skip


def px4_mode(custom_mode: int) -> str:
    """Return the name of PX4's ``custom_mode``: main mode in the third byte, the automatic ones' kind in the fourth."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main == _PX4_AUTO_MAIN:
        return _PX4_AUTO.get(sub, f"AUTO {sub}")
    return _PX4_MAIN.get(main, f"mode {main}")


def flies_by_itself(mode: str) -> bool:
    """Whether the autopilot decides where the vehicle goes; modes that only hold what the pilot steers do not count.

    >>> flies_by_itself("AUTO"), flies_by_itself("AUTO_MISSION"), flies_by_itself("LOITER"), flies_by_itself("mode 99")
    (True, True, False, False)
    """
    return mode in _BY_ITSELF or mode.startswith("AUTO_")
