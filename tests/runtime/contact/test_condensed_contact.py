"""The condensed energy of contact: derivatives by finite differences, resultants, and what is invariant of it."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.solver import candidate_search, contact_solve
from softprint.runtime.contact.solver.candidates import PointDistance, PosedCollider
from softprint.runtime.contact.solver.contact_points import CorotatedPoints
from softprint.runtime.contact.solver.contact_solve import ContactProblem
from softprint.runtime.contact.solver.given_displacement import GivenDisplacement
from softprint.runtime.contact.solver.warm_start import WarmStart
from softprint.runtime.learned.internal.correction import InternalCorrection
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from tests.internal_model import made_model

STIFFNESS = 1e10  # N/m^4
RADIUS = 0.02
DRAG = {2: 20.0, 3: 0.5}  # N on each node, which displaces points by a millimetre
# Larger than what is learned on the Jelly.
LEARNED = LearnedEnergy.of((1.0,))


def doubled(mechanics):
    """In float64, so that finite differences see the derivatives and not the rounding of what is kept."""
    condensation = mechanics.condensation
    if condensation is None:
        return mechanics
    modes, weight = condensation.modes.astype(np.float64), condensation.weight.astype(np.float64)
    return mechanics._replace(condensation=replace(condensation, modes=modes, weight=weight))


def strained(body):
    # Where no node is just about to bear pressure: second derivatives have a kink there.
    return body.rest_rows + 1e-3 * np.random.default_rng(6).normal(size=body.rest_rows.shape)


@dataclass(frozen=True)
class PressedBall:
    """The contact of a body with a ball, in a frame; rows and pose of a state where it is pressed."""

    contact: CondensedContact
    points: CorotatedPoints
    rows: Array
    pose: RigidPose

    @classmethod
    def of(cls, body, mechanics, rows, pose, law, learned=None, internal=None):
        """In the frame of the state itself."""
        ball = Sphere(RADIUS, body.dim, "ball")
        contact = CondensedContact.of(
            body, mechanics, {"ball": ball}, law, learned=learned, internal=internal
        )
        return cls(contact, contact.in_frame(rows), rows, pose)

    def dragged(self, force: float) -> "PressedBall":
        """Displaced by given forces of this size [N] on the nodes that bear pressure."""
        nodes, pressure = self.contact.node_forces(self.at().solved)
        forces = force * np.random.default_rng(4).normal(size=pressure.shape)
        return replace(
            self, points=self.points.displaced(GivenDisplacement(self.contact.of_nodes, nodes, forces))
        )

    def at(self, rows=None, pose=None, warm_start: WarmStart | None = None) -> ContactEvaluation:
        """Of that state by default."""
        rows, pose = self.rows if rows is None else rows, self.pose if pose is None else pose
        return self.contact.evaluate(self.points, rows, {"ball": pose}, warm_start)


def into_the_top(dim, rotation_vector):
    """The pose of a ball that is 6 mm deep in the top of the block."""
    place = np.append(np.full(dim - 1, 0.004), 0.06 + RADIUS - 0.006)
    return RigidPose.from_rotation_vector(rotation_vector, place)


@pytest.fixture(
    params=[(0, 1), (4, 1), (4, 2), (1, 1)],
    ids=["at nodes", "on facets", "two along a facet", "and of sharp points"],
)
def law(request):
    """Contact at nodes, at the centres of facets, and at several points of every facet."""
    return PenaltyContact(STIFFNESS, *request.param)


@pytest.fixture(
    params=[
        "subspace",
        "condensation",
        "learned energy",
        "internal on the subspace",
        "internal, and learned energy",
        "dragged",
        "dragged, and learned energy",
    ]
)
def pressed(jelly_body, dim, law, request):
    """A strained body with a ball 6 mm deep in its top."""
    gravity = np.append(np.zeros(dim - 1), -9.81)
    mechanics = doubled(compute_mechanics(jelly_body, 400, "subspace" not in request.param, gravity))
    pose = into_the_top(dim, [0.3] if dim == 2 else [0.3, -0.2, 0.5])
    learned = LEARNED if "learned energy" in request.param else None
    internal = None
    if "internal" in request.param:
        internal = InternalCorrection(made_model(jelly_body, size=3e-4), jelly_body)
    pressed = PressedBall.of(jelly_body, mechanics, strained(jelly_body), pose, law, learned, internal)
    return pressed.dragged(DRAG[dim]) if "dragged" in request.param else pressed


def test_a_step_is_no_longer_than_contact_can_be_followed(pressed, jelly_body, dim):
    """A translation moves every point by its length: twice the contact displacement, and no farther."""
    here = pressed.at()
    along = jelly_body.handles.affine_part[:, None] * np.eye(1, dim, dim - 1)
    depth = here.solved.depth
    assert here.longest(1.9 * depth * along) == 1.0
    # Static condensation is kept in single precision where nothing is internal.
    assert here.longest(20.0 * depth * along) == pytest.approx(0.1, rel=1e-5)
    away = pressed.at(pose=RigidPose.from_rotation_vector(np.zeros(2 * dim - 3), np.ones(dim)))
    assert away.longest(along) == 1.0


def test_hessian_along_some_directions(pressed):
    hessian = pressed.at().hessian
    along = np.random.default_rng(3).normal(size=(pressed.rows.size, 5))
    # The same products in another order, in the single precision of the compliance.
    expected = along.T @ hessian() @ along
    np.testing.assert_allclose(hessian(along), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("several", [False, True], ids=["one collider", "several colliders"])
def test_points_that_the_dent_pushes_in_are_found(jelly_body, dim, law, monkeypatch, several):
    """Whichever points it begins with, every one that would be inside the collider takes part in the end."""
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    colliders = {"ball": Sphere(RADIUS, dim, "ball")}
    if several:
        colliders["far"] = Sphere(0.01, dim, "far")
    ball = into_the_top(dim, np.zeros(1 if dim == 2 else 3))
    poses = {"ball": ball, "far": RigidPose(np.eye(dim), np.full(dim, 1.0))}
    rows = jelly_body.rest_rows
    contact = CondensedContact.of(jelly_body, mechanics, colliders, law, band=2e-3)

    def energy():
        return contact.evaluate(contact.in_frame(rows), rows, poses, None).energy

    expected = energy()
    # Begins with those deeper than that share of the deepest.
    monkeypatch.setattr(candidate_search, "MARGIN", -0.4)
    # Both are balanced to a millionth of the depth.
    assert energy() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("depth", [1e-13, 1e-15, 0.0])
def test_a_collider_that_only_just_touches(jelly_body, dim, depth):
    """No direction of its contact stiffness matters then, and there is nothing to factorise."""
    mechanics = compute_mechanics(jelly_body, 400, condensation=False)
    nodes = jelly_body.mesh.points[mechanics.surface_compliance.nodes]
    top = nodes[np.argmax(nodes[:, -1] - 1e-3 * np.linalg.norm(nodes[:, :-1], axis=1))]
    pose = RigidPose(np.eye(dim), top + np.append(np.zeros(dim - 1), RADIUS - depth))
    touching = PressedBall.of(
        jelly_body, mechanics, jelly_body.rest_rows, pose, PenaltyContact(STIFFNESS)
    ).at()
    # k a d^3 / 3 is below 1e-30 J.
    assert 0.0 <= touching.energy < 1e-30
    assert np.abs(touching.gradient).max() < 1e-15
    if touching.hessian is not None:
        assert np.isfinite(touching.hessian()).all()


def test_derivatives(pressed, monkeypatch):
    # Differences over 1e-7 m see more of the error of the contact forces than a step does.
    monkeypatch.setattr(contact_solve, "_TOLERANCE", 1e-9)
    here = pressed.at()
    assert here.energy > 0
    rng = np.random.default_rng(0)
    for _ in range(3):
        direction, h = rng.normal(size=pressed.rows.shape), 1e-7
        ahead, behind = (
            pressed.at(pressed.rows + side * h * direction, warm_start=here.warm_start) for side in (1, -1)
        )
        slope = (ahead.energy - behind.energy) / (2 * h)
        # Central differences over 1e-7 m of an energy solved to 1e-8 in displacement: a part in a million.
        assert slope == pytest.approx(np.vdot(here.gradient, direction), rel=1e-5)
        change = (ahead.gradient - behind.gradient) / (2 * h)
        found = (here.hessian() @ direction.ravel()).reshape(pressed.rows.shape)
        # Exact as well; the penalty's second derivative has a kink where a node begins to bear pressure.
        # Under a learned energy, the third derivative of the distance is a difference, and the response of the excess
        # is in single precision.
        exact = 1e-4 if pressed.contact.learned is None else 3e-3
        assert np.abs(found - change).max() < exact * np.abs(change).max()


def test_gradient_is_the_contact_force_through_the_position_jacobian(pressed):
    here = pressed.at()
    # Some of the forces of a learned energy act across the normals: see the force on the collider.
    here = replace(here, learned=None)
    active = here.active_points("ball")
    expected = -(active.pressure[:, None] * active.normal).ravel() @ here.contact.motions.position
    # The same sums in another order; the Jacobian of an internal correction is in single precision.
    rtol = 1e-10 if pressed.contact.points.internal is None else 1e-5
    np.testing.assert_allclose(here.gradient.ravel(), expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def test_the_same_state_evaluated_twice_gives_the_same_bits(pressed):
    """Whatever else has been evaluated in between: an evaluation is a function of its arguments."""
    start = pressed.at().warm_start
    elsewhere = RigidPose(pressed.pose.rotation, pressed.pose.translation - 0.001)
    first, trial, again = (
        pressed.at(pose=pose, warm_start=start) for pose in (pressed.pose, elsewhere, pressed.pose)
    )
    assert trial.energy != first.energy
    assert again.energy == first.energy
    np.testing.assert_array_equal(again.gradient, first.gradient)
    np.testing.assert_array_equal(again.hessian(), first.hessian())


def test_rigid_motion_is_predicted(jelly_body, dim, law):
    """The warm start of a state knows of body and collider rotated together what they come to: the same, rotated.
    Gravity, which does not rotate along, is left out."""
    mechanics = doubled(compute_mechanics(jelly_body, 400, condensation=True))
    pose = into_the_top(dim, [0.3] if dim == 2 else [0.3, -0.2, 0.5])
    pressed = PressedBall.of(jelly_body, mechanics, strained(jelly_body), pose, law)
    contact, here = pressed.contact, pressed.at()
    Q = rotation_matrix([2.1] if dim == 2 else [1.1, 0.7, -1.6], dim)
    rotated_pose, rotated_rows = (
        RigidPose(Q @ pose.rotation, Q @ pose.translation),
        pressed.rows @ Q.T,
    )
    index, b = here.solved.index, here.solved.solution.active
    ball = PosedCollider(Sphere(RADIUS, dim, "ball"), rotated_pose)
    points = contact.in_frame(rotated_rows)
    distance = PointDistance(("ball",), (ball,), np.zeros(len(index), dtype=np.int64))
    problem = ContactProblem(
        compliance=contact.compliance.among(index),
        carriers=points.carriers(rotated_rows, index),
        stiffness=contact.stiffness[index],
        position=points.positions(rotated_rows, index),
        depth=here.solved.depth,
        distance=distance,
    )
    penetration, normal = here.warm_start.predict(
        index, problem, {"ball": rotated_pose}, distance, here.warm_start.compliance
    )
    solution = here.solved.solution
    # Solved in single precision.
    np.testing.assert_allclose(penetration[b], solution.penetration[b], rtol=1e-5)
    np.testing.assert_allclose(normal[b], solution.normal[b] @ Q.T, atol=1e-5)


def test_force_on_the_collider_is_the_slope_of_the_energy_along_its_path(pressed, dim):
    here = pressed.at()
    force = here.forces()["ball"].force
    h = 1e-7
    for axis in np.eye(dim):
        ahead, behind = (
            pressed.at(
                pose=RigidPose(pressed.pose.rotation, pressed.pose.translation + side * h * axis),
                warm_start=here.warm_start,
            )
            for side in (1, -1)
        )
        slope = (ahead.energy - behind.energy) / (2 * h)
        # Central differences over 1e-7 m, as above.
        assert -slope == pytest.approx(force @ axis, abs=1e-5 * np.linalg.norm(force))
    # Turning a ball changes nothing; forces are in the single precision of the compliance.
    assert np.abs(here.forces()["ball"].torque).max() < 1e-5 * RADIUS * np.linalg.norm(force)


def test_giving_way_costs_less_than_a_rigid_surface(pressed, jelly_body, dim):
    areas = pressed.contact.stiffness / STIFFNESS
    positions = pressed.points.positions(pressed.rows)
    ball = Sphere(RADIUS, dim, "ball")
    rigid = PenaltyContact(STIFFNESS).energy(positions, areas, ball, pressed.pose)
    assert 0 < pressed.at().energy < rigid


def test_nothing_out_of_contact(pressed):
    away = pressed.at(pose=RigidPose(pressed.pose.rotation, pressed.pose.translation + 0.02))
    assert away.energy == 0.0
    assert not away.gradient.any()
    assert away.hessian is None
    assert away.solved is None
    assert away.converged


@pytest.mark.parametrize("learned", [None, LEARNED], ids=["mechanics", "learned energy"])
def test_moving_body_and_collider_together_changes_nothing(jelly_body, dim, law, learned):
    """Gravity, which does not move along, is left out."""
    mechanics = doubled(compute_mechanics(jelly_body, 400, condensation=True))
    rows, pose = strained(jelly_body), into_the_top(dim, np.zeros(1 if dim == 2 else 3))
    motion = RigidPose.from_rotation_vector([0.7] if dim == 2 else [0.2, 0.7, -0.4], 0.1 * np.ones(dim))
    moved_rows = rows @ motion.rotation.T + np.outer(jelly_body.handles.affine_part, motion.translation)
    here = PressedBall.of(jelly_body, mechanics, rows, pose, law, learned).at()
    moved = PressedBall.of(jelly_body, mechanics, moved_rows, motion.compose(pose), law, learned).at()
    # The modes are rounded to float32, and so annihilate translations to 1e-7.
    assert moved.energy == pytest.approx(here.energy, rel=2e-6)
    rotated = here.gradient @ motion.rotation.T
    assert np.abs(moved.gradient - rotated).max() < 2e-5 * np.abs(here.gradient).max()
