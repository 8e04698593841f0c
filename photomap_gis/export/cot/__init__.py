"""Cursor on Target: the drone, what it sees and what was found, live on the team's ATAK devices."""

from photomap_gis.export.cot.address import CotAddress, Tls, cot_address
from photomap_gis.export.cot.events import CotDrone, CotFind, CotFootprint, encode, encode_removal, stable_uid
from photomap_gis.export.cot.finds import cot_find
from photomap_gis.export.cot.push import CotPusher, CotState

__all__ = [
    "CotAddress",
    "CotDrone",
    "CotFind",
    "CotFootprint",
    "CotPusher",
    "CotState",
    "Tls",
    "cot_address",
    "cot_find",
    "encode",
    "encode_removal",
    "stable_uid",
]
