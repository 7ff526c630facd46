"""Hyperelastic materials (one file each in `materials/`) and the elastic energy of meshes and of reduced bodies."""

from softprint.runtime.elasticity.materials import MATERIALS, Material, make_material

__all__ = ["MATERIALS", "Material", "make_material"]
