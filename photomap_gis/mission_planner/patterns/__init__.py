"""Search patterns by their IAMSAR names, what they cover, and the probability that they find."""

from photomap_gis.mission_planner.patterns.detection import Detection, detection, sweep_width_m
from photomap_gis.mission_planner.patterns.shapes import Pattern, Track, from_area, from_datum, from_line

__all__ = ["Detection", "Pattern", "Track", "detection", "from_area", "from_datum", "from_line", "sweep_width_m"]
