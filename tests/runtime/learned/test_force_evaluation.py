"""The force model in numpy agrees with the torch model."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.learned.force.evaluation import ForceEvaluation
from softprint.runtime.learned.force.inputs import least_spread
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics

STIFFNESS, BAND = 1e10, 0.004


@pytest.fixture
def contact(jelly_body, dim):
    ball = Sphere(0.02, dim, "ball")
    mechanics = compute_mechanics(jelly_body, 400, False)
    rows = jelly_body.rest_rows + 1e-3 * np.random.default_rng(5).normal(size=jelly_body.rest_rows.shape)
    angles = [0.3] if dim == 2 else [0.3, -0.2, 0.5]
    pose = RigidPose.from_rotation_vector(angles, np.append(np.full(dim - 1, 0.004), 0.06 + 0.02 - 0.006))
    return ContactStateProbe(jelly_body, ball, mechanics, PenaltyContact(STIFFNESS), BAND).measure(rows, pose)


@pytest.mark.parametrize("activation", ["tanh", "silu", "softplus"])
# Round-off of the precision, some hundred terms long.
@pytest.mark.parametrize(("kind", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-13)])
def test_is_the_model(contact, jelly_body, dim, activation, kind, tolerance):
    torch.manual_seed(0)
    model = ForceModel(
        ForceModelOptions((16, 12), activation, 0.001, BAND, STIFFNESS), dim, jelly_body.n_rows
    )
    local, force, lever = (torch.from_numpy(part) for part in (contact.inputs, contact.force, contact.lever))
    with torch.no_grad():
        model.normalise(local, contact.depth * torch.tensor([0.8, 1.3]), force, lever)
        for parameter in model.parameters():
            parameter.copy_(torch.randn_like(parameter) / max(parameter.shape) ** 0.5)
        model = model.to(kind)
        depth = torch.tensor(contact.depth, dtype=torch.float64)
        expected = model(*(part.to(kind) for part in (local, depth, force, lever))).numpy()
    found = ForceEvaluation(model).forces(contact)
    assert found.dtype == expected.dtype
    assert (
        np.abs(expected[:, :dim] - contact.force).max() > 1e-3 * np.abs(expected).max()
    )  # it does say something
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


def test_corrections_outside_the_training_range_are_bounded(contact, jelly_body, dim):
    """A contact unlike all training contacts: inputs far outside the training range."""
    torch.manual_seed(0)
    model = ForceModel(ForceModelOptions((16, 12), "silu", 0.001, BAND, STIFFNESS), dim, jelly_body.n_rows)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.copy_(torch.randn_like(parameter) / max(parameter.shape) ** 0.5)
    model = model.double()

    def correction(times):
        far = replace(contact, inputs=times * np.sign(contact.inputs))
        phi = ForceEvaluation(model).forces(far)
        parts = (torch.from_numpy(part) for part in (far.inputs, np.array(far.depth), far.force, far.lever))
        with torch.no_grad():
            np.testing.assert_allclose(phi, model(*parts).numpy(), rtol=1e-12, atol=1e-15)
        return np.linalg.norm(phi - np.pad(contact.force, [(0, 0), (0, dim)]))

    # tanh(40 / 4) is 1 up to 4e-9; without saturation the second would be 25 times the first.
    assert correction(1e3) == pytest.approx(correction(40.0), rel=1e-6)


def test_normalisation_of_strains_that_do_not_vary_in_the_samples(contact, jelly_body, dim):
    model = ForceModel(ForceModelOptions((16,), "silu", 0.001, BAND, STIFFNESS), dim, jelly_body.n_rows)
    local, force, lever = (torch.from_numpy(part) for part in (contact.inputs, contact.force, contact.lever))
    model.normalise(local[:1].repeat(8, 1) * (1 + 1e-4 * torch.rand(8, 1)), torch.ones(8), force, lever)
    assert model.local_scale.numpy()[least_spread(dim) > 0].min() == pytest.approx(0.1)
    assert (least_spread(dim) > 0).sum() == 11  # slopes, products of directions, strains
