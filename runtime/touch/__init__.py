"""Tactile sensing: contact pressure, traction and strain at the surface of a soft body, step by step.

places   where it is measured: the body's surface samples, or points by their coordinates
sensor   the measured values after a step
series   their time series, as a table and as a picture
"""

from softprint.runtime.touch.places import TouchPlaces, point_places, surface_places
from softprint.runtime.touch.sensor import Touch, TouchSensor

__all__ = ["Touch", "TouchPlaces", "TouchSensor", "point_places", "surface_places"]
