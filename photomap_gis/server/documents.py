"""Snapshots as the protocol's documents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast

from photomap_gis.server.layers import Layer
from photomap_gis.server.missions import NOT_GEOREFERENCED, ServedMission, Snapshot
from photomap_gis.server.protocol import LayerDocument, LegendDocument, MissionDocument, SchemeDocument
from photomap_gis.server.ramp import STOPS


def mission_document(mission: ServedMission, snapshot: Snapshot) -> MissionDocument:
    """Return all that a page needs to begin; addresses in it are relative to the server's root."""
    view, root = snapshot.view, f"missions/{mission.id}"
    start, end = snapshot.span_utc
    links = {
        "frames": f"{root}/frames.geojson",
        "track": f"{root}/track.geojson",
        "finds": f"{root}/finds.geojson",
    }
    if view.georeferenced:
        links |= {"wmts": f"{root}/wmts.xml", "tilejson": f"{root}/layers/map/tiles.json"}
    return MissionDocument(
        id=mission.id,
        name=view.name,
        epoch=snapshot.epoch,
        revision=view.revision,
        georeferenced=view.georeferenced,
        note="" if view.georeferenced else NOT_GEOREFERENCED,
        crs=view.crs_label,
        bounds=snapshot.layers[0].scheme.bounds,
        layers=[_layer_document(layer, root, snapshot.pictures) for layer in snapshot.layers],
        frames=snapshot.counts,
        start_utc=start,
        end_utc=end,
        pieces=list(view.pieces),
        accuracy=dict(view.accuracy),
        accuracy_words=accuracy_words(view.accuracy, georeferenced=view.georeferenced),
        warnings=list(view.warnings),
        links=links,
    )


def accuracy_words(accuracy: Mapping[str, Any], *, georeferenced: bool) -> list[str]:
    """Return what is known of the map's accuracy in words: tested apart from predicted, and both apart from the fit."""
    if not georeferenced:
        return [NOT_GEOREFERENCED]
    words = []
    if (found := accuracy.get("accuracy")) is not None:
        words.append(
            f"Tested: CE90 {found['ce90_m']:.2f} m, NSSDA {found['nssda_95_m']:.2f} m at 95 %, by {found['method']}"
        )
    if (ce90 := accuracy.get("predicted_ce90_m")) is not None:
        untested = "" if found is not None else "; no check points test it"
        words.append(f"Predicted: CE90 {ce90:.1f} m by the solution's covariances{untested}")
    if (rms := accuracy.get("fit_to_gps_rms_m")) is not None:
        words.append(f"Fit to GPS {rms:.2f} m RMS (not the accuracy)")
    return words or ["Accuracy unknown"]


def tile_json(mission: ServedMission, snapshot: Snapshot, layer: Layer, tiles_url: str) -> dict[str, Any]:
    """Return TileJSON 3.0 of a layer."""
    west, south, east, north = layer.scheme.bounds
    words = accuracy_words(snapshot.view.accuracy, georeferenced=snapshot.view.georeferenced)
    return {
        "tilejson": "3.0.0",
        "name": f"{snapshot.view.name}: {layer.title}",
        "description": "; ".join(words),
        "version": "1.0.0",
        "scheme": "xyz",
        "tiles": [tiles_url],
        "minzoom": layer.scheme.min_zoom,
        "maxzoom": layer.scheme.max_zoom,
        "bounds": [west, south, east, north],
        "center": [(west + east) / 2.0, (south + north) / 2.0, min(layer.scheme.max_zoom, layer.scheme.min_zoom + 5)],
        "format": "png",
    }


def _layer_document(layer: Layer, root: str, epoch: str) -> LayerDocument:
    scheme = layer.scheme
    return LayerDocument(
        id=layer.id,
        title=layer.title,
        role=cast(Literal["map", "layer", "before"], layer.role),
        piece=layer.piece,
        scheme=SchemeDocument(
            kind=cast(Literal["webmercator", "local"], scheme.kind),
            min_zoom=scheme.min_zoom,
            max_zoom=scheme.max_zoom,
            bounds=scheme.bounds,
            origin_xy=scheme.origin_xy,
            unit_per_px=scheme.unit_per_px,
        ),
        tiles=f"{root}/layers/{layer.id}/{{z}}/{{x}}/{{y}}.webp?epoch={epoch}",
        legend=_legend(layer),
    )


def _legend(layer: Layer) -> LegendDocument | None:
    if layer.values is None or layer.values.ramp is None:
        return None
    ramp = layer.values.ramp
    colours = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in STOPS]
    return LegendDocument(low=ramp.low, high=ramp.high, units=layer.values.units, colours=colours)
