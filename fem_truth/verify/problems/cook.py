"""Cook's membrane: a tapered panel, clamped on the left, sheared by a traction on the right.

Corners (0, 0), (48, 44), (48, 60), (0, 44) mm, 1 mm thick; 1 N in total, upward and dead, on the right edge; energy
mu/2 (J^(-2/3) I_C - 3) + kappa/4 (J^2 - 1 - 2 log J), mu = 422.5 kPa. The result is the rise of the upper right
corner [mm].
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.verify.problems.equilibrium import DeadLoad, Solid, equilibrium
from softprint.fem_truth.verify.problems.higher_order import HigherOrderElasticity
from softprint.fem_truth.verify.problems.import_witness import import_witness
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.mesh import Mesh, box_mesh

MU = 422.5e3  # Pa
WIDTH, EDGE, THICKNESS, FORCE = 0.048, 0.016, 0.001, 1.0  # m, m, m, N
TRACTION = FORCE / (EDGE * THICKNESS)  # Pa
TIP = np.array([0.048, 0.060])
_NEAR = 1e-9  # m


def material(poisson: float) -> Material:
    return make_material("isochoric_neo_hookean", 2.0 * MU * (1.0 + poisson), poisson)


def _tapered(unit: Array) -> Array:
    """Maps points of the unit square or cube to points (n, dim) [m] of the panel, with half of its thickness."""
    s, t = unit[:, 0], unit[:, 1]
    panel = 1e-3 * np.column_stack([48.0 * s, 44.0 * s + t * (44.0 * (1.0 - s) + 16.0 * s)])
    return np.column_stack([panel, 0.5 * THICKNESS * unit[:, 2:]])


def _traction(v: ufl.Argument, X: ufl.SpatialCoordinate) -> ufl.Form:
    return ufl.conditional(ufl.gt(X[0], WIDTH - _NEAR), TRACTION, 0.0) * v[1] * ufl.ds


def plane_strain(poisson: float, degree: int, count: int) -> float:
    """Triangles of this degree, `count` along each edge, in plane strain."""
    box = box_mesh([0.0] * 2, [1.0] * 2, [count] * 2)
    return _rise(
        HigherOrderElasticity(
            Solid(Mesh(_tapered(box.points), box.cells), material(poisson)), degree, _traction
        )
    )


def free_faces(poisson: float, degree: int, count: int) -> float:
    """Tetrahedra, one layer for half of the thickness, from the plane of symmetry to the free face."""
    box = box_mesh([0.0] * 3, [1.0] * 3, [count, count, 1])
    return _rise(
        HigherOrderElasticity(
            Solid(Mesh(_tapered(box.points), box.cells), material(poisson)), degree, _traction
        )
    )


def _rise(problem: HigherOrderElasticity) -> float:
    nodes = problem.nodes
    held = np.zeros(nodes.shape, dtype=bool)
    held[nodes[:, 0] < _NEAR] = True
    held[:, 2:] |= nodes[:, 2:] < _NEAR  # the plane of symmetry
    u = problem.solve(held, np.zeros(nodes.shape))
    return 1e3 * float(u[np.linalg.norm(nodes[:, :2] - TIP, axis=1) < _NEAR, 1].mean())


def softprint(poisson: float, count: int) -> float:
    """Linear triangles in plane strain, in Softprint's own assembly and minimiser."""
    box = box_mesh([0.0] * 2, [1.0] * 2, [count] * 2)
    mesh = Mesh(_tapered(box.points), box.cells)
    load = np.zeros(mesh.points.shape)
    right = mesh.facets[(mesh.points[mesh.facets, 0] > WIDTH - _NEAR).all(axis=1)]
    lengths = np.linalg.norm(mesh.points[right[:, 1]] - mesh.points[right[:, 0]], axis=1)
    np.add.at(load[:, 1], right.ravel(), np.repeat(0.5 * TRACTION * lengths, 2))
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[mesh.points[:, 0] < _NEAR] = True
    elasticity = FullSpaceElasticity(Solid(mesh, material(poisson)))
    x = equilibrium(elasticity, held, mesh.points, (DeadLoad(load, mesh.points),), tolerance=1e-7)
    return 1e3 * float((x - mesh.points)[np.linalg.norm(mesh.points - TIP, axis=1) < _NEAR, 1][0])


def witness(poisson: float, count: int) -> float:
    """scikit-fem's result in plane strain with Taylor and Hood's quadrilaterals, which do not lock."""
    import_witness()
    import skfem

    from softprint.fem_truth.verify.problems.mixed_witness import MixedWitness

    ticks = np.linspace(0.0, 1.0, count + 1)
    unit = skfem.MeshQuad.init_tensor(ticks, ticks)
    mesh = skfem.MeshQuad(_tapered(unit.p.T).T.copy(), unit.t)
    solid = MixedWitness(mesh, MU, 2.0 * MU * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson)))
    basis = solid.u_basis
    right = mesh.facets_satisfying(lambda X: X[0] > WIDTH - _NEAR, boundaries_only=True)

    @skfem.LinearForm
    def work(v: Any, w: Any) -> Any:
        return TRACTION * v[1]

    load = work.assemble(skfem.FacetBasis(mesh, basis.elem, facets=right, intorder=4))
    free = basis.complement_dofs(basis.get_dofs(lambda X: X[0] < _NEAR))
    u = solid.solve(load, free, steps=6)
    tip = int(np.argmin(np.linalg.norm(mesh.p.T - TIP, axis=1)))
    return 1e3 * float(u[basis.nodal_dofs[1, tip]])
