"""A rigid ball pressed into an elastic half-space: Hertz's theory, and Softprint's contact on a quarter of a block.

    F = 4/3 E* sqrt(R) d^(3/2),   a = sqrt(R d),   p_0 = 2 E* a / (pi R),   E* = E / (1 - nu^2)

with R the radius of the ball [m], d its approach [m], a the radius of contact [m]. The half-space outside the block is
replaced by displacements of its outer faces: those of Boussinesq's half-space under the computed force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.verify.problems.equilibrium import Solid, equilibrium
from softprint.runtime.arrays import Array
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh import Mesh, box_mesh

_BLOCK = 8.0  # edge of the quarter block, in radii of contact
_FINE = 1.5  # extent of the region of uniform cell size, in radii of contact


@dataclass(frozen=True)
class Hertz:
    """The problem and its exact solution. young [Pa]; radius, approach [m]."""

    young: float
    poisson: float
    radius: float
    approach: float

    @property
    def modulus(self) -> float:
        """E* [Pa]."""
        return self.young / (1.0 - self.poisson**2)

    @property
    def force(self) -> float:
        """F [N]."""
        return 4.0 / 3.0 * self.modulus * self.radius**0.5 * self.approach**1.5

    @property
    def contact_radius(self) -> float:
        """a [m]."""
        return (self.radius * self.approach) ** 0.5

    @property
    def peak_pressure(self) -> float:
        """p_0 [Pa]."""
        return 2.0 * self.modulus * self.contact_radius / (np.pi * self.radius)

    def stiffness(self, penetration: float) -> float:
        """The penalty stiffness [N/m^4] with which the penetration at the peak pressure is this share of the
        approach."""
        return self.peak_pressure / (penetration * self.approach) ** 2


@dataclass(frozen=True, eq=False)
class Pressed:
    """Results: force on the ball [N], radius of contact [m], nodal radii (n,) [m] and pressures (n,) [Pa]."""

    force: float
    contact_radius: float
    radii: Array
    pressures: Array


def boussinesq(force: float, young: float, poisson: float, points: Array) -> Array:
    """Displacement (n, 3) [m] of the half-space z <= 0 under a force along -z at the origin (Johnson 1985, 3.18)."""
    mu = young / (2.0 * (1.0 + poisson))
    depth, distance = -points[:, 2], np.linalg.norm(points, axis=1)
    outward = depth / distance**3 - (1.0 - 2.0 * poisson) / (distance * (distance + depth))
    down = depth**2 / distance**3 + 2.0 * (1.0 - poisson) / distance
    shape = np.column_stack([outward * points[:, 0], outward * points[:, 1], -down])
    return force / (4.0 * np.pi * mu) * shape


def press(problem: Hertz, cells: int, penetration: float) -> Pressed:
    """Solve for the block under the ball. cells: along a radius of contact; penetration: see `Hertz.stiffness`."""
    mesh = _quarter_block(problem.contact_radius, cells)
    points = mesh.points
    edge = _BLOCK * problem.contact_radius
    outer = (
        (points[:, 0] > edge - 1e-9 * edge)
        | (points[:, 1] > edge - 1e-9 * edge)
        | (points[:, 2] < -edge + 1e-9 * edge)
    )
    held = np.zeros(points.shape, dtype=bool)
    held[outer] = True
    held[:, :2] |= points[:, :2] == 0.0

    top = np.flatnonzero(points[:, 2] == 0.0)
    centre = np.array([0.0, 0.0, problem.radius - problem.approach])
    contact = SurfaceContact(
        PenaltyContact(problem.stiffness(penetration)),
        SurfaceQuadrature.at_nodes(top, _top_areas(mesh)[top]),
        Sphere(problem.radius),
        RigidPose(np.eye(3), centre),
    )
    elasticity = FullSpaceElasticity(Solid(mesh, make_material("linear", problem.young, problem.poisson)))
    x = points.copy()

    def settle(assumed: float) -> float:
        """The force on the ball [N] with the outer faces displaced by the force `assumed`, and the equilibrium x."""
        nonlocal x
        x[outer] = points[outer] + boussinesq(assumed, problem.young, problem.poisson, points[outer])
        x[held & (points == 0.0)] = 0.0
        x = equilibrium(elasticity, held, x, (contact,), tolerance=1e-6)
        return 4.0 * float(contact.gradient(x)[:, 2].sum())

    # The computed force is nearly linear in the assumed force: two solutions give their intersection.
    first = settle(0.0)
    second = settle(first)
    force = settle(first / (2.0 - second / first))
    forces = -contact.gradient(x)[top]
    radii = np.linalg.norm(points[top, :2], axis=1)
    # integral p r^2 dA = 2/5 a^2 F for Hertz's p = p_0 sqrt(1 - r^2/a^2)
    moment = -4.0 * float(forces[:, 2] @ radii**2)
    return Pressed(force, float(np.sqrt(2.5 * moment / force)), radii, -forces[:, 2] / _top_areas(mesh)[top])


def _quarter_block(radius: float, cells: int) -> Mesh:
    """The block x, y >= 0 and z <= 0, with fine cells near the origin."""
    # Cells of size h sqrt(1 + (x / c)^2) along each axis, so that a finer mesh is finer everywhere.
    span = np.arcsinh(_BLOCK / _FINE)
    count = round(_FINE * cells * span)
    box = box_mesh([0.0, 0.0, -span], [span, span, 0.0], [count] * 3)
    return Mesh(_FINE * radius * np.sinh(box.points), box.cells)


def _top_areas(mesh: Mesh) -> Array:
    """(n_nodes,) lumped areas [m^2] of the facets of the face z = 0 only: a plane of symmetry is not a surface."""
    on_top = (mesh.points[mesh.facets, 2] == 0.0).all(axis=1)
    shares = np.linalg.norm(mesh.facet_vectors[on_top], axis=1) / 3.0
    areas = np.zeros(mesh.n_nodes)
    np.add.at(areas, mesh.facets[on_top].ravel(), np.repeat(shares, 3))
    return areas
