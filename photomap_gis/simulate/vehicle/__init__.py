"""A simulated vehicle that holds missions as ArduPilot and PX4 do, faults included.

``python -m photomap_gis.simulate.vehicle`` runs it over real UDP and TCP.
"""

from photomap_gis.simulate.vehicle.airframe import Airframe, Misbehaviour, Place
from photomap_gis.simulate.vehicle.ardupilot import ArduPilot
from photomap_gis.simulate.vehicle.channel import Weather
from photomap_gis.simulate.vehicle.px4 import PX4
from photomap_gis.simulate.vehicle.virtual import VirtualLink

__all__ = ["PX4", "Airframe", "ArduPilot", "Misbehaviour", "Place", "VirtualLink", "Weather"]
