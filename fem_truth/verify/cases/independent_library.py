"""scikit-fem assembles the same forces and stiffness, and solves the same large deformation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.potentials import Gravity
from softprint.fem_truth.verify.case import Case, CaseResult, Row
from softprint.fem_truth.verify.problems.equilibrium import Solid, equilibrium
from softprint.fem_truth.verify.problems.import_witness import import_witness
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh import Mesh, box_mesh

if TYPE_CHECKING:
    from softprint.fem_truth.verify.problems.witness import Witness

POISSON, DENSITY = 0.4, 1000.0
_SOURCE = "scikit-fem, stresses and tangents of the published laws written out by hand"
_ROUND_OFF = 1e-12


def _block(dim: int) -> tuple[Mesh, Array]:
    """A block of 10 x (10 x) 5 cm and Young's modulus of its cells; the upper half is twice as stiff as the lower."""
    lower, upper = ([-0.05] * (dim - 1) + [0.0], [0.05] * dim)
    mesh = box_mesh(lower, upper, [12, 6] if dim == 2 else [5, 5, 3])
    return mesh, np.where(mesh.cell_centroids[:, -1] > 0.025, 2e4, 1e4)


def _bent(mesh: Mesh) -> Array:
    """A large homogeneous deformation plus a random one: strains of 40 %, no inverted cell."""
    rng = np.random.default_rng(3)
    stretch = np.eye(mesh.dim) + 0.3 * rng.uniform(-1, 1, (mesh.dim, mesh.dim))
    return mesh.points @ stretch.T + 1e-3 * rng.standard_normal(mesh.points.shape)


def _assembly_rows(label: str, ours: FullSpaceElasticity, witness: Witness) -> list[Row]:
    x = _bent(ours.mesh)
    forces, stiffness = witness.forces(x), witness.stiffness(x)
    differences = {
        "forces": np.abs(ours.gradient(x) - forces).max() / np.abs(forces).max(),
        "stiffness": np.abs(ours.hessian(x).sparse() - stiffness).max() / np.abs(stiffness).max(),
    }
    return [
        Row(
            f"{label}: difference of {name}",
            "",
            0.0,
            _SOURCE,
            float(difference),
            _ROUND_OFF,
            "sums of some hundred float64 products in another order",
        )
        for name, difference in differences.items()
    ]


def _solution_row(label: str, ours: FullSpaceElasticity, witness: Witness) -> Row:
    mesh = ours.mesh
    gravity = np.array([100.0, 0.0, -20.0] if mesh.dim == 3 else [100.0, -20.0])
    clamped = np.flatnonzero(mesh.points[:, -1] < 1e-9)
    theirs = witness.solve(witness.weight(DENSITY * gravity), clamped)
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[clamped] = True
    load = Gravity(DENSITY * mesh.node_volumes, gravity, mesh.points)
    x = equilibrium(ours, held, mesh.points, (load,), tolerance=1e-10)
    largest = float(np.abs(theirs - mesh.points).max())
    return Row(
        f"{label}: difference when bent by {1e3 * largest:.0f} mm",
        "",
        0.0,
        f"{_SOURCE}, Newton's method with a sparse factorisation",
        float(np.abs(x - theirs).max()) / largest,
        1e-8,
        "both stop at 1e-10 of the forces; the softest mode has up to 1e2 times that in displacement",
    )


def run(quick: bool) -> CaseResult:
    """A quick run has one law in 3D and all laws in 2D."""
    witnesses = import_witness()
    rows = []
    for dim in (2, 3):
        mesh, young = _block(dim)
        for law in witnesses.LAWS:
            if quick and dim == 3 and law != "stable_neo_hookean":
                continue
            label = f"{law.replace('_neo_hookean', '').replace('neo_hookean', 'logarithmic')}, {dim}D"
            ours = FullSpaceElasticity(Solid(mesh, make_material(law, young, POISSON)))
            witness = witnesses.Witness(mesh, young, POISSON, law)
            rows += [*_assembly_rows(label, ours, witness), _solution_row(label, ours, witness)]
    return CaseResult(tuple(rows))


CASE = Case(
    name="independent_library",
    title="The same in another library",
    statement=(
        "Forces W'(x) and stiffness W''(x) of a block of two materials at strains of 40 % are assembled by "
        "Softprint (energy in UFL, differentiated by UFL, compiled by FFCx, assembled by DOLFINx) and by "
        "scikit-fem (stress and tangent written out by hand, assembled in numpy). Then the block, with a fixed "
        "base, is bent by a body force of ten times gravity, and both solve for the equilibrium. "
        "Differences are the largest over all entries, relative to the largest entry."
    ),
    sources=(
        "T. Gustafsson, G. D. McBain, scikit-fem: A Python package for finite element assembly, JOSS 5(52), 2020.",
    ),
    run=run,
)
