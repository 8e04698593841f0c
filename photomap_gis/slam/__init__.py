"""From measured motions to one consistent map: candidates for loops, the pose graph, its solution, placements."""

from photomap_gis.slam.build import GraphBuilder, bend_of
from photomap_gis.slam.candidates import Candidate, candidates
from photomap_gis.slam.lag import ErrorModel, estimate_lag, find_shift
from photomap_gis.slam.misfit import edge_misfits
from photomap_gis.slam.optimize import solve
from photomap_gis.slam.place import placements
from photomap_gis.slam.slope import slopes_of_frames
from photomap_gis.slam.tilt import Leaning, estimate_tilts, leans, level_from_tilt

__all__ = [
    "Candidate",
    "ErrorModel",
    "GraphBuilder",
    "Leaning",
    "bend_of",
    "candidates",
    "edge_misfits",
    "estimate_lag",
    "estimate_tilts",
    "find_shift",
    "leans",
    "level_from_tilt",
    "placements",
    "slopes_of_frames",
    "solve",
]
