"""Reduced bodies: handles, subspace basis, cubature, and the body file."""

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.body_file import load_body, read_recipe, save_body
from softprint.runtime.body.build import assemble_body, body_recipe, build_body
from softprint.runtime.body.cubature import Cubature
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.body.placement import frame_in_box, place_handles
from softprint.runtime.body.surface_samples import SurfaceSamples

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
