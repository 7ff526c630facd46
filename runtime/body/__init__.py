"""Reduced bodies: handles, subspace basis, cubature, and the file that keeps them."""

from runtime.body.body import ReducedBody
from runtime.body.body_file import load_body, read_recipe, save_body
from runtime.body.build import assemble_body, body_recipe, build_body
from runtime.body.cubature import Cubature
from runtime.body.handles import FrameHandle, Handles
from runtime.body.material_points import MaterialPoints
from runtime.body.placement import frame_in_box, place_handles
from runtime.body.surface_samples import SurfaceSamples

__all__ = [
    "Cubature",
    "FrameHandle",
    "Handles",
    "MaterialPoints",
    "ReducedBody",
    "SurfaceSamples",
    "assemble_body",
    "body_recipe",
    "build_body",
    "frame_in_box",
    "load_body",
    "place_handles",
    "read_recipe",
    "save_body",
]
