"""The ground under finds: of a mission that is finished, and of one that is being flown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photomap_gis.core.accuracy import covariance_by_placements_m2
from photomap_gis.core.find import FindAnchor
from photomap_gis.core.grid import MapFrame
from photomap_gis.core.similarity import FloatArray
from photomap_gis.export.crs import point_map
from photomap_gis.server.find_desk import Rgb, on_white
from photomap_gis.server.live_mission import LiveMission
from photomap_gis.server.live_view import Anchor
from photomap_gis.server.missions import ServedMission

_SIDE_PX = 320


@dataclass(frozen=True, slots=True)
class FinishedGround:
    """A finished map: it does not move, so nothing hangs on frames."""

    mission: ServedMission

    @property
    def map_frame(self) -> MapFrame:
        """Where the map lies."""
        return self.mission.current().view.map_frame

    def covariance_at(self, xy_map_m: tuple[float, float]) -> FloatArray | None:
        """``(2, 2)`` predicted covariance of a place."""
        found = covariance_by_placements_m2(self.mission.current().view.placements, [xy_map_m])[0]
        return found if np.isfinite(found).all() else None

    def anchor_at(self, xy_map_m: tuple[float, float]) -> FindAnchor | None:
        """Nothing."""
        return None

    def place_of(self, anchor: FindAnchor) -> tuple[float, float] | None:
        """Nothing: a find of the flight stays where the flight's last solution had it."""
        return None

    def picture_at(self, xy_map_m: tuple[float, float], anchor: FindAnchor | None) -> Rgb | None:
        """The map about the place."""
        snapshot = self.mission.current()
        x, y = (float(v) for v in snapshot.view.map_frame.to_crs([xy_map_m])[0])
        layer = snapshot.layers[0]
        place = snapshot.view.map_frame.crs_wkt
        if place is not None and layer.grid.crs_wkt is not None:
            x, y = (float(v) for v in point_map(place, layer.grid.crs_wkt)([[x, y]])[0])
        return on_white(layer.around((x, y), _SIDE_PX))


@dataclass(frozen=True, slots=True)
class LiveGround:
    """A map that grows and moves: finds hang on the frames that show them."""

    mission: LiveMission

    @property
    def map_frame(self) -> MapFrame:
        """Where the map lies now."""
        return self.mission.session.state.map_frame

    def covariance_at(self, xy_map_m: tuple[float, float]) -> FloatArray | None:
        """``(2, 2)`` predicted covariance of a place."""
        return self.mission.session.covariance_at(xy_map_m)

    def anchor_at(self, xy_map_m: tuple[float, float]) -> FindAnchor | None:
        """The key frame that shows a place best."""
        found = self.mission.session.anchor_at(xy_map_m)
        return None if found is None else FindAnchor(found.frame, round(found.x_px, 2), round(found.y_px, 2))

    def place_of(self, anchor: FindAnchor) -> tuple[float, float] | None:
        """Where an anchor lies by the newest solution."""
        return self.mission.session.place_of(Anchor(anchor.frame, anchor.x_px, anchor.y_px))

    def picture_at(self, xy_map_m: tuple[float, float], anchor: FindAnchor | None) -> Rgb | None:
        """The frame about the place, else the map."""
        if anchor is not None:
            seen = self.mission.session.picture_at(Anchor(anchor.frame, anchor.x_px, anchor.y_px))
            if seen is not None and seen.size:
                return seen
        x, y = (float(v) for v in self.map_frame.to_crs([xy_map_m])[0])
        return on_white(self.mission.layers[0].around((x, y), _SIDE_PX))
