"""The full solution: every camera's pose in space, the lens and the ground, from the tie points of registrations."""

from photomap_gis.slam.bundle.problem import BundleProblem, Lens, Marks, TieSet, View
from photomap_gis.slam.bundle.solve import Bundle, LensFound, bundle_adjust

__all__ = ["Bundle", "BundleProblem", "Lens", "LensFound", "Marks", "TieSet", "View", "bundle_adjust"]
