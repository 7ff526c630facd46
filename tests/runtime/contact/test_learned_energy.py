"""The learned energy of contact as a function of that of mechanics and of the energies of a dent: derivatives, growth,
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
OF_DENT = np.array([1.3e-3, 4e-4, 7e-4, -3e-4])  # J, (W_2, W_3, W_4, W_E)
THIRDS = np.linspace(-2.0, 3.0, 11)  # W_3, in W


@pytest.fixture(params=[LEAST, 0.3, MOST])
def learned(request):
    return LearnedEnergy.of((request.param,))


def dent(W_3, W_E=-0.1):
    """In W."""
    return ENERGY * np.array([0.5, W_3, 0.2, W_E])


def test_derivatives(learned):
    for third in THIRDS:
        of_dent = dent(third)
        here, h = learned.terms(ENERGY, of_dent), 1e-5
        for axis, (w, *d) in enumerate(h * np.eye(5)):
            d = ENERGY * np.array(d)
            ahead, behind = (
                learned.terms(ENERGY * np.exp(side * w), of_dent + side * d) for side in (1.0, -1.0)
            )
            # By logarithms and energies in units of W: central differences over 1e-5 of what is of order ten, to the
            # square of it.
            unit = np.array([1.0, *4 * [ENERGY]])
            slope, bend = (ahead.value - behind.value) / (2 * h), (ahead.slope - behind.slope) / (2 * h)
            np.testing.assert_allclose(slope, unit[axis] * here.slope[axis], atol=1e-7 * ENERGY)
            np.testing.assert_allclose(unit * bend, unit * unit[axis] * here.curvature[axis], atol=1e-5 * ENERGY)


def test_energy_is_proportional_to_that_of_mechanics(learned):
    """It is continued to second order for dents that soften."""
    for third in THIRDS:
        chi = third + 0.2 * learned.fourth
        grown = 1.0 + chi if chi > 0.0 else np.exp(chi - chi**2 / 2.0)
        expected = ENERGY * np.exp(np.tanh(-0.2)) * grown
        assert learned.terms(ENERGY, dent(third)).value == pytest.approx(expected, rel=1e-14)
        # Two like dents that lie apart have twice the energies of one.
        assert learned.terms(2 * ENERGY, 2 * dent(third)).value == pytest.approx(2 * expected, rel=1e-14)


def test_energy_grows_with_a_dent_that_hardens(learned):
    """W is quadratic in it, W_3 cubic, and W_4 of fourth order; and whatever W_3 is, it stays above zero."""
    size = np.linspace(0.01, 10.0, 500)
    for third in (-1.0, 1.0):
        energies = [
            learned.terms(s**2, np.array([s**2, third * s**3, 0.5 * s**4, 0.0])).value for s in size
        ]
        assert third < 0.0 or (np.diff(energies) > 0.0).all()
        assert min(energies) > 0.0


def test_absurd_strains_stay_within_the_bound(learned):
    plain = learned.terms(ENERGY, dent(0.1, 0.0)).value
    for W_E in (-1e3, 1e3):
        value = learned.terms(ENERGY, dent(0.1, W_E)).value
        assert plain / np.e * (1 - 1e-12) <= value <= plain * np.e * (1 + 1e-12)


def test_a_dent_without_energy_has_that_of_mechanics(learned):
    """As where all points only just touch."""
    terms = learned.terms(ENERGY, np.zeros(4))
    assert terms.value == ENERGY
    assert terms.slope[0] == ENERGY


def test_mechanics_and_held_hardening_have_no_dent():
    learned = LearnedEnergy.of((0.4,))
    for same, ratio in ((LearnedEnergy.of_mechanics(), 1.0), (learned.held(1.2), 1.2)):
        terms = same.terms(ENERGY, OF_DENT)
        assert terms.value == ratio * ENERGY
        np.testing.assert_array_equal(terms.slope, [ratio * ENERGY, 0.0, 0.0, 0.0, 0.0])
        assert np.count_nonzero(terms.curvature) == 1


def test_values_are_those_given(learned):
    assert LearnedEnergy.of(learned.values) == learned


@pytest.mark.parametrize(
    "values",
    [
        (1.01 * MOST,),
        (LEAST - 0.01,),
        (np.nan,),
        (0.1, 0.2),
        (0.1, 0.2, 0.3),
    ],
)
def test_an_energy_of_no_body_is_refused(values):
    with pytest.raises(ValueError, match="learned energy"):
        LearnedEnergy.of(values)
    # As in the header of a correction file that is read.
    header = ForceModelOptions((4,), "silu", 1e-3, 1e-3, 1e9).to_json() | {"energy": list(values)}
    with pytest.raises(ValueError, match="learned energy"):
        ForceModelOptions.from_json(header)
