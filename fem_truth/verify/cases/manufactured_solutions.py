"""Orders of convergence at finite strain, in 2D and 3D, for linear and for quadratic elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from softprint.fem_truth.elasticity import dolfinx_version as dfx
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.equilibrium import DeadLoad, Solid, equilibrium
from softprint.fem_truth.verify.problems.higher_order import HigherOrderElasticity
from softprint.fem_truth.verify.problems.manufactured import Manufactured, wavy
from softprint.fem_truth.verify.problems.simplex_rule import simplex_rule
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.mesh import Mesh, box_mesh

YOUNG, POISSON = 1.0e4, 0.3
_FORCE_DEGREE = 4  # of the piecewise polynomial approximation of the body force, for quadratic elements
_ERROR_DEGREE = 8  # degree of the quadrature of errors


@dataclass(frozen=True)
class _Study:
    """One family of meshes. cells: along each edge of the unit square or cube, coarse to fine."""

    dim: int
    degree: int
    cells: Sequence[int]


_FULL = (
    _Study(2, 1, (8, 16, 32, 64)),
    _Study(2, 2, (4, 8, 16, 32)),
    _Study(3, 1, (4, 8, 16)),
    _Study(3, 2, (2, 4, 6)),
)
_QUICK = (_Study(2, 1, (8, 16, 32)), _Study(2, 2, (4, 8, 16)), _Study(3, 1, (4, 8, 12)))


def linear_errors(mesh: Mesh, material: Material, exact: Manufactured) -> tuple[float, float]:
    """L2 norms of u_h - u [m^(1 + dim/2)] and of its gradient, with P1 elements and Softprint's own solver."""
    points, weights = simplex_rule(mesh.dim, 4)
    # (n_cells, n_points, dim) quadrature points, and the share of a cell's volume of each
    places = np.einsum("qa,cai->cqi", points, mesh.points[mesh.cells])
    measure = mesh.cell_volumes[:, None] * weights

    def at_places(values: Array) -> Array:
        return values.reshape(*places.shape[:2], *values.shape[1:])

    force = at_places(exact.body_force(places.reshape(-1, mesh.dim)))
    shares = np.einsum("cq,qa,cqi->cai", measure, points, force)
    load = np.zeros_like(mesh.points)
    np.add.at(load, mesh.cells, shares)

    held = np.zeros(mesh.points.shape, dtype=bool)
    held[mesh.surface_nodes] = True
    start = mesh.points + exact.displacement(
        mesh.points
    )  # also in the interior: otherwise cells at the boundary would be inverted
    elasticity = FullSpaceElasticity(Solid(mesh, material))
    x = equilibrium(elasticity, held, start, (DeadLoad(load, mesh.points),), tolerance=1e-9)

    u = x - mesh.points
    difference = np.einsum("qa,cai->cqi", points, u[mesh.cells]) - at_places(
        exact.displacement(places.reshape(-1, mesh.dim))
    )
    slope = mesh.deformation_gradients(x) - np.eye(mesh.dim)
    slope_difference = slope[:, None] - at_places(exact.gradient(places.reshape(-1, mesh.dim)))
    return (
        float(np.sqrt((measure * (difference**2).sum(axis=2)).sum())),
        float(np.sqrt((measure * (slope_difference**2).sum(axis=(2, 3))).sum())),
    )


def higher_order_errors(
    mesh: Mesh, material: Material, exact: Manufactured, degree: int
) -> tuple[float, float]:
    """The same with higher-order elements."""

    def load(v: ufl.Argument, X: ufl.SpatialCoordinate) -> ufl.Form:
        domain = X.ufl_domain()
        force = fem.Function(dfx.vector_space(v.ufl_function_space().mesh, mesh.dim, _FORCE_DEGREE))
        force.interpolate(lambda x: exact.body_force(x[: mesh.dim].T.copy()).T)
        return ufl.inner(force, v) * ufl.dx(domain, metadata={"quadrature_degree": _FORCE_DEGREE + degree})

    problem = HigherOrderElasticity(Solid(mesh, material), degree, load)
    held = np.zeros(problem.nodes.shape, dtype=bool)
    held[(np.abs(problem.nodes - 0.5) > 0.5 - 1e-9).any(axis=1)] = True
    problem.solve(held, exact.displacement(problem.nodes))
    return (
        problem.norm(lambda X: problem.u - exact.displacement_form(X), _ERROR_DEGREE),
        problem.norm(lambda X: ufl.grad(problem.u - exact.displacement_form(X)), _ERROR_DEGREE),
    )


def _errors(study: _Study) -> list[tuple[float, float]]:
    material = make_material("neo_hookean", YOUNG, POISSON)
    exact = wavy(study.dim, float(material.lame_mu), float(material.lame_lambda))
    errors = []
    for count in study.cells:
        mesh = box_mesh([0.0] * study.dim, [1.0] * study.dim, [count] * study.dim)
        if study.degree == 1:
            errors.append(linear_errors(mesh, material, exact))
        else:
            errors.append(higher_order_errors(mesh, material, exact, study.degree))
    return errors


def run(quick: bool) -> CaseResult:
    """A quick run has coarser meshes and no quadratic tetrahedra, whose forms take long to compile."""
    rows: list[Row] = []
    lines: dict[str, list[Line]] = {"L2": [], "H1": []}
    for study in _QUICK if quick else _FULL:
        label = f"P{study.degree} in {study.dim}D"
        sizes, pairs = 1.0 / np.array(study.cells), _errors(study)
        for column, (norm, expected) in enumerate((("L2", study.degree + 1), ("H1", study.degree))):
            errors = [pair[column] for pair in pairs]
            order = float(np.log(errors[-2] / errors[-1]) / np.log(sizes[-2] / sizes[-1]))
            rows.append(
                Row(
                    f"{label}: order of the {norm} error",
                    "",
                    float(expected),
                    "theory of finite elements (Ciarlet 1978, theorems 3.2.2 and 3.2.5)",
                    order,
                    0.1,
                    "required",
                    order,
                )
            )
            lines[norm].append(Line(label, sizes, errors))
    curves = tuple(
        Curve(
            f"{norm} error",
            "cell size",
            "error of u" if norm == "L2" else "error of grad u",
            tuple(lines[norm]),
            True,
        )
        for norm in lines
    )
    return CaseResult(tuple(rows), curves)


CASE = Case(
    name="manufactured",
    title="Manufactured solutions at finite strain",
    statement=(
        "On the unit square (plane strain) and cube, u = A sin(B X + c) with strains up to 0.5 is made the solution by "
        "the body force f = -Div P of a neo-Hookean solid, P = mu (F - F^-T) + lambda log J F^-T, written out by hand "
        "and differentiated by complex steps. The boundary is fixed at u; the order at which the errors inside "
        "decrease with the cell size is compared with theory.\n\n"
        "P1 runs through Softprint's own assembly and minimiser, P2 through the same UFL energy on DOLFINx's quadratic "
        "elements with a direct solver."
    ),
    sources=("P. G. Ciarlet, The Finite Element Method for Elliptic Problems, 1978, chapter 3.",),
    run=run,
)
