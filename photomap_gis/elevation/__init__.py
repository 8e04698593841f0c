"""Elevation models: heights of the ground at places, and what they are counted from."""

from photomap_gis.elevation.dem import Dem, open_dem
from photomap_gis.elevation.vertical import VerticalDatum, datum_of, geoid_m

__all__ = ["Dem", "VerticalDatum", "datum_of", "geoid_m", "open_dem"]
