"""Rigid colliders as smooth signed distances, their poses and their paths."""

from runtime.colliders.analytic import Box, Sphere
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.path import KeyframedPath
from runtime.colliders.pose import RigidPose

__all__ = ["Box", "Collider", "KeyframedPath", "RigidPose", "SdfDerivatives", "Sphere"]
