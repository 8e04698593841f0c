"""The corridor: the only place that knows the order of the stages."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from photomap_gis.pipeline.control import ControlRequest
    from photomap_gis.pipeline.deliver import export_files, export_mission
    from photomap_gis.pipeline.flight import map_flight
    from photomap_gis.pipeline.formats import ExportOptions, Format
    from photomap_gis.pipeline.graph import export_graph
    from photomap_gis.pipeline.resolve import Pick, georeference, reference_mission, solve_again
    from photomap_gis.pipeline.settings import Drawing, MapSettings
    from photomap_gis.pipeline.summary import MapSummary

__all__ = [
    "ControlRequest",
    "Drawing",
    "ExportOptions",
    "Format",
    "MapSettings",
    "MapSummary",
    "Pick",
    "export_files",
    "export_graph",
    "export_mission",
    "georeference",
    "map_flight",
    "reference_mission",
    "solve_again",
]

_HOMES = {
    "control": ("ControlRequest",),
    "deliver": ("export_files", "export_mission"),
    "flight": ("map_flight",),
    "formats": ("ExportOptions", "Format"),
    "graph": ("export_graph",),
    "resolve": ("Pick", "georeference", "reference_mission", "solve_again"),
    "settings": ("Drawing", "MapSettings"),
    "summary": ("MapSummary",),
}
"""Imported when asked for: a plan's preview must not wait for the solver and the formats (0.8 s of 1.3 s)."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
