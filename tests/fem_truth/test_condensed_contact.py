"""Condensed contact against full space with its elasticity linearised: the same problem, solved by other means.

At rest, with contact points as in full space, linear mechanics is the linear response of full space: both minimise the
same energy, one over all nodes, the other over the contact forces.
"""

from __future__ import annotations

import numpy as np
import pytest

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.optimise import NewtonSettings

TOP, RADIUS, DEPTH = 0.05, 0.03, 0.006  # m: of the block, of the ball, and of the ball below the top
LAW = PenaltyContact(3e11, refinement=2, reduced_refinement=2)
TIGHT = FullSpaceSettings(NewtonSettings(60, 1e-9), 1e-14, cg_tolerance_min=1e-8)
ALL_NODES = 1000  # more contact nodes than the surface has


def way_down(dim):
    """Poses of the ball from the surface to the depth, beside the nodes."""
    heights = TOP + RADIUS - np.linspace(0.0, DEPTH, 9)[1:]
    return [RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.0013), height)) for height in heights]


def by_linear_response(body, ball, poses):
    """The energy [J] that contact adds, and the force on the body [N]."""
    problem = ConstrainedProblem(FullSpaceElasticity(body), None, LAW, body)
    press = problem.linear_press(body.rest_rows, ball, body.mesh.points)
    solutions = [press.solve(pose, TIGHT) for pose in poses]
    assert all(solution.converged for solution in solutions)
    contact = problem.surface_contact(body.rest_rows, ball, poses[-1])
    x = solutions[-1].x
    assert contact.sharp is None or not len(contact.sharp.terms(x, poses[-1]).depth)
    return solutions[-1].energy, -contact.gradient(x).sum(axis=0)


def by_condensed_contact(body, ball, poses):
    """The same."""
    mechanics, rows, warm_start = compute_mechanics(body, ALL_NODES, True), body.rest_rows, None
    contact = CondensedContact.of(body, mechanics, {"ball": ball}, LAW)
    for pose in poses:
        found = contact.evaluate(contact.in_frame(rows), rows, {"ball": pose}, warm_start)
        assert found.converged
        warm_start = found.warm_start
    assert not found.solved.is_pressed.any()
    return found.energy, -body.handles.affine_part @ found.gradient


@pytest.mark.parametrize("dim", [2, 3])
def test_a_ball_is_the_linear_response(block, dim):
    """Larger than the distance between nodes, and not deep: it has no sharp points that bear."""
    body, ball, poses = block(dim), Sphere(RADIUS, dim, "ball"), way_down(dim)
    energy, force = by_linear_response(body, ball, poses)
    own_energy, own_force = by_condensed_contact(body, ball, poses)
    # The compliance is in single precision, and the energy of second order in what that leaves of the forces.
    assert own_energy == pytest.approx(energy, rel=1e-6)
    np.testing.assert_allclose(own_force, force, atol=1e-4 * np.linalg.norm(force))
