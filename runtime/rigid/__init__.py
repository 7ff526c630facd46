"""Free rigid bodies: their mass, their flight, and the forces of contact on them."""

from softprint.runtime.rigid.flight import FreeFlight, RigidMotion
from softprint.runtime.rigid.free_collider import FreeCollider, free_collider
from softprint.runtime.rigid.mass import MassProperties, mass_properties

__all__ = [
    "FreeCollider",
    "FreeFlight",
    "MassProperties",
    "RigidMotion",
    "free_collider",
    "mass_properties",
]
