"""The learned energy of contact as a function of that of mechanics: derivatives, bounds, and what is refused."""

import numpy as np
import pytest

from softprint.runtime.contact.learned_energy.learned_energy import N_VALUES, LearnedEnergy
from softprint.runtime.learned.force.model import ForceModelOptions

ENERGIES = np.logspace(-12, 2, 15)  # J


@pytest.fixture(params=[0.7, -0.8, 0.0], ids=["hardening", "softening", "proportional"])
def learned(request):
    return LearnedEnergy.of((0.4, -0.9, -0.4, 0.9, request.param, 0.3, 0.01))


def test_derivatives(learned):
    for W in ENERGIES:
        h = 1e-4 * W
        slope = (learned.energy(W + h) - learned.energy(W - h)) / (2 * h)
        # Central differences over 1e-4 of W, to the square of it.
        assert slope == pytest.approx(learned.slope(W), rel=1e-6)
        bend = (learned.slope(W + h) - learned.slope(W - h)) / (2 * h)
        # The slope is of order one, and its round-off 1e-16 / h.
        assert bend == pytest.approx(learned.curvature(W), rel=1e-5, abs=1e-11 / W)


def test_forces_stay_within_their_bounds_and_energy_grows(learned):
    slopes = np.array([learned.slope(W) for W in ENERGIES])
    lowest, highest = sorted([learned.first, learned.first * (1.0 + learned.growth)])
    assert (slopes >= lowest).all()
    assert (slopes <= highest).all()
    energies = np.array([learned.energy(W) for W in [0.0, *ENERGIES]])
    assert energies[0] == 0.0
    assert (np.diff(energies) > 0.0).all()


def test_nothing_learned_is_mechanics():
    same = LearnedEnergy.of((0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0))
    for W in ENERGIES:
        assert (same.energy(W), same.slope(W), same.curvature(W)) == (W, 1.0, 0.0)


def test_values_are_those_given(learned):
    assert LearnedEnergy.of(learned.values) == learned
    assert len(learned.values) == N_VALUES


@pytest.mark.parametrize(
    "values",
    [
        (0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 1.0),
        (0.0, 0.0, 0.0, 1.0, -1.0, 1.0, 1.0),
        (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 0.0, np.nan, 0.0, 1.0, 1.0),
        (0.0, 0.0),
    ],
)
def test_an_energy_that_does_not_grow_is_refused(values):
    with pytest.raises(ValueError, match="learned energy"):
        LearnedEnergy.of(values)
    # As in the header of a correction file that is read.
    header = ForceModelOptions((4,), "silu", 1e-3, 1e-3, 1e9).to_json() | {"energy": list(values)}
    with pytest.raises(ValueError, match="learned energy"):
        ForceModelOptions.from_json(header)
