"""A plan's document in words: what it covers, what it costs, what is to be known of it."""

from __future__ import annotations

import html
import re

from ..translation import tr

AMBER, RED, GREEN = "#8a5a00", "#a01020", "#11702f"


def summary_html(facts: dict) -> str:
    """Return the few figures that matter, as rich text; coverage first, in a colour."""
    share = float(facts["covered_share"])
    colour = GREEN if share >= 1.0 - 1e-9 else AMBER if share > 0.98 else RED
    seen = tr("sure to be seen") if "pod" not in facts else tr("of the area swept")
    # 99.97 % must not be told as 100
    percent = "100" if share >= 1.0 - 1e-9 else f"{min(100 * share, 99.99):.2f}"
    rows = [f'<b style="color:{colour}">{percent} %</b> {seen}']
    sorties = len(facts["sorties"])
    rows.append(
        tr("{minutes} in {sorties}, {photos} photos, {km} km").format(
            minutes=_minutes(facts["duration_s"]),
            sorties=tr("one flight") if sorties == 1 else tr("{} sorties").format(sorties),
            photos=facts["photos"],
            km=f"{facts['length_m'] / 1000:.2f}",
        )
    )
    rows.append(f"{100 * facts['gsd_m_per_px']:.2f} cm/px, {facts['height_m']:.0f} m" + _area(facts))
    if "front_overlap" in facts:
        front, side = 100 * facts["front_overlap"], 100 * facts["side_overlap"]
        rows.append(tr("overlaps {front} / {side} %, {speed} m/s").format(
            front=f"{front:.0f}", side=f"{side:.0f}", speed=f"{facts['speed_m_s']:.1f}"
        ))  # fmt: skip
    if "pod" in facts:
        pod = facts["pod"]
        rows.append(
            tr("found with a probability of {random} % (random search), {cube} % (inverse cube)").format(
                random=f"{100 * pod['random_search']:.0f}", cube=f"{100 * pod['inverse_cube']:.0f}"
            )
        )
    if sorties > 1:
        rows.append(", ".join(f"{n}: {_minutes(s['duration_s'])}" for n, s in enumerate(facts["sorties"], 1)))
    return "<br>".join(rows)


def warnings_html(warnings: list[str]) -> str:
    """Return warnings as a list, empty where there is none."""
    if not warnings:
        return ""
    items = "".join(f"<li>{html.escape(in_the_docks_words(w))}</li>" for w in warnings)
    return f'<ul style="margin-left:-22px;color:{AMBER}">{items}</ul>'


def in_the_docks_words(text: str) -> str:
    """Return the engine's words with the dock's names for what the command line calls ``--option``."""
    names = {
        "--avoid-margin": tr("margin"),
        "--camera": tr("camera"),
        "--corridor-width M": tr("“Width of the strip”"),
        "--dem FILE": tr("an elevation layer"),
        "--endurance-min": tr("“Battery”"),
        "--fov-deg": tr("“Horizontal view”"),
        "--front-overlap": tr("front overlap"),
        "--geoid-m": tr("“Geoid's height”"),
        "--dem-vertical": tr("“Heights are above”"),
        "--gsd": tr("ground pixel"),
        "--height": tr("height"),
        "--home": tr("take-off place"),
        "--inset": tr("“Never leave the area”"),
        "--side-overlap": tr("side overlap"),
        "--speed": tr("speed"),
        "--target": tr("target"),
        "--transit-height": tr("height on the way"),
    }
    return re.sub(r"--[a-z][a-z-]*(?: (?:FILE|M)\b)?", lambda found: _name(found.group(), names), text)


def _name(option: str, names: dict[str, str]) -> str:
    return names.get(option) or names.get(option.split()[0]) or option


def report_words(report: dict) -> str:
    """Return how an upload ended, in one paragraph: what the vehicle holds now, and where its old mission is."""
    outcome = {
        "verified": tr("Verified: the vehicle holds this plan, read back item by item."),
        "restored": tr("Not taken over: the vehicle's mission of before was put back and read back."),
        "refused": tr("Refused."),
        "unknown": tr("Unknown: the vehicle did not answer. Do not fly before its mission was read."),
    }.get(report.get("outcome", ""), "")
    holds = {
        "mixed": tr("The vehicle holds a mixture: do not fly, put back what was there."),
    }.get(report.get("holds", ""), "")
    parts = [outcome, report.get("message", "")]
    if report.get("outcome") not in ("verified", "restored"):
        parts.append(holds)
    # of "refused" and "unknown" the message says what the vehicle holds, as far as that is known
    if report.get("outcome") == "verified":
        parts = [outcome, tr("{} items.").format(report.get("items", 0))]
    if report.get("saved_previous"):
        parts.append(tr("What it held before: {}").format(report["saved_previous"]))
    return " ".join(p for p in parts if p)


def _minutes(seconds: float) -> str:
    return tr("{} min").format(f"{seconds / 60:.1f}")


def _area(facts: dict) -> str:
    area = facts.get("area_m2", facts.get("area_searched_m2"))
    return "" if area is None else f", {area / 1e4:.2f} ha"
