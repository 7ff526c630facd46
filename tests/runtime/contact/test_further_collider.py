"""A dent that pushes the body into another collider than the one that makes it: a pad held at its side, a ball pressed
into its top, and the ground under it."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Box, Plane, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh.box import box_mesh

RADIUS = 0.02
LAW = PenaltyContact(1e10, 2)


def pad(dim, thickness=0.02, points=8):
    """100 mm wide, held at its left."""
    upper, cells = np.full(dim, 0.1), np.full(dim, 10)
    upper[-1], cells[-1] = thickness, 2
    mesh = box_mesh([0.0] * dim, list(upper), list(cells))
    frame = frame_in_box(mesh, "side", [[-1.0] * dim, [0.011] + [1.0] * (dim - 1)])
    handles = place_handles(mesh, points, [frame])
    return assemble_body(mesh, handles, make_material("neo_hookean", 2e4, 0.4), 1000.0, name="pad")


class Pressed:
    """A ball of 20 mm that is `deep` [m] in the top of a pad, and the ground a gap under it."""

    def __init__(self, body, deep, x=0.055, ground=None):
        self.body, self.dim = body, body.dim
        ground = ground or Plane([0.0] * (self.dim - 1) + [1.0], "ground")
        colliders = {"ball": Sphere(RADIUS, self.dim, "ball"), "ground": ground}
        self.contact = CondensedContact.of(body, compute_mechanics(body, 400, True), colliders, LAW)
        self.frame = self.contact.in_frame(body.rest_rows)
        top = body.mesh.points[:, -1].max()
        center = np.array([x, *[0.05] * (self.dim - 2), top + RADIUS - deep])
        self.ball = RigidPose(np.eye(self.dim), center)

    def step(self):
        """Begin a new one, in which sharp points press other points than in the last."""
        self.frame = self.contact.in_frame(self.body.rest_rows)

    def over(self, gap, warm_start=None, rows=None):
        """The contact with the ground, below the ball, at this gap [m]."""
        down = self.ball.translation.copy()
        down[-1] = -gap
        poses = {"ball": self.ball, "ground": RigidPose(np.eye(self.dim), down)}
        rows = self.body.rest_rows if rows is None else rows
        return self.contact.evaluate(self.frame, rows, poses, warm_start)


def on_ground(evaluation):
    """By which the ground is pressed [N]."""
    return float(-evaluation.forces()["ground"].force[-1])


def test_the_ground_bears_what_the_dent_pushes_into_it(dim):
    pressed = Pressed(pad(dim), 0.006)
    above, below = pressed.over(1e-8), pressed.over(-1e-8)
    assert on_ground(above) > 0.3  # N, and it bore none where no point was below it without the dent
    # Both balanced to 1e-6 of the depth; 20 nm are 0.1 mN.
    assert on_ground(above) == pytest.approx(on_ground(below), rel=1e-3)
    assert above.energy == pytest.approx(below.energy, rel=1e-5)


def test_the_ground_bears_more_the_nearer_it_is(dim):
    """From where it is out of reach, step by step, and no step does anything else than a solve without a warm start."""
    pressed = Pressed(pad(dim), 0.006)
    start, forces = None, []
    for gap in (1e-2, 1e-3, 6e-4, 4e-4, 2e-4, 1e-5, -1e-5):
        evaluation = pressed.over(gap, start)
        anew = pressed.over(gap)
        assert evaluation.converged
        # Both balanced to 1e-6 of the depth.
        assert on_ground(evaluation) == pytest.approx(on_ground(anew), rel=1e-4, abs=1e-6)
        start, forces = evaluation.warm_start, [*forces, on_ground(evaluation)]
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) >= 0.0)
    assert forces[-3] > 1.0


def test_the_gradient_is_that_of_the_energy(dim):
    pressed = Pressed(pad(dim), 0.006)
    at = pressed.over(2e-4)
    assert on_ground(at) > 1.0
    rng, rest = np.random.default_rng(0), pressed.body.rest_rows
    for _ in range(3):
        way = 1e-6 * rng.normal(size=rest.shape)
        ahead, behind = (pressed.over(2e-4, at.warm_start, rest + sign * way).energy for sign in (1.0, -1.0))
        # Differences of energies that are balanced to 1e-6 of the depth.
        assert (ahead - behind) / 2.0 == pytest.approx(float((at.gradient * way).sum()), rel=1e-3)


def test_a_sheet_thinner_than_the_dent_is_pressed_onto_the_ground(dim):
    """Points of its lower side are inside the ball, too, where nothing is displaced: the ground is what they face."""
    pressed = Pressed(pad(dim, 0.004), 0.006)
    start, forces = None, []
    for gap in (2e-3, 1e-3, 5e-4, 1e-4):
        evaluation = pressed.over(gap, start)
        assert evaluation.converged
        assert on_ground(evaluation) == pytest.approx(on_ground(pressed.over(gap)), rel=1e-4, abs=1e-6)
        start, forces = evaluation.warm_start, [*forces, on_ground(evaluation)]
    assert np.all(np.diff(forces) >= 0.0)
    assert forces[-1] > 1.0


def test_the_ground_under_the_free_end_bears(dim):
    """The end of a pad without points goes farther than where a ball presses, beside the frame."""
    pressed = Pressed(pad(dim, points=0), 0.004, x=0.03)
    free = pressed.over(0.1)
    y = free.deformed_positions(np.arange(len(pressed.contact.loaded)))
    lowest, at_ball = -y[:, -1].min(), free.solved.solution.largest_displacement
    assert lowest > 1.2 * at_ball
    gap = 0.5 * (lowest + at_ball)
    assert on_ground(pressed.over(gap)) > 0.0


def test_an_edge_bears_what_the_dent_pushes_onto_it(dim):
    """An upright plate of 1 mm, between contact points on the facets, which presses by points of its edge."""
    half = 0.02
    plate = Box([0.0005, *[half] * (dim - 1)], name="ground")
    pressed = Pressed(pad(dim), 0.006, x=0.0537, ground=plate)
    start, forces = None, []
    for gap in (1e-2, 5e-4, 3e-4, 1e-4, 1e-8, -1e-8, -1e-4):
        for _ in range(4):  # until the dent no longer moves the points that the edge presses
            pressed.step()
            evaluation = pressed.over(gap + half, start)
            start = evaluation.warm_start
        assert evaluation.converged
        forces.append(on_ground(evaluation))
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) >= -1e-3 * forces[-1])
    assert forces[4] > 0.1 * forces[-1]
    # The dent still moves the points that the edge presses, by less with every step.
    assert forces[4] == pytest.approx(forces[5], rel=0.03)
