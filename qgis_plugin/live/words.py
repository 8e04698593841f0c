"""A flight's state in the few words that somebody in a hurry reads. No Qt here."""

from __future__ import annotations

import html

from ..translation import tr

GREEN, AMBER, RED, GREY = "#11702f", "#8a5a00", "#a01020", "#555555"


def health_html(health: dict | None, live: dict | None, *, lost: str = "") -> str:
    """Return the state of link, positions and map as one line, the worst first, in a colour."""
    if lost:
        return f'<b style="color:{RED}">{html.escape(lost)}</b>'
    if live is not None and live.get("phase") in ("finalising", "ended"):
        words = tr("The flight has ended.") if live["phase"] == "ended" else tr("The final map is being made.")
        return f'<b style="color:{GREY}">{words}</b>'
    if health is None:
        return f'<b style="color:{GREY}">{tr("Waiting for the first picture…")}</b>'
    bad = health.get("link") in ("lost", "ended") or health.get("gps") == "lost"
    unwell = bad or health.get("link") == "waiting" or health.get("words")
    colour = RED if bad else AMBER if unwell else GREEN
    head = " ".join(health.get("words") or []) or tr("All is well.")
    numbers = tr("{fps} pictures/s, {latency} ms behind, {frames} pictures, {dropped} dropped").format(
        fps=f"{health.get('fps', 0):.0f}", latency=f"{health.get('latency_ms', 0):.0f}",
        frames=health.get("frames", 0), dropped=health.get("dropped", 0),
    )  # fmt: skip
    if health.get("error_frames"):
        numbers += ", " + tr("{} broken").format(health["error_frames"])
    if (health.get("segments") or 1) > 1:
        numbers += ", " + tr("{} pieces").format(health["segments"])
    gps = {"ok": tr("GPS"), "lost": tr("no GPS now"), "searching": tr("GPS is looking"), "none": tr("without GPS")}
    return f'<b style="color:{colour}">{html.escape(head)}</b><br>{numbers}, {gps.get(health.get("gps", ""), "")}'


def accuracy_words(pose: dict | None, coverage: dict | None) -> str:
    """Return how well the map lies where the camera looks, and how much is covered."""
    parts = []
    ellipse = (pose or {}).get("ellipse")
    if ellipse:
        parts.append(tr("accuracy here ±{} m (CE90)").format(f"{ellipse['ce90']:.1f}"))
    if coverage and coverage.get("share") is not None:
        parts.append(tr("{} % of the area seen").format(f"{100 * min(coverage['share'], 1.0):.0f}"))
    elif coverage and coverage.get("covered_m2"):
        parts.append(tr("{} ha seen").format(f"{coverage['covered_m2'] / 1e4:.2f}"))
    return ", ".join(parts)


def drone_words(pose: dict | None) -> str:
    """Return what the vehicle says of itself."""
    if not pose:
        return ""
    parts = []
    for key, words, digits in (
        ("altitude_m", tr("{} m high"), 0), ("speed_m_s", "{} m/s", 1), ("battery_percent", tr("battery {} %"), 0)
    ):  # fmt: skip
        if pose.get(key) is not None:
            parts.append(words.format(f"{pose[key]:.{digits}f}"))
    if pose.get("mode"):
        parts.append(str(pose["mode"]))
    return ", ".join(parts)
