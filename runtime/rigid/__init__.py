"""Colliders that move freely: their mass, their flight, and what they feel of what they touch."""

from runtime.rigid.flight import FreeFlight, RigidMotion
from runtime.rigid.free_collider import FreeCollider, free_collider
from runtime.rigid.mass import MassProperties, mass_properties

__all__ = [
    "FreeCollider",
    "FreeFlight",
    "MassProperties",
    "RigidMotion",
    "free_collider",
    "mass_properties",
]
