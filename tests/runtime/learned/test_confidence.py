"""Confidence is near one within the range of training, and falls off for contacts and corrections beyond it."""

import numpy as np
import pytest
import torch

from softprint.runtime.learned.force.confidence import (
    Confidence,
    ConfidenceEvaluation,
    contact_measures,
    squared_ratio,
)

N_LOCAL, NODES, CONTACTS = 5, 7, 400


def contacts(count: int, seed: int):
    """Inputs, depths, forces that point one way by and large, and corrections a fifth as large."""
    rng = torch.Generator().manual_seed(seed)
    z = torch.randn(count, NODES, N_LOCAL, generator=rng)
    force = 0.3 * torch.randn(count, NODES, 3, generator=rng) + torch.tensor([0.0, 0.0, 1.0])
    correction = torch.randn(count, NODES, 3, generator=rng)
    size = (
        force.square().sum((1, 2), keepdim=True).sqrt() / correction.square().sum((1, 2), keepdim=True).sqrt()
    )
    return z, torch.randn(count, generator=rng), force, 0.2 * correction * size


@pytest.fixture
def contact():
    """One like those of training."""
    return tuple(part[0] for part in contacts(1, 3))


@pytest.fixture
def confidence():
    """As of training, with limits from other contacts."""
    confidence = Confidence(N_LOCAL)
    z, depth, force, _ = contacts(CONTACTS, 0)
    confidence.fit(contact_measures(z, depth, force))
    z, depth, force, correction = contacts(CONTACTS, 1)
    distance = confidence.distance(contact_measures(z, depth, force))
    confidence.limit(distance, squared_ratio(force, correction).sqrt())
    return confidence


def test_is_one_before_training(contact):
    z, depth, force, correction = contact
    assert float(Confidence(N_LOCAL)(1e3 * z, 1e3 * depth, force, 1e3 * correction)) == 1.0


def test_is_near_one_within_the_training_range(confidence):
    """rho0 is 1.5 times the rho of training: of that, (2/3)^8 = 3.9 % is lost. Half of all contacts are nearer than
    0.85 M0, where another 0.85^16 = 7 % is; one in twenty is beyond M0."""
    t = confidence(*contacts(CONTACTS, 2)).flatten()
    assert 0.88 < float(t.median()) <= 1.0 / (1.0 + (2.0 / 3.0) ** 8) + 1e-6
    assert float((t < 0.5).float().mean()) == pytest.approx(0.05, abs=0.03)


def test_large_corrections_fade_out(contact, confidence):
    z, depth, force, correction = contact
    taken = [
        float((confidence(z, depth, force, k * correction) * k * correction).norm())
        for k in (0.5, 1, 2, 5, 20, 1e6)
    ]
    assert taken[0] < taken[1]
    assert taken[1] > taken[2] > taken[3] > taken[4]
    # By (2/3 k)^8: mechanics is what remains.
    assert taken[4] < 1e-6 * taken[1]
    assert taken[5] == 0.0


@pytest.mark.parametrize("what", ["an input", "the depth"])
def test_falls_off_beyond_the_training_range_without_a_jump(contact, confidence, what):
    z, depth, force, correction = contact
    t = []
    for away in np.linspace(0.0, 20.0, 2001):
        moved = z.clone()
        if what == "an input":
            moved[:, 2] += float(away)
        t.append(
            float(confidence(moved, depth + (float(away) if what == "the depth" else 0.0), force, correction))
        )
    assert t[0] > 0.8
    assert t[-1] < 1e-3
    # The steepest slope is 4 by the logarithm of M / M0: a hundredth of a spread is a small step.
    assert np.abs(np.diff(t)).max() < 0.02


def test_forces_from_all_sides_are_unlike_those_from_one(contact, confidence):
    """All inputs of single points are those of training."""
    z, depth, force, correction = contact
    sides = torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0])[:, None]
    assert float(confidence(z, depth, sides * force, sides * correction)) < 0.01 * float(
        confidence(z, depth, force, correction)
    )


def test_inputs_of_a_node_without_force_do_not_count(contact, confidence):
    z, depth, force, correction = contact
    force[4] = 0.0
    expected = float(confidence(z, depth, force, correction))
    z[4] = 1e6
    assert float(confidence(z, depth, force, correction)) == expected


def test_a_measure_that_never_varied_counts_too(contact):
    """In hundredths of a standard deviation of the inputs: a third and 33 times the least spread, of 5 of 13
    measures."""
    z, depth, force, _ = contact
    confidence = Confidence(N_LOCAL)
    confidence.fit(contact_measures(z, depth, force).expand(4, -1))
    near, far = (confidence.distance(contact_measures(z + away, depth, force)) for away in (0.01, 1.0))
    root = np.sqrt(5.0 / 13.0 / 1.05)
    assert float(near) == pytest.approx(0.01 / 0.03 * root, rel=1e-3)
    assert float(far) == pytest.approx(1.0 / 0.03 * root, rel=1e-3)


def test_mechanics_remains_where_only_sharp_points_bear(contact, confidence):
    z, depth, force, correction = contact
    t = [float(confidence(z, depth, size * force, correction)) for size in (1.0, 0.1, 1e-2, 1e-4, 0.0)]
    assert t == sorted(t, reverse=True)
    assert t[-1] == 0.0


def test_derivatives_without_a_correction(contact, confidence):
    """As at the start of training."""
    z, depth, force, _ = contact
    correction = torch.zeros(NODES, 3, requires_grad=True)
    (confidence(z, depth, force, correction) * correction).sum().backward()
    assert bool(torch.isfinite(correction.grad).all())


def test_numpy_agrees_with_torch(contact, confidence):
    z, depth, force, correction = contact
    for k in (0.5, 1.3, 3.0):
        parts = (k * z, k * depth, force, k * correction)
        numbers = (parts[0].numpy(), float(parts[1]), parts[2].numpy(), parts[3].numpy())
        found = ConfidenceEvaluation(confidence).of(*numbers)
        assert found == pytest.approx(
            float(confidence(*parts)), rel=1e-4
        )  # single precision, and a power of 16
    assert ConfidenceEvaluation(Confidence(N_LOCAL)).of(*numbers) == 1.0


def test_a_batch_agrees_with_single_contacts(confidence):
    z, depth, force, correction = contacts(3, 5)
    z, correction = 1.5 * z, 1.5 * correction
    force[1, 5:] = correction[1, 5:] = 0.0  # as in the padding
    single = [float(confidence(z[k], depth[k], force[k], correction[k])) for k in range(3)]
    single[1] = float(confidence(z[1, :5], depth[1], force[1, :5], correction[1, :5]))
    np.testing.assert_allclose(confidence(z, depth, force, correction)[:, 0, 0].numpy(), single, rtol=1e-4)
    assert squared_ratio(force, correction).shape == (3,)
