"""The quick runs of the dynamic verification cases: every row is within its tolerance, and tolerances are narrow."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from softprint.fem_truth.energy.potentials import Inertia
from softprint.fem_truth.verify.cases import DYNAMIC, backward_euler, incline
from softprint.fem_truth.verify.problems.motion import FULL, observed_order, oscillation, play, simulator
from softprint.fem_truth.verify.problems.small_bodies import (
    Stuff,
    affine_body,
    held_handles,
    node_body,
    rigid_body,
)
from softprint.fem_truth.verify.typeset import typeset
from softprint.runtime.contact import CoulombFriction
from softprint.runtime.dynamics import DynamicsSettings, NewtonSettings
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh

STUFF = Stuff("linear", 1e4, 0.0)


@pytest.mark.parametrize("case", DYNAMIC, ids=[case.name for case in DYNAMIC])
def test_every_row_of_the_short_form_passes(case):
    result = case.run(True)
    missed = [f"{row.quantity}: {row.ours}, not {row.reference}" for row in result.rows if not row.passed]
    assert not missed
    assert all(np.isfinite(row.ours) for row in result.rows)
    simulators = {row.quantity.split(",")[0].split(":")[0] for row in result.rows}
    assert {"full space", "reduced"} <= simulators  # both are tested


def test_friction_that_is_wrong_by_a_hundredth_fails(monkeypatch):
    right = CoulombFriction.terms

    def stronger(law, x, lagged, time_step):
        terms = right(law, x, lagged, time_step)
        return replace(terms, gradient=1.01 * terms.gradient)

    monkeypatch.setattr(CoulombFriction, "terms", stronger)
    monkeypatch.setattr(incline, "BOTH", ("reduced",))
    missed = {row.quantity.split(": ")[1] for row in incline.CASE.run(True).rows if not row.passed}
    assert {"creep at tan a = 0.5 mu", "acceleration at tan a = 2 mu"} <= missed


def test_inertia_that_is_wrong_by_a_thousandth_fails(monkeypatch):
    right = Inertia.__init__
    monkeypatch.setattr(
        Inertia, "__init__", lambda self, mass, predicted, h: right(self, 0.999 * mass, predicted, h)
    )
    rows = backward_euler.CASE.run(True).rows
    assert "full space, triangles" in {row.quantity.split(":")[0] for row in rows if not row.passed}


@pytest.mark.parametrize("turn", [0.02, 0.3, 1.5])
def test_oscillation_measures_a_mode_under_backward_euler(turn):
    step = 0.01
    n = np.arange(12)
    # Re c (1 - i h w)^-n with any phase: amplitudes of a mode that has already been moving
    read = oscillation(np.real(np.exp(0.4j) * (1 - 1j * turn) ** -n), step)
    assert read.undamped == pytest.approx(turn / step, rel=1e-9)  # round-off of a two-term recurrence
    assert read.seen == pytest.approx(np.arctan(turn) / step, rel=1e-9)
    assert read.decay == pytest.approx(np.log(1 + turn**2) / 2 / step, rel=1e-9)


def test_observed_order_is_that_of_the_two_finest():
    sizes = np.array([1.0, 0.5, 0.25])
    assert observed_order(sizes, np.array([7.0, 3 * 0.5**2, 3 * 0.25**2])) == pytest.approx(2.0)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("make", [affine_body, rigid_body, node_body])
def test_small_bodies_reproduce_affine_maps_and_have_the_right_mass(make, dim):
    mesh = box_mesh([0.1] * dim, [0.3] * dim, [2] * dim)
    body = make(mesh, STUFF)
    np.testing.assert_allclose(body.basis @ body.rest_rows, mesh.points, atol=1e-15)
    assert body.node_mass.sum() == pytest.approx(1000.0 * 0.2**dim)


def test_fixed_handles_are_those_at_the_given_coordinates():
    body = node_body(box_mesh([0.0, 0.0], [1.0, 0.5], [4, 2]), STUFF)
    held = [int(handle.handle) for handle in held_handles(body, [0.0, 1.0])]
    assert len(held) == 6
    assert set(body.mesh.points[held, 0]) == {0.0, 1.0}


def test_a_step_that_does_not_converge_ends_the_case():
    body = node_body(box_mesh([0.0, 0.0], [0.1, 0.05], [4, 2]), Stuff("stable_neo_hookean", 1e3, 0.4))
    # One iteration of Newton's method from rest cannot reach 1e-12 in a motion this large.
    settings = DynamicsSettings(0.1, NewtonSettings(1, 1e-12))
    model = simulator(FULL, body, settings, gravity=[0.0, -9.81], kinematic=held_handles(body, [0.0]))
    with pytest.raises(SoftprintError, match="step 1 of 3 did not converge"):
        list(play(model, model.rest_state(), 3))


def test_the_index_of_the_next_step_is_set_as_one():
    assert typeset("x_n+1 = x_n + h") == "x<sub>n+1</sub> = x<sub>n</sub> + h"
