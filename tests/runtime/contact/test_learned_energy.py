"""The learned energy of contact as a function of that of mechanics and of the excess: derivatives, growth, and what is
refused."""

import numpy as np
import pytest

from softprint.runtime.contact.learned_energy.learned_energy import (
    LEAST,
    MOST,
    N_VALUES,
    LearnedEnergy,
)
from softprint.runtime.learned.force.model import ForceModelOptions

ENERGY = 2e-3  # J
EXCESSES = np.linspace(-0.9, 5.0, 13)


@pytest.fixture(params=[0.7, -0.18, 0.0], ids=["hardening", "softening", "proportional"])
def learned(request):
    return LearnedEnergy.of((0.4, -0.9, request.param))


def test_derivatives(learned):
    for chi in EXCESSES:
        here, h = learned.terms(ENERGY, chi), 1e-5
        for axis, (W, e) in enumerate([(np.exp(h), 0.0), (1.0, h)]):
            ahead, behind = learned.terms(ENERGY * W, chi + e), learned.terms(ENERGY / W, chi - e)
            # Central differences over 1e-5 of what is of order one, to the square of it, and round-off.
            slope, bend = (ahead.value - behind.value) / (2 * h), (ahead.slope - behind.slope) / (2 * h)
            np.testing.assert_allclose(slope, here.slope[axis], atol=1e-8 * ENERGY)
            np.testing.assert_allclose(bend, here.curvature[axis], atol=1e-8 * ENERGY)


def test_energy_is_proportional_to_that_of_mechanics(learned):
    """By a power of 1 + chi, which is continued to second order for dents that are softer than linear elasticity."""
    for chi in EXCESSES:
        counted = 1.0 + chi if chi > 0.0 else np.exp(chi - chi**2 / 2.0)
        expected = ENERGY * counted**learned.growth
        assert learned.terms(ENERGY, chi).value == pytest.approx(expected, rel=1e-14)
    # Two like dents that lie apart have twice the energy of one, and its excess.
    assert learned.terms(2 * ENERGY, 0.3).value == pytest.approx(
        2 * learned.terms(ENERGY, 0.3).value, rel=1e-14
    )


@pytest.mark.parametrize("growth", [LEAST, MOST])
def test_energy_grows_with_the_dent_up_to_the_bounds(growth):
    """W is proportional to the square of the strain of a dent at least, that of the body to its twelfth at most."""
    learned = LearnedEnergy.of((0.0, 0.0, growth))
    strain = np.linspace(0.01, 50.0, 500)
    energies = [learned.terms(ENERGY * s**2, np.log(1.0 + s**10)).value for s in strain]
    assert (np.diff(energies) > 0.0).all()


def test_nothing_learned_is_mechanics():
    same = LearnedEnergy.of((0.0, 0.0, 0.0))
    assert same == LearnedEnergy.of_mechanics()
    for chi in EXCESSES:
        terms = same.terms(ENERGY, chi)
        assert terms.value == ENERGY
        np.testing.assert_array_equal(terms.slope, [ENERGY, 0.0])


def test_values_are_those_given(learned):
    assert LearnedEnergy.of(learned.values) == learned
    assert len(learned.values) == N_VALUES


@pytest.mark.parametrize(
    "values",
    [
        (0.0, 0.0, 0.0, 1.01 * MOST),
        (0.0, 0.0, 0.0, 1.01 * LEAST),
        (0.0, 0.0, 0.0, np.nan),
        (0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 1.0),
    ],
)
def test_an_energy_that_does_not_grow_is_refused(values):
    with pytest.raises(ValueError, match="learned energy"):
        LearnedEnergy.of(values)
    # As in the header of a correction file that is read.
    header = ForceModelOptions((4,), "silu", 1e-3, 1e-3, 1e9).to_json() | {"energy": list(values)}
    with pytest.raises(ValueError, match="learned energy"):
        ForceModelOptions.from_json(header)
