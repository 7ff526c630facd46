"""Rest meshes: triangles in 2D, tetrahedra in 3D, through the same code."""

from runtime.mesh.box import box_mesh
from runtime.mesh.check import oriented_mesh
from runtime.mesh.mesh import Mesh
from runtime.mesh.mesh_file import read_mesh, write_mesh
from runtime.mesh.ordering import in_morton_order

__all__ = ["Mesh", "box_mesh", "in_morton_order", "oriented_mesh", "read_mesh", "write_mesh"]
