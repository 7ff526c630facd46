"""Rest meshes: triangles in 2D, tetrahedra in 3D, through the same code."""

from runtime.mesh.box import box_mesh
from runtime.mesh.check import oriented_mesh
from runtime.mesh.mesh import Mesh
from runtime.mesh.mesh_file import read_mesh, write_mesh

__all__ = ["Mesh", "box_mesh", "oriented_mesh", "read_mesh", "write_mesh"]
