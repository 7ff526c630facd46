"""A force model depends on the contact alone: not on the axes of body or collider, nor on the order of its nodes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from softprint.runtime.colliders import Box, Cone, RigidPose
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.learned.force.contact_state import ContactState, ContactStateProbe
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.evaluation import ForceEvaluation
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

# The bodies are coarse: a collider and a band wide enough for some of their nodes.
OPTIONS = ForceModelOptions((16, 12), "silu", 0.001, 0.01, 1e10)
# Sharp points are sampled along the axes of the collider: with some, another choice of axes has others.
AT_NODES = replace(OPTIONS, refinement=0)
REACH = 0.05


@pytest.fixture(scope="module")
def mechanics_of():
    """The mechanics of a body, without gravity, which does not rotate along."""
    kept = {}

    def find(body):
        if body.content_hash not in kept:
            kept[body.content_hash] = compute_mechanics(body, 400, True)
        return kept[body.content_hash]

    return find


def any_model(body, kind=torch.float64, options=OPTIONS):
    """A network with weights of order one everywhere."""
    torch.manual_seed(1)
    model = ForceModel(options, body.dim, body.n_rows)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.copy_(torch.randn_like(parameter) / max(parameter.shape) ** 0.5)
        model.local_scale.fill_(3.0)
        model.traction_scale.fill_(1e4)
    return model.to(kind)


def bumped(body):
    return body.rest_rows + 1e-3 * np.random.default_rng(5).normal(size=body.rest_rows.shape)


def tilted(dim):
    return [0.3] if dim == 2 else [0.3, -0.2, 0.5]


def above(body, depth, aside=0.004):
    """Pose of a ball of radius REACH at this depth in the top of the body."""
    top = body.mesh.points[:, -1].max()
    return np.append(np.full(body.dim - 1, aside), top + REACH - depth)


def cone(dim):
    """An asymmetric collider: all directions differ."""
    return Cone(np.append(np.zeros(dim - 1), -0.03), np.full(dim, 0.02), 0.02, 0.01, "cone")


def spike(dim):
    """So sharp that it is its tip that presses, between the contact points of the facets."""
    return Cone(np.append(np.zeros(dim - 1), -0.048), np.full(dim, 0.02), 0.002, 0.01, "spike")


# Of fields: contact forces are balanced to 1e-6 of the depth by steps in single precision, whose round-off is what
# differs. Forces of pressed points are inputs, too.
SINGLE_STEPS = 1e-6


@pytest.mark.parametrize("shape", [cone, spike])
@pytest.mark.parametrize(("kind", "tolerance"), [(torch.float32, 1e-6), (torch.float64, SINGLE_STEPS)])
def test_the_field_rotates_with_body_and_collider(jelly_body, mechanics_of, dim, kind, tolerance, shape):
    correction = correction_of(jelly_body, shape(dim), mechanics_of, kind)
    rows, pose = bumped(jelly_body), RigidPose.from_rotation_vector(tilted(dim), above(jelly_body, 0.012))
    Q = rotation_matrix([2.1] if dim == 2 else [1.1, 0.7, -1.6], dim)
    field = correction.displacement(rows, pose)
    rotated = correction.displacement(rows @ Q.T, RigidPose(Q @ pose.rotation, Q @ pose.translation))
    assert np.abs(field).max() > 1e-4  # there is a dent to speak of
    np.testing.assert_allclose(rotated, field @ Q.T, rtol=0.0, atol=tolerance * np.abs(field).max())


def test_the_axes_of_the_collider_do_not_matter(jelly_body, mechanics_of, dim):
    """A cube rotated by a quarter is the same solid in other coordinates of its own."""
    box = Box(np.full(dim, 0.042), 0.01, "box")
    quarter = RigidPose.from_rotation_vector(
        [np.pi / 2] if dim == 2 else [0.0, 0.0, np.pi / 2], np.zeros(dim)
    )
    pose = RigidPose.from_rotation_vector(tilted(dim), above(jelly_body, 0.015))
    correction, rows = correction_of(jelly_body, box, mechanics_of, options=AT_NODES), bumped(jelly_body)
    one, other = correction.displacement(rows, pose), correction.displacement(rows, pose.compose(quarter))
    assert np.abs(one).max() > 1e-5
    np.testing.assert_allclose(other, one, rtol=0.0, atol=SINGLE_STEPS * np.abs(one).max())


def test_the_order_of_nodes_does_not_matter(jelly_body, mechanics_of, dim):
    contact = measured(jelly_body, mechanics_of, dim)
    order = np.random.default_rng(0).permutation(len(contact.index))
    columns = (contact.index, contact.force, contact.inputs, contact.lever)
    shuffled = ContactState(*(column[order] for column in columns), contact.depth, contact.loaded)
    model = ForceEvaluation(any_model(jelly_body))
    # The same numbers, but for the order in which matrix products sum.
    np.testing.assert_allclose(model.forces(shuffled), model.forces(contact)[order], rtol=1e-12, atol=1e-15)


def test_contacts_in_a_batch_agree_with_single_ones(jelly_body, mechanics_of, dim):
    """Padded to one length, as training has them."""
    contacts = [measured(jelly_body, mechanics_of, dim, aside) for aside in (-0.04, 0.004)]
    model = any_model(jelly_body)
    most = max(len(contact.index) for contact in contacts)
    assert min(len(contact.index) for contact in contacts) < most
    padded = [
        torch.from_numpy(
            np.stack(
                [
                    np.pad(column, [(0, most - len(column))] + [(0, 0)] * (column.ndim - 1))
                    for column in (getattr(contact, name) for contact in contacts)
                ]
            )
        )
        for name in ("inputs", "force", "lever")
    ]
    depth = torch.tensor([contact.depth for contact in contacts], dtype=torch.float64)
    with torch.no_grad():
        batch = model(padded[0], depth, *padded[1:]).numpy()
    for found, contact in zip(batch, contacts, strict=True):
        alone = ForceEvaluation(model).forces(contact)
        np.testing.assert_allclose(found[: len(alone)], alone, rtol=0.0, atol=1e-12 * np.abs(alone).max())


def test_nodes_enter_and_leave_smoothly(jelly_body, mechanics_of, dim):
    """A collider slides along the surface: half the step gives half the change. The field has no jump where nodes enter
    the band or become active."""
    correction, rows = correction_of(jelly_body, cone(dim), mechanics_of), bumped(jelly_body)
    probe = probe_of(jelly_body, mechanics_of, dim)

    def changes(steps):
        poses = [
            RigidPose.from_rotation_vector(tilted(dim), above(jelly_body, 0.012, aside))
            for aside in np.linspace(-0.02, 0.02, steps + 1)
        ]
        counts, fields, near = set(), [], None
        for pose in poses:
            near = correction.solve(rows, pose, near)
            counts.add(len(probe.measure(rows, pose, near).index))
            fields.append(correction.displacement_of(near, rows, pose))
        return np.abs(np.diff(fields, axis=0)).max(), counts

    (coarse, counts), (fine, _) = changes(60), changes(120)
    assert len(counts) > 1  # nodes did come and go
    # A jump would stay as large as it is; curvature along the path leaves room for a tenth.
    assert fine < 0.6 * coarse


def test_points_that_a_tip_presses_take_part(jelly_body, mechanics_of, dim):
    """With their forces and, since these are of the same contact, with all of it."""
    pose = RigidPose.from_rotation_vector(tilted(dim), above(jelly_body, 0.012))
    probe = ContactStateProbe(jelly_body, spike(dim), mechanics_of(jelly_body), OPTIONS.law, OPTIONS.band)
    solved = probe.solve(bumped(jelly_body), pose)
    contact = probe.measure(bumped(jelly_body), pose)
    pressed = contact.index >= len(probe.contact.loaded)
    assert pressed.any()
    assert (np.linalg.norm(contact.force[pressed], axis=1) > 0.0).all()
    np.testing.assert_allclose(contact.force.sum(axis=0), solved.rest_force.sum(axis=0), rtol=1e-12)
    model = ForceEvaluation(any_model(jelly_body))
    learned = model.forces(contact)[:, :dim] - contact.force
    assert (np.linalg.norm(learned[pressed], axis=1) > 0.0).all()


def measured(body, mechanics_of, dim, aside=0.004):
    pose = RigidPose.from_rotation_vector(tilted(dim), above(body, 0.012, aside))
    return probe_of(body, mechanics_of, dim).measure(bumped(body), pose)


def probe_of(body, mechanics_of, dim):
    return ContactStateProbe(body, cone(dim), mechanics_of(body), OPTIONS.law, OPTIONS.band)


def correction_of(body, collider, mechanics_of, kind=torch.float64, options=OPTIONS):
    correction = ForceCorrection("any", any_model(body, kind, options), body, collider, mechanics_of(body))
    return StaticCorrection(correction, body)
