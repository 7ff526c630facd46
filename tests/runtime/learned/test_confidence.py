"""Confidence is near one within the range of training, and falls off for inputs and corrections beyond it."""

import numpy as np
import pytest
import torch

from softprint.runtime.learned.force.confidence import Confidence, ConfidenceEvaluation, squared_ratio

N_LOCAL, NODES = 5, 7


@pytest.fixture
def contact():
    """Inputs within the range of training, contact forces and corrections a fifth as large."""
    torch.manual_seed(3)
    z, force = 2.0 * torch.rand(NODES, N_LOCAL) - 1.0, torch.randn(NODES, 3)
    correction = torch.randn(NODES, 3)
    return z, force, 0.2 * correction * force.norm() / correction.norm()


@pytest.fixture
def confidence():
    """Inputs from -1 to 1, and corrections of a fifth of the forces."""
    confidence = Confidence(N_LOCAL)
    confidence.span(torch.stack([torch.full((N_LOCAL,), -1.0), torch.full((N_LOCAL,), 1.0)]))
    confidence.limit(torch.full((100,), 0.2))
    return confidence


def test_is_one_before_training(contact):
    z, force, correction = contact
    assert float(Confidence(N_LOCAL)(1e3 * z, force, 1e3 * correction)) == 1.0


def test_is_near_one_within_the_training_range(contact, confidence):
    # rho0 is 1.5 times the rho of training: of that, (2/3)^8 = 3.9 % is lost.
    assert float(confidence(*contact)) == pytest.approx(1.0 / (1.0 + (2.0 / 3.0) ** 8), rel=1e-5)


def test_large_corrections_fade_out(contact, confidence):
    z, force, correction = contact
    taken = [
        float((confidence(z, force, k * correction) * k * correction).norm()) for k in (0.5, 1, 2, 5, 20, 1e6)
    ]
    assert taken[0] < taken[1]
    assert taken[1] > taken[2] > taken[3] > taken[4]
    # By (2/3 k)^8: mechanics is what remains.
    assert taken[4] < 1e-6 * taken[1]
    assert taken[5] == 0.0


@pytest.mark.parametrize("column", [0, 4])
def test_falls_off_with_inputs_beyond_the_training_range(contact, confidence, column):
    z, force, correction = contact
    within = float(confidence(z, force, correction))
    share = float(force[2].square().sum() / force.square().sum())
    for widths in (1e-4, 0.5, 3.0):
        beyond = z.clone()
        beyond[2, column] = 1.0 + 2.0 * widths  # the range is two wide
        found = float(confidence(beyond, force, correction))
        assert found == pytest.approx(within / (1.0 + share * (widths / 0.5) ** 2), rel=1e-4)


def test_inputs_of_a_node_without_force_do_not_count(contact, confidence):
    z, force, correction = contact
    force[4] = 0.0
    expected = float(confidence(z, force, correction))
    z[4] = 1e6
    assert float(confidence(z, force, correction)) == expected


def test_an_input_that_never_varied_may_vary_by_its_least_spread(contact):
    _, force, correction = contact
    confidence = Confidence(N_LOCAL)
    confidence.span(torch.zeros(4, N_LOCAL))
    one = torch.zeros(NODES, N_LOCAL)
    one[:, 1] = 0.5
    assert float(confidence(one, force, correction)) == pytest.approx(0.5)


def test_is_one_without_contact_forces(confidence):
    nothing = torch.zeros(2, NODES, 3)
    found = confidence(torch.zeros(2, NODES, N_LOCAL), nothing, nothing)
    assert found.shape == (2, 1, 1)
    assert bool((found == 1.0).all())


def test_derivatives_without_a_correction(contact, confidence):
    """As at the start of training."""
    z, force, _ = contact
    correction = torch.zeros(NODES, 3, requires_grad=True)
    (confidence(z, force, correction) * correction).sum().backward()
    assert bool(torch.isfinite(correction.grad).all())


def test_numpy_agrees_with_torch(contact, confidence):
    z, force, correction = contact
    for k in (0.5, 1.3, 3.0):
        parts = (k * z, force, k * correction)
        found = ConfidenceEvaluation(confidence).of(*(part.numpy() for part in parts))
        assert found == pytest.approx(float(confidence(*parts)), rel=1e-5)  # single precision
    assert ConfidenceEvaluation(Confidence(N_LOCAL)).of(*(part.numpy() for part in contact)) == 1.0


def test_a_batch_agrees_with_single_contacts(confidence):
    torch.manual_seed(1)
    z, force = 1.5 * torch.randn(3, NODES, N_LOCAL), torch.randn(3, NODES, 3)
    correction = 0.3 * torch.randn(3, NODES, 3)
    single = [float(confidence(z[k], force[k], correction[k])) for k in range(3)]
    np.testing.assert_allclose(confidence(z, force, correction)[:, 0, 0].numpy(), single, rtol=1e-5)
    assert squared_ratio(force, correction).shape == (3,)
