"""From measured motions to one consistent map: candidates for loops, the pose graph, its solution, placements."""

from photomap_gis.slam.build import GraphBuilder, sloped_motion
from photomap_gis.slam.candidates import Candidate, candidates
from photomap_gis.slam.optimize import solve
from photomap_gis.slam.place import placements
from photomap_gis.slam.slope import looks_level, slopes_of_frames

__all__ = [
    "Candidate",
    "GraphBuilder",
    "candidates",
    "looks_level",
    "placements",
    "sloped_motion",
    "slopes_of_frames",
    "solve",
]
