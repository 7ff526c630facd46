"""Reduced bodies: handles, subspace basis, cubature, and the file that keeps them."""

from runtime.body.body import ReducedBody
from runtime.body.cubature import Cubature
from runtime.body.handles import FrameHandle, Handles
from runtime.body.material_points import MaterialPoints
from runtime.body.surface_samples import SurfaceSamples

__all__ = ["Cubature", "FrameHandle", "Handles", "MaterialPoints", "ReducedBody", "SurfaceSamples"]
