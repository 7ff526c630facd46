"""The learned energy of contact as a function of that of mechanics and of the measures of a dent: derivatives, growth,
and what is refused."""

import numpy as np
import pytest

from softprint.runtime.contact.learned_energy.learned_energy import (
    LEAST,
    MOST,
    LearnedEnergy,
)
from softprint.runtime.learned.force.model import ForceModelOptions

ENERGY = 2e-3  # J
EXCESSES = np.linspace(-0.9, 5.0, 13)


@pytest.fixture(params=[0.7, -0.18, 0.0], ids=["hardening", "softening", "proportional"])
def learned(request):
    return LearnedEnergy.of((request.param,))


def test_derivatives(learned):
    for chi in EXCESSES:
        here, h = learned.terms(ENERGY, 0.2, chi), 1e-5
        for axis, (w, s, e) in enumerate(h * np.eye(3)):
            ahead, behind = (
                learned.terms(ENERGY * np.exp(side * w), 0.2 + side * s, chi + side * e) for side in (1, -1)
            )
            # Central differences over 1e-5 of what is of order one, to the square of it, and round-off.
            slope, bend = (ahead.value - behind.value) / (2 * h), (ahead.slope - behind.slope) / (2 * h)
            np.testing.assert_allclose(slope, here.slope[axis], atol=1e-8 * ENERGY)
            np.testing.assert_allclose(bend, here.curvature[axis], atol=1e-8 * ENERGY)


def test_energy_is_proportional_to_that_of_mechanics(learned):
    """By a power of 1 + chi, which is continued to second order for dents that are softer than linear elasticity."""
    for chi in EXCESSES:
        counted = 1.0 + chi if chi > 0.0 else np.exp(chi - chi**2 / 2.0)
        expected = ENERGY * np.exp(-0.1) * counted**learned.growth
        assert learned.terms(ENERGY, -0.1, chi).value == pytest.approx(expected, rel=1e-14)
    # Two like dents that lie apart have twice the energy of one, and its measures.
    assert learned.terms(2 * ENERGY, 0.1, 0.3).value == pytest.approx(
        2 * learned.terms(ENERGY, 0.1, 0.3).value, rel=1e-14
    )


@pytest.mark.parametrize("growth", [LEAST, MOST])
def test_energy_grows_with_the_dent_up_to_the_bounds(growth):
    """W is proportional to the square of the strain of a dent at least, that of the body to its twelfth at most."""
    learned = LearnedEnergy.of((growth,))
    strain = np.linspace(0.01, 50.0, 500)
    energies = [learned.terms(ENERGY * s**2, 0.0, np.log(1.0 + s**10)).value for s in strain]
    assert (np.diff(energies) > 0.0).all()


def test_mechanics_and_held_hardening_have_no_measures():
    learned = LearnedEnergy.of((0.4,))
    for same, ratio in ((LearnedEnergy.of_mechanics(), 1.0), (learned.held(1.2), 1.2)):
        for chi in EXCESSES:
            terms = same.terms(ENERGY, 0.3, chi)
            assert terms.value == ratio * ENERGY
            np.testing.assert_array_equal(terms.slope, [ratio * ENERGY, 0.0, 0.0])
            assert np.count_nonzero(terms.curvature) == 1


def test_values_are_those_given(learned):
    assert LearnedEnergy.of(learned.values) == learned


@pytest.mark.parametrize(
    "values",
    [
        (1.01 * MOST,),
        (1.01 * LEAST,),
        (np.nan,),
        (0.1, 0.2),
        (0.1, 0.2, 0.3),
    ],
)
def test_an_energy_that_does_not_grow_is_refused(values):
    with pytest.raises(ValueError, match="learned energy"):
        LearnedEnergy.of(values)
    # As in the header of a correction file that is read.
    header = ForceModelOptions((4,), "silu", 1e-3, 1e-3, 1e9).to_json() | {"energy": list(values)}
    with pytest.raises(ValueError, match="learned energy"):
        ForceModelOptions.from_json(header)
