"""Hyperelastic materials and the elastic energy of simplex meshes and of reduced bodies."""

from runtime.elasticity.materials import Linear, Material, NeoHookean, StableNeoHookean, make_material

__all__ = ["Linear", "Material", "NeoHookean", "StableNeoHookean", "make_material"]
