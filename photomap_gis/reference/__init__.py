"""Existing imagery as the reference: frames found in an older orthophoto, and which of the finds to believe."""

from photomap_gis.reference.imagery import Patch, ReferenceImage
from photomap_gis.reference.locate import locations
from photomap_gis.reference.match import Expected, Register, agreed, find_ties, places_of

__all__ = ["Expected", "Patch", "ReferenceImage", "Register", "agreed", "find_ties", "locations", "places_of"]
