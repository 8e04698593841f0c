"""From measured motions to one consistent map: candidates for loops, the pose graph, its solution, placements."""

from photomap_gis.slam.build import GraphBuilder
from photomap_gis.slam.candidates import Candidate, candidates
from photomap_gis.slam.optimize import solve
from photomap_gis.slam.place import placements

__all__ = ["Candidate", "GraphBuilder", "candidates", "placements", "solve"]
