"""Condensed contact against full space with its elasticity linearised: the same problem, solved by other means.

At rest, with contact points as in full space, linear mechanics is the linear response of full space: both minimise the
same energy, one over all nodes, the other over the contact forces.
"""

from __future__ import annotations

import numpy as np
import pytest

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh.box import box_mesh

TOP, DEPTH = 0.06, 0.003  # m, of the block; of the collider below it
LAW = PenaltyContact(3e11, refinement=2, reduced_refinement=2)


@pytest.fixture(scope="module")
def bodies():
    """{dim: (body, its mechanics)}: blocks whose surface nodes are some 6 mm apart."""
    return {dim: block(dim) for dim in (2, 3)}


def block(dim):
    mesh = box_mesh([-0.03] * (dim - 1) + [0.0], [0.03] * (dim - 1) + [TOP], [10] * (dim - 1) + [8])
    slab = [[-1.0] * dim, [1.0] * (dim - 1) + [0.009]]
    handles = place_handles(mesh, 6, [frame_in_box(mesh, "base", slab)])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="block")
    return body, compute_mechanics(body, 1000, True)


def way_to(dim, collider):
    """Poses from the surface down to the depth, beside the nodes."""
    at, high = np.full(dim - 1, 0.0013), collider.upper[-1]
    return [
        RigidPose(np.eye(dim), np.append(at, TOP + high - depth)) for depth in np.linspace(0, DEPTH, 9)[1:]
    ]


def by_linear_response(body, collider, poses):
    """The energy [J] that contact adds, and the force on the body [N]."""
    problem = ConstrainedProblem(FullSpaceElasticity(body), None, LAW, body)
    press = problem.linear_press(body.rest_rows, collider, body.mesh.points)
    for pose in poses:
        found = press.solve(pose)
        assert found.converged, found.reason
    sharp = problem.sharp_contact(collider)
    contact = SurfaceContact(LAW, problem.contact_points, collider, poses[-1], sharp)
    return found.energy, -contact.gradient(found.x).sum(axis=0)


def by_condensed_contact(body, mechanics, collider, poses):
    """The same, and how many points sharp points of the collider press."""
    contact = CondensedContact.of(body, mechanics, {collider.name: collider}, LAW)
    warm_start = None
    for pose in poses:
        points = contact.in_frame(body.rest_rows)
        found = contact.evaluate(points, body.rest_rows, {collider.name: pose}, warm_start)
        assert found.converged
        warm_start = found.warm_start
    force = -body.handles.affine_part @ found.gradient
    return found.energy, force, int(found.solved.is_pressed.sum())


def solved_both_ways(bodies, dim, collider):
    """Energy and force by linear response and by condensed contact, and how many sharp points of the collider press."""
    body, mechanics = bodies[dim]
    poses = way_to(dim, collider)
    return (
        *by_linear_response(body, collider, poses),
        *by_condensed_contact(body, mechanics, collider, poses),
    )


def test_a_ball_is_the_linear_response(bodies, dim):
    """Larger than the distance between nodes, so that it has no sharp points."""
    energy, force, own_energy, own_force, sharp = solved_both_ways(bodies, dim, Sphere(0.015, dim, "ball"))
    assert sharp == 0
    # The full-space solve ends at 1 % in the energy norm before its last Newton step, which squares that in forces and
    # again in the energy; the compliance is float32.
    assert own_energy == pytest.approx(energy, rel=1e-6)
    np.testing.assert_allclose(own_force, force, atol=1e-4 * np.linalg.norm(force))
