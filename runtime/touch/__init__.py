"""Tactile sensing of a soft body, step by step.

Contact pressure, traction and strain at its surface:

places   where it is measured: the body's surface samples, or points by their coordinates
sensor   the measured values after a step
series   their time series, as a table and as a picture

What a camera behind a soft pad sees:

pad_side         a side of a body, its plane and its surface
tactile_camera   markers, depth image, force and torque after a step
camera_series    their time series, as arrays and as a picture
"""

from softprint.runtime.touch.places import TouchPlaces, point_places, surface_places
from softprint.runtime.touch.sensor import Touch, TouchSensor
from softprint.runtime.touch.tactile_camera import TactileCamera, TactileImage

__all__ = [
    "TactileCamera",
    "TactileImage",
    "Touch",
    "TouchPlaces",
    "TouchSensor",
    "point_places",
    "surface_places",
]
