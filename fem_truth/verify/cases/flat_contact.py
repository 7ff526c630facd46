"""Contact on facets: uniform pressure between flat faces, and a ball on a flat surface that does not give way."""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.equilibrium import Solid, equilibrium
from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Plane, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh import Mesh, box_mesh

YOUNG, POISSON, EDGE, LOWERED = 2e4, 0.4, 0.1, 1e-3
STIFFNESS = 1e12
RADIUS, DEPTH = 0.02, 5e-4
_PATCH = "E' (d - e) / L = k e^2 for the penetration e; E' = E, in plane strain E / (1 - nu^2)"


def _patch(dim: int, refinement: int) -> list[Row]:
    """A block between rollers and a lowered plane."""
    mesh = box_mesh([0.0] * dim, [EDGE] * dim, [4] * dim)
    elasticity = FullSpaceElasticity(Solid(mesh, make_material("linear", YOUNG, POISSON)))
    up = np.eye(dim)[-1]
    contact = SurfaceContact(
        PenaltyContact(STIFFNESS),
        SurfaceQuadrature.on_facets(mesh.points, mesh.facets, refinement),
        Plane(-up),
        RigidPose(np.eye(dim), (EDGE - LOWERED) * up),
    )
    x = equilibrium(elasticity, mesh.points == 0.0, mesh.points.copy(), (contact,), tolerance=1e-12)
    modulus = YOUNG / (1.0 - POISSON**2) if dim == 2 else YOUNG
    # k e^2 + (E'/L) e - (E'/L) d = 0
    slope = modulus / EDGE
    penetration = 2.0 * LOWERED / (1.0 + np.sqrt(1.0 + 4.0 * STIFFNESS * LOWERED / slope))
    force = STIFFNESS * penetration**2 * EDGE ** (dim - 1)
    F = mesh.deformation_gradients(x)
    label = f"{dim}D, {refinement ** (dim - 1)} points a facet"
    return [
        Row(
            f"{label}: force",
            "N",
            force,
            _PATCH,
            float(contact.gradient(x)[:, -1].sum()),
            1e-10 * force,
            "required: the patch test",
        ),
        Row(
            f"{label}: strain that is not uniform",
            "",
            0.0,
            "a uniform pressure strains the block uniformly",
            float(np.abs(F - F.mean(axis=0)).max()) / (LOWERED / EDGE),
            1e-10,
            "required: the patch test",
        ),
    ]


def _ball_force(mesh: Mesh, points: SurfaceQuadrature, place: Array) -> float:
    """The force [N] on a ball that is DEPTH deep in the flat top of a body at rest, at a place (2,) [m]."""
    pose = RigidPose(np.eye(3), np.append(place, EDGE + RADIUS - DEPTH))
    contact = SurfaceContact(PenaltyContact(STIFFNESS), points, Sphere(RADIUS), pose)
    return -float(contact.gradient(mesh.points)[:, -1].sum())


def _ball(quick: bool) -> tuple[list[Row], Curve]:
    """The mean error over places of the ball."""
    mesh = box_mesh([0.0] * 3, [EDGE] * 3, [20, 20, 2])
    force = -2.0 / 3.0 * np.pi * STIFFNESS * (RADIUS - DEPTH) * DEPTH**3
    places = 0.5 * EDGE + EDGE / 20 * np.random.default_rng(0).random((8 if quick else 40, 2))
    refinements = np.array([1, 2, 4, 8, 16])
    rules = [SurfaceQuadrature.on_facets(mesh.points, mesh.facets, int(n)) for n in refinements]
    rules.insert(0, SurfaceQuadrature.at_nodes(mesh.surface_nodes, mesh.surface_areas))
    errors = np.array(
        [
            np.sqrt(np.mean([(_ball_force(mesh, rule, at) / force - 1.0) ** 2 for at in places]))
            for rule in rules
        ]
    )
    source = "F = 2/3 pi k (R - d) d^3, the integral of k depth^2 n over the disc of contact"
    order = float(np.log2(errors[3] / errors[5]) / 2)
    rows = [
        Row(
            "ball between nodes: error of the force, 256 points a facet",
            "",
            0.0,
            source,
            float(errors[5]),
            1e-4,
            "some 1,300 points lie in the disc of contact, at whose edge the pressure vanishes with its slope",
        ),
        Row(
            "order of that error in the distance of points, from 4 to 16 along an edge",
            "",
            2.0,
            "the midpoint rule; the pressure and its slope vanish at the edge of contact",
            order,
            0.5,
            "with four points along an edge the disc of contact, 1.8 cells wide, has some 80 points",
            order,
            ">=",
        ),
    ]
    curve = Curve(
        "Force on a ball between nodes",
        "points along an edge of a facet",
        "error of the force (RMS over places)",
        (
            Line("on facets", refinements, errors[1:]),
            Line("at nodes", refinements[[0, -1]], errors[[0, 0]], "reference"),
        ),
        log=True,
    )
    return rows, curve


def run(quick: bool) -> CaseResult:
    """A quick run has fewer places of the ball."""
    patch = [row for dim in (2, 3) for refinement in (1, 3) for row in _patch(dim, refinement)]
    ball, curve = _ball(quick)
    return CaseResult((*patch, *ball), (curve,))


CASE = Case(
    name="flat_contact",
    title="Contact on facets",
    statement=(
        "Penalty contact at midpoint rules on the facets of the surface. First a block of small-strain elasticity "
        "between rollers and a plane that is lowered by d: pressure and strain are uniform (the patch test; with "
        "contact at nodes they are not, because the nodes at the edge of the base have a share of the sides). Then a "
        "rigid ball, deep in a flat surface that does not give way, at random places: its force has a closed form, to "
        "which the rules converge."
    ),
    sources=(
        "P. Wriggers, Computational Contact Mechanics, 2006, chapter 6 (penalty).",
        "R. L. Taylor, P. Papadopoulos, On a patch test for contact problems in two dimensions, 1991.",
    ),
    run=run,
)
