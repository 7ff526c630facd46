"""Rest meshes: triangles in 2D, tetrahedra in 3D, with the same code."""

from softprint.runtime.mesh.box import box_mesh
from softprint.runtime.mesh.check import oriented_mesh
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.mesh.mesh_file import read_mesh, write_mesh
from softprint.runtime.mesh.ordering import in_morton_order

__all__ = ["Mesh", "box_mesh", "in_morton_order", "oriented_mesh", "read_mesh", "write_mesh"]
