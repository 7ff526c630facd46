"""What a skin feels: contact pressure, traction and strain at the surface of a soft body, step by step.

places   where: the body's surface samples, or points by their coordinates
sensor   what is felt there after a step
series   time series of it, as a table and as a picture
"""

from runtime.touch.places import TouchPlaces, point_places, surface_places
from runtime.touch.sensor import Touch, TouchSensor

__all__ = ["Touch", "TouchPlaces", "TouchSensor", "point_places", "surface_places"]
