"""Pairs of places, one on the map and one on Earth: what a table holds, and what the engine is asked with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from qgis.core import QgsCoordinateReferenceSystem, QgsPointXY

from ..places import PlaceError, from_lonlat, moved_m


@dataclass(frozen=True)
class Miss:
    """How far the solved map shows a pair's place off (map minus Earth), metres; ``used`` where it is in the fit."""

    east_m: float
    north_m: float
    sigma_m: float
    used: bool

    @property
    def metres(self) -> float:
        """Return the distance."""
        return (self.east_m**2 + self.north_m**2) ** 0.5


@dataclass(frozen=True)
class Pair:
    """A place of ``map.tif`` in its own coordinates, and where it is (degrees); either may still be missing.

    A pair for the ``check`` tests the map and has no part in its fit.
    """

    map_xy: tuple[float, float] | None = None
    lonlat: tuple[float, float] | None = None
    check: bool = False
    miss: Miss | None = None

    @property
    def whole(self) -> bool:
        """Whether both places are known."""
        return self.map_xy is not None and self.lonlat is not None

    @property
    def word(self) -> str:
        """Return the pair as ``photomap georeference --pick`` takes it."""
        assert self.map_xy is not None and self.lonlat is not None
        (x, y), (lon, lat) = self.map_xy, self.lonlat
        return f"{x:.6f},{y:.6f}={lat:.9f},{lon:.9f}"


def pick_arguments(pairs: list[Pair]) -> dict:
    """Return the picks among the arguments of the job ``georeference``; ``ValueError`` says what is missing."""
    whole = [p for p in pairs if p.whole]
    if not any(not p.check for p in whole):
        raise ValueError("no pair is for the fit: pick a place on the map and where it is, or make a check point one")
    return {
        "pick": [p.word for p in whole if not p.check],
        "check_pick": [p.word for p in whole if p.check],
    }


def solved_pairs(pairs: list[Pair], control: dict | None, crs: QgsCoordinateReferenceSystem) -> list[Pair]:
    """Return the pairs with what the solved map misses them by, and where it shows them now.

    ``control`` is that part of the engine's document; its picks are named in the order in which they were asked.
    ``crs`` is the map's. A pair of which the engine says nothing keeps its place and loses its miss.
    """
    by_name = {p["name"]: p for p in (control or {}).get("points", [])}
    counts = {False: 0, True: 0}
    solved = []
    for pair in pairs:
        if not pair.whole:
            solved.append(pair)
            continue
        counts[pair.check] += 1
        point = by_name.get(f"{'check' if pair.check else 'pick'}-{counts[pair.check]}")
        if point is None:
            solved.append(replace(pair, miss=None))
            continue
        miss = Miss(point["dx_m"], point["dy_m"], point["predicted_sigma_m"], point["used"])
        try:
            shown = from_lonlat(moved_m(QgsPointXY(*pair.lonlat), miss.east_m, miss.north_m), crs)
            solved.append(replace(pair, map_xy=(shown.x(), shown.y()), miss=miss))
        except PlaceError:
            solved.append(replace(pair, miss=miss))
    return solved
