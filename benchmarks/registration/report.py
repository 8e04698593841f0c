"""Figures with their bars, tables of text, and how both are written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from .score import Interval

Unit = Literal["%", "px", "deg", "ms", "s", "m", "/s", "x", ""]
PERCENT_DIGITS, OTHER_DIGITS = 2, 3


@dataclass(frozen=True, slots=True)
class Bar:
    """What the issue asks of a figure: at least ``low``, at most ``high`` (shares as shares, not percent)."""

    low: float = -math.inf
    high: float = math.inf

    def met(self, value: float) -> bool:
        """Whether the point value keeps the bar (a NaN keeps none)."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured figure: its value with the 95 % interval, of how many, and the bar where there is one."""

    name: str
    value: Interval
    count: int
    unit: Unit = "%"
    bar: Bar | None = None

    @property
    def met(self) -> bool:
        """Whether the bar is kept; a figure without one cannot miss it."""
        return self.bar is None or self.bar.met(self.value.value)


@dataclass(frozen=True, slots=True)
class Table:
    """Text in rows."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the benchmark: figures, further tables, remarks; ``data`` goes into the JSON only."""

    name: str
    figures: tuple[Figure, ...]
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()
    data: dict[str, Any] = field(default_factory=dict)

    @property
    def missed(self) -> tuple[Figure, ...]:
        """The figures that miss their bar."""
        return tuple(f for f in self.figures if not f.met)

    def __getitem__(self, name: str) -> Figure:
        """Return a figure by its name."""
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise KeyError(f"{self.name} has no figure {name!r}: {', '.join(f.name for f in self.figures)}")


def number(value: float, unit: Unit) -> str:
    """Return a value in its unit, shares as percent."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf"
    if unit == "%":
        percent = 100.0 * value
        return f"{percent:.{OTHER_DIGITS if 0.0 < abs(percent) < 1.0 else PERCENT_DIGITS}f}"
    return f"{value:.{OTHER_DIGITS}f}" if abs(value) < 100 else f"{value:.0f}"


def interval(value: Interval, unit: Unit) -> str:
    """Return ``value [low, high]``."""
    return f"{number(value.value, unit)} [{number(value.low, unit)}, {number(value.high, unit)}]"


def _bar(bar: Bar | None, unit: Unit) -> str:
    if bar is None:
        return ""
    if math.isinf(bar.high):
        return f">= {number(bar.low, unit)}"
    if math.isinf(bar.low):
        return f"<= {number(bar.high, unit)}"
    return f"{number(bar.low, unit)} to {number(bar.high, unit)}"


def markdown(section: Section) -> str:
    """Return a section as Markdown."""
    rows = tuple(
        (f.name, interval(f.value, f.unit), f.unit, str(f.count), _bar(f.bar, f.unit),
         "" if f.bar is None else "met" if f.met else "MISSED")
        for f in section.figures
    )  # fmt: skip
    head = ("figure", "value [95 % interval]", "unit", "n", "bar", "")
    parts = [f"## {section.name}"]
    if rows:
        parts.append(_aligned(Table("", head, rows)))
    for table in section.tables:
        parts += [f"### {table.title}", _aligned(table)]
    parts += [f"- {note}" for note in section.notes]
    return "\n\n".join(parts) + "\n"


def _aligned(table: Table) -> str:
    widths = [max(len(row[k]) for row in (table.head, *table.rows)) for k in range(len(table.head))]

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)) + " |"

    return "\n".join([line(table.head), line(["-" * w for w in widths]), *(line(row) for row in table.rows)])


def document(section: Section) -> dict[str, Any]:
    """Return a section as plain JSON values (``null`` for what is no number)."""

    def plain(x: float) -> float | None:
        return float(x) if math.isfinite(x) else None

    return {
        "section": section.name,
        "figures": [
            {
                "name": f.name,
                "value": plain(f.value.value),
                "low": plain(f.value.low),
                "high": plain(f.value.high),
                "count": f.count,
                "unit": f.unit,
                "bar": None if f.bar is None else [plain(f.bar.low), plain(f.bar.high)],
                "met": f.met,
            }
            for f in section.figures
        ],
        "tables": [{"title": t.title, "head": t.head, "rows": t.rows} for t in section.tables],
        "notes": list(section.notes),
        "data": section.data,
    }
