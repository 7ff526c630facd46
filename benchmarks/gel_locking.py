"""How much too stiff linear tetrahedra make a nearly incompressible gel pad (locking), by Poisson's ratio.

    python -m benchmarks.gel_locking [MESH ...] [--poisson 0.40 0.43 0.45 0.48 0.49]

A press like Hertz's, in linear elasticity: a pressure p0 (1 - r^2/a^2)^2 over a circle of a = 1.7 mm in the middle of
the surface that touches, the contact of a ball of 4 mm that is 0.7 mm deep; the back is held. Printed is the stiffness,
force over the mean displacement under the pressure, of linear tetrahedra relative to that of quadratic ones on the
first mesh, which hardly lock. Needs scikit-fem.
"""

from __future__ import annotations

import argparse
from inspect import signature
from typing import Any

import numpy as np
import skfem
from scipy.sparse import diags
from scipy.sparse.linalg import cg
from skfem.models.elasticity import lame_parameters, linear_elasticity

from softprint.runtime.cli.script import run_script
from softprint.runtime.mesh import Mesh, read_mesh

RADIUS, YOUNG = 1.7e-3, 1.23e5  # m, Pa
# What scipy calls the relative tolerance, before and since 1.12.
_TOLERANCE = "rtol" if "rtol" in signature(cg).parameters else "tol"
MESHES = ["meshes/gel_pad_small.vtu", "meshes/gel_pad.vtu"]


def stiffness(mesh: Mesh, element: Any, poisson: float) -> float:
    """Force over displacement [N/m]."""
    tetrahedra = skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.copy())
    vectors = skfem.ElementVector(element)
    top = mesh.points[:, 2].max() - 1e-7
    touching = tetrahedra.facets_satisfying(lambda x: x[2] > top, boundaries_only=True)
    inside = skfem.Basis(tetrahedra, vectors)
    surface = skfem.FacetBasis(tetrahedra, vectors, facets=touching, intorder=6)

    @skfem.LinearForm
    def pressure(v: Any, w: Any) -> Any:
        near = 1.0 - (w.x[0] ** 2 + w.x[1] ** 2) / RADIUS**2
        return -(np.maximum(near, 0.0) ** 2) * v[2]

    K = linear_elasticity(*lame_parameters(YOUNG, poisson)).assemble(inside)
    b = pressure.assemble(surface)
    held = inside.get_dofs(elements=lambda x: x[2] < 0.0).all()
    free = np.setdiff1d(np.arange(len(b)), held)
    K, b = K[free][:, free].tocsr(), b[free]
    u, failed = cg(K, b, **{_TOLERANCE: 1e-7}, maxiter=20_000, M=diags(1.0 / K.diagonal()))
    assert not failed, "the conjugate gradients did not converge"
    return float((np.pi * RADIUS**2 / 3.0) ** 2 / (b @ u))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("meshes", nargs="*", default=MESHES, metavar="MESH")
    parser.add_argument(
        "--poisson", type=float, nargs="+", default=[0.40, 0.43, 0.45, 0.48, 0.49], metavar="NU"
    )
    given = parser.parse_args()
    meshes = [read_mesh(path) for path in given.meshes]
    print("   nu  quadratic N/m  linear, too stiff: " + ", ".join(f"{mesh.n_cells} cells" for mesh in meshes))
    for poisson in given.poisson:
        right = stiffness(meshes[0], skfem.ElementTetP2(), poisson)
        found = [stiffness(mesh, skfem.ElementTetP1(), poisson) / right - 1.0 for mesh in meshes]
        print(f"{poisson:5.2f}  {right:13.1f}  " + "  ".join(f"{error:7.1%}" for error in found), flush=True)


if __name__ == "__main__":
    run_script(main)
