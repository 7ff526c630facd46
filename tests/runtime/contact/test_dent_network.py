"""The network in the learned energy: derivatives, bounds whatever its weights are, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.contact.learned_energy.dent_network import BOUND, N_MEASURES, DentNetwork
from softprint.runtime.contact.learned_energy.learned_energy import N_VALUES, LearnedEnergy

CENTRE = -2.5
# Two of the dents are outside of it.
RANGE = np.array([-3.5, 0.0]), np.array([-1.5, 0.6])
# W [J], omega and nu of a dent 5 mm deep, of a shallow one, and of three that are wide.
MEASURES = np.array([[1e-3, 0.3, 0.0], [1e-5, 0.02, 0.01], [5e-3, 1.0, np.log(3.0)]])


def network(scale, neurons=5):
    rng = np.random.default_rng(3)
    hidden, bias, output = (
        rng.normal(size=(neurons, N_MEASURES)),
        rng.normal(size=neurons),
        rng.normal(size=neurons),
    )
    return DentNetwork(CENTRE, *RANGE, scale * hidden, scale * bias, scale * output)


def energy(scale=1.0):
    plain = LearnedEnergy.of((0.4, -0.9, -0.4, 0.9, 0.7, 0.3, 0.01))
    return replace(plain, network=network(scale))


def test_derivatives():
    learned, h = energy(), 1e-5
    for measures in MEASURES:

        def at(change, measures=measures):
            return learned.terms(np.array([measures[0] * np.exp(change[0]), *(measures + change)[1:]]))

        here, steps = at(np.zeros(3)), h * np.eye(3)
        slope = [(at(step).value - at(-step).value) / (2 * h) for step in steps]
        # Central differences over 1e-5 of inputs that range over tenths: to the square of it, and round-off.
        np.testing.assert_allclose(here.slope, slope, atol=1e-6 * here.value)
        curvature = [(at(step).slope - at(-step).slope) / (2 * h) for step in steps]
        np.testing.assert_allclose(here.curvature, curvature, atol=1e-6 * here.value)


@pytest.mark.parametrize("scale", [1.0, 30.0, 1e6])
def test_absurd_weights_change_an_energy_by_a_bounded_factor(scale):
    learned = energy(scale)
    for measures in MEASURES:
        for grown in np.logspace(-30, 30, 13):
            measured, number = measures * [grown, 1.0, 1.0], np.exp(measures[2])
            plain, terms = number * learned.energy(measured[0] / number), learned.terms(measured)
            assert plain * np.exp(-BOUND) <= terms.value * (1 + 1e-12)  # round-off
            assert terms.value <= plain * np.exp(BOUND) * (1 + 1e-12)
            assert np.isfinite(terms.slope).all()
            assert np.isfinite(terms.curvature).all()


def test_no_output_is_no_network():
    learned = energy()
    silent = replace(learned, network=replace(learned.network, output=np.zeros(5)))
    for measures in MEASURES:
        terms = silent.terms(measures)
        number = np.exp(measures[2])
        W = measures[0] / number
        assert terms.value == pytest.approx(number * learned.energy(W), rel=1e-14)
        assert terms.slope[0] == pytest.approx(number * learned.slope(W) * W, rel=1e-14)
        assert not terms.slope[1]


def test_values_are_those_given():
    learned = energy()
    same = LearnedEnergy.of(learned.values)
    assert same.values == learned.values
    assert len(learned.values) == N_VALUES + 1 + 2 * N_MEASURES + 5 * (N_MEASURES + 2)
    assert same.terms(MEASURES[0]).value == learned.terms(MEASURES[0]).value


def test_a_part_of_a_network_is_refused():
    with pytest.raises(ValueError, match="network of a learned energy"):
        LearnedEnergy.of(energy().values[:-1])
    with pytest.raises(ValueError, match="network of a learned energy"):
        LearnedEnergy.of(energy().values[: N_VALUES + 1 + 2 * N_MEASURES])
    empty = replace(network(1.0), highest=RANGE[0])
    with pytest.raises(ValueError, match="empty range"):
        LearnedEnergy.of(replace(energy(), network=empty).values)


def test_confidence_fades_continuously_outside_of_training():
    learned, (low, high) = network(1.0), RANGE
    assert learned.confidence(0.5 * (low + high)).value == 1.0
    z = np.linspace(high[0] - 0.1, high[0] + 20.0, 200)
    t = np.array([learned.confidence(np.array([one, 0.3])).value for one in z])
    assert (np.diff(t) <= 0.0).all()
    # Four widths of the range beyond its end are two of n_0.
    beyond = np.array([high[0] + 4.0 * (high[0] - low[0]), 0.3])
    assert learned.confidence(beyond).value == pytest.approx(1.0 / 5.0)
    assert t[-1] < 0.05
    # No jump: the steepest fall, at n / sqrt(3), times the distance of two points.
    assert np.abs(np.diff(t)).max() < 0.65 / (2.0 * (high[0] - low[0])) * (z[1] - z[0])
