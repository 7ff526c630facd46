"""A correction is believed where training has been, and where it asks for no more than training did."""

import numpy as np
import pytest
import torch

from runtime.learned.force.confidence import Confidence, ConfidenceEvaluation, squared_ratio

N_LOCAL, LOADS = 5, 7


@pytest.fixture
def contact():
    """Inputs within the range of training, loads and corrections a fifth as large."""
    torch.manual_seed(3)
    z, load = 2.0 * torch.rand(LOADS, N_LOCAL) - 1.0, torch.randn(LOADS, 3)
    correction = torch.randn(LOADS, 3)
    return z, load, 0.2 * correction * load.norm() / correction.norm()


@pytest.fixture
def trust():
    """Inputs from -1 to 1, and corrections of a fifth of the loads."""
    trust = Confidence(N_LOCAL)
    trust.span(torch.stack([torch.full((N_LOCAL,), -1.0), torch.full((N_LOCAL,), 1.0)]))
    trust.limit(torch.full((100,), 0.2))
    return trust


def test_all_is_believed_before_training(contact):
    z, load, correction = contact
    assert float(Confidence(N_LOCAL)(1e3 * z, load, 1e3 * correction)) == 1.0


def test_what_is_like_training_is_believed(contact, trust):
    # rho0 is 1.5 times the rho of training: of that, (2/3)^8 = 3.9 % is lost.
    assert float(trust(*contact)) == pytest.approx(1.0 / (1.0 + (2.0 / 3.0) ** 8), rel=1e-5)


def test_large_corrections_are_given_up(contact, trust):
    z, load, correction = contact
    taken = [float((trust(z, load, k * correction) * k * correction).norm()) for k in (0.5, 1, 2, 5, 20, 1e6)]
    assert taken[0] < taken[1]
    assert taken[1] > taken[2] > taken[3] > taken[4]
    # By (2/3 k)^8: mechanics is what remains.
    assert taken[4] < 1e-6 * taken[1]
    assert taken[5] == 0.0


@pytest.mark.parametrize("column", [0, 4])
def test_inputs_beyond_all_of_training_are_not_believed(contact, trust, column):
    z, load, correction = contact
    within = float(trust(z, load, correction))
    share = float(load[2].square().sum() / load.square().sum())
    for widths in (1e-4, 0.5, 3.0):
        beyond = z.clone()
        beyond[2, column] = 1.0 + 2.0 * widths  # the range is two wide
        found = float(trust(beyond, load, correction))
        assert found == pytest.approx(within / (1.0 + share * (widths / 0.5) ** 2), rel=1e-4)


def test_a_load_that_bears_nothing_says_nothing(contact, trust):
    z, load, correction = contact
    load[4] = 0.0
    expected = float(trust(z, load, correction))
    z[4] = 1e6
    assert float(trust(z, load, correction)) == expected


def test_an_input_that_never_varied_may_vary_by_its_least_spread(contact):
    _, load, correction = contact
    trust = Confidence(N_LOCAL)
    trust.span(torch.zeros(4, N_LOCAL))
    one = torch.zeros(LOADS, N_LOCAL)
    one[:, 1] = 0.5
    assert float(trust(one, load, correction)) == pytest.approx(0.5)


def test_no_contact_and_no_loads_are_numbers(trust):
    nothing = torch.zeros(2, LOADS, 3)
    found = trust(torch.zeros(2, LOADS, N_LOCAL), nothing, nothing)
    assert found.shape == (2, 1, 1)
    assert bool((found == 1.0).all())


def test_derivatives_where_nothing_is_corrected(contact, trust):
    """As training begins."""
    z, load, _ = contact
    correction = torch.zeros(LOADS, 3, requires_grad=True)
    (trust(z, load, correction) * correction).sum().backward()
    assert bool(torch.isfinite(correction.grad).all())


def test_is_the_same_in_numpy(contact, trust):
    z, load, correction = contact
    for k in (0.5, 1.3, 3.0):
        parts = (k * z, load, k * correction)
        found = ConfidenceEvaluation(trust).of(*(part.numpy() for part in parts))
        assert found == pytest.approx(float(trust(*parts)), rel=1e-5)  # single precision
    assert ConfidenceEvaluation(Confidence(N_LOCAL)).of(*(part.numpy() for part in contact)) == 1.0


def test_batches_are_contacts_one_by_one(trust):
    torch.manual_seed(1)
    z, load = 1.5 * torch.randn(3, LOADS, N_LOCAL), torch.randn(3, LOADS, 3)
    correction = 0.3 * torch.randn(3, LOADS, 3)
    single = [float(trust(z[k], load[k], correction[k])) for k in range(3)]
    np.testing.assert_allclose(trust(z, load, correction)[:, 0, 0].numpy(), single, rtol=1e-5)
    assert squared_ratio(load, correction).shape == (3,)
