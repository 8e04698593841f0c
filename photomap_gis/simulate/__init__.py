"""A flight over a picture or a made scene, with known truth: for tests, the demo, benchmarks and training."""

from photomap_gis.simulate.ground import Ground, load_ground
from photomap_gis.simulate.run import SimulationResult, run_simulation
from photomap_gis.simulate.scene import procedural_scene
from photomap_gis.simulate.spec import FlightSpec, GpsError, Imaging, Motion
from photomap_gis.simulate.truth import Truth, read_truth
from photomap_gis.simulate.write import simulate_photos, simulate_video

__all__ = [
    "FlightSpec",
    "GpsError",
    "Ground",
    "Imaging",
    "Motion",
    "SimulationResult",
    "Truth",
    "load_ground",
    "procedural_scene",
    "read_truth",
    "run_simulation",
    "simulate_photos",
    "simulate_video",
]
